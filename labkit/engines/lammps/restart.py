"""Writes contact history into a restart file of LAMMPS, because LAMMPS has no command that sets it.

A restart written with `%` in its name consists of one file per rank: four integers, then the grains of the rank as
doubles. The record of a grain starts with its length, position and number, and ends with the data of the fix
NEIGH_HISTORY: length, number of partners, and for each partner its number and the history of the contact from the view
of this grain:

    xi = -ft/kt       tangential spring, ft the force on this grain
    rho = -fr/kr'     rolling spring, fr = (M x n)/r*, n from the partner to this grain, kr' = kr/r*^2
"""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np

from labkit.errors import PhysicsError

HEAD = 16  # bytes: PROCSPERFILE, 1, PERPROC and the number of doubles
NUMBER = 4  # index of the number of a grain in its record
VALUES = 6  # number of values in the history of a contact: tangential and rolling spring
LONGEST = 64  # upper bound on the number of doubles of a grain without contacts; atom style sphere writes fewer


class Histories(NamedTuple):
    """History of the contacts, once from the view of each of the two grains, sorted by `key`.

    Args:
        key: Index of the grain times the number of grains, plus the index of the partner, (n,).
        value: Tangential and rolling spring, (n, 6), in m.
    """

    key: np.ndarray
    value: np.ndarray
    grains: int


def histories(pair: np.ndarray, own: np.ndarray, other: np.ndarray, grains: int) -> Histories:
    """Return the histories of contacts between `grains` grains.

    Args:
        pair: Indices of the two grains, (n, 2).
        own: Values from the view of the first grain, (n, 6), in m.
        other: Values from the view of the second grain, (n, 6), in m.
        grains: Number of grains.
    """
    first, second = pair[:, 0].astype(np.int64), pair[:, 1].astype(np.int64)
    key = np.concatenate([first * grains + second, second * grains + first])
    order = np.argsort(key)
    return Histories(key[order], np.concatenate([own, other])[order], grains)


def put_histories(file: str | os.PathLike[str], given: Histories) -> None:
    """Replace the history of every contact in the restart file of one rank; it is 0 for contacts not in `given`.

    Raises PhysicsError if the file has a layout that this version of labkit does not know.
    """
    content = bytearray(open(file, "rb").read())
    count = int(np.frombuffer(content, np.int32, offset=HEAD - 4, count=1)[0])
    if HEAD + 8 * count > len(content):
        raise _unknown()
    numbers = np.frombuffer(content, np.float64, offset=HEAD, count=count)
    whole = numbers.view(np.int64)
    begin = _records(numbers)
    if len(begin):
        entry, mine = _entries(numbers, begin, _base(numbers, begin))
        if len(entry):
            key = (whole[begin + NUMBER][mine] - 1) * given.grains + whole[entry] - 1
            place = np.minimum(np.searchsorted(given.key, key), max(len(given.key) - 1, 0))
            known = given.key[place] == key if len(given.key) else np.zeros(len(key), bool)
            value = np.zeros((len(key), VALUES))
            value[known] = given.value[place[known]]
            numbers[entry[:, None] + 1 + np.arange(VALUES)] = value
    with open(file, "wb") as patched:
        patched.write(content)


def _records(numbers: np.ndarray) -> np.ndarray:
    """Return the index at which the record of each grain starts."""
    begin, place = [], 0
    while place < len(numbers):
        begin.append(place)
        length = int(numbers[place])
        if length <= 0:
            raise _unknown()
        place += length
    if place != len(numbers):
        raise _unknown()
    return np.array(begin, dtype=np.int64)


def _base(numbers: np.ndarray, begin: np.ndarray) -> int:
    """Return the index of the history in a record; the history starts with its length and number of partners."""
    length = numbers[begin]
    for base in range(8, min(LONGEST, int(length.min()) - 1)):
        extra, partners = numbers[begin + base], numbers[begin + base + 1]
        if np.array_equal(extra, length - base) and np.array_equal(extra, (VALUES + 1) * partners + 2):
            return base
    raise _unknown()


def _entries(numbers: np.ndarray, begin: np.ndarray, base: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the index of each partner in `numbers`, and the grain to which the partner belongs."""
    partners = numbers[begin + base + 1].astype(np.int64)
    mine = np.repeat(np.arange(len(begin)), partners)
    rank = np.arange(len(mine)) - np.repeat(np.cumsum(partners) - partners, partners)
    return begin[mine] + base + 2 + (VALUES + 1) * rank, mine


def _unknown() -> PhysicsError:
    return PhysicsError("this version of LAMMPS writes restarts that labkit cannot read: install lammps 2025.7.22")
