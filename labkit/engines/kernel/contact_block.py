"""Blocks of contacts: unpacks rows into numbers, applies the contact law, and writes the results back to rows.

The law is the function `pair` of a Composition (labkit.grains.laws.pair). The loop over a block calls `pair` for one
contact at a time, and the compiler vectorises this loop. The names that are None here are placeholders that
`names_of_law` replaces with functions of the law and of the precision.
"""

from __future__ import annotations

import math
from typing import Any as Untyped

import numpy as np

from labkit.engines.kernel.layout import (
    CELL_WORK,
    FIRST_LOSS,
    FORCE,
    HISTORY,
    RADII,
    RADIUS_A,
    RADIUS_B,
    SQUARES,
    STIFFNESS,
    TORQUE_A,
    TORQUE_B,
    VREL,
    WA,
    WB,
    WIDTH,
    D,
    load,
    store,
)
from labkit.grains.laws.contact import Contact
from labkit.grains.laws.law import ContactLaw
from labkit.grains.laws.pair import Composition
from labkit.grains.laws.parts import WITHOUT_NORMAL_FORCE, write_function
from labkit.grains.laws.vectors import ZERO, dot, length_and_inverse, transform
from labkit.micro.stress import branch_force

pair: Untyped = None
normal_force: Untyped = None
history_at: Untyped = None
keep_history: Untyped = None
add_losses: Untyped = None
tangential_force: Untyped = None
moves: bool = True


def block_forces(
    block: np.ndarray, work: np.ndarray, n: int, dt: float, numbers: Untyped, gradient: np.ndarray | None
) -> None:
    """Compute forces and torques of n contacts and advance their history by dt.

    Args:
        block: Rows of the contacts (layout.py).
        work: Rows of the workspace (layout.py).
        n: Number of contacts.
        dt: Time step (s).
        numbers: Parameters of the contact law.
        gradient: Velocity gradient, (3, 3), in 1/s; None to omit the energy sums.
    """
    for i in range(n):
        d = load(work, D, i)
        distance, inverse = length_and_inverse(dot(d, d))
        v = a = b = ZERO
        if moves:
            v, a, b = load(work, VREL, i), load(work, WA, i), load(work, WB, i)
        ra, rb, depth = work[RADIUS_A + i], work[RADIUS_B + i], overlap(work, i, distance)
        contact = Contact(block[STIFFNESS + i], ra, rb, depth, inverse, d, inverse * d, v, a, b)
        response = pair(contact, history_at(block, i), numbers, dt)
        store(work, FORCE, i, response.force)
        if moves:
            store(work, TORQUE_A, i, response.torque_a)
            store(work, TORQUE_B, i, response.torque_b)
        keep_history(block, i, response.history)
        if gradient is not None:
            add_losses(work, i, response.losses, distance)
            work[CELL_WORK + i] += dt * dot(response.force, transform(gradient, d))


def overlap(work: np.ndarray, i: int, distance: float) -> float:
    """Return the overlap (m) of a contact, R - |d|, where R is the sum of the radii and d the branch."""
    return work[RADII + i] - distance


def overlap_single(work: np.ndarray, i: int, distance: float) -> float:
    """Return the overlap as (R^2 - d^2)/(R + |d|); its numerator was computed in double precision."""
    return work[SQUARES + i] / (work[RADII + i] + distance)


def block_stress(
    block: np.ndarray, work: np.ndarray, n: int, numbers: Untyped, sums: np.ndarray, arms: bool | None
) -> None:
    """Add branch (x) force on the first grain of n contacts to `sums` (9 WIDTH,).

    Dashpot forces are excluded, as in records. With clumps, `arms` is True, and the rows VREL contain the arm of the
    second grain in its clump minus the arm of the first grain. Without clumps, `arms` is None.
    """
    for i in range(n):
        d = load(work, D, i)
        distance = math.sqrt(dot(d, d))
        depth = overlap(work, i, distance)
        k, ra, rb, history = block[STIFFNESS + i], work[RADIUS_A + i], work[RADIUS_B + i], history_at(block, i)
        contact = Contact(k, ra, rb, depth, 0.0, d, d, ZERO, ZERO, ZERO)
        f = tangential_force(history) - (normal_force(contact, history, numbers) / distance) * d
        if arms is not None:
            d = d - load(work, VREL, i)
        for k, product in enumerate(branch_force(d, f)):
            sums[k * WIDTH + i] += product


def write_row(rows: np.ndarray, row: int, value: float) -> None:
    """Write a number to a place in `rows`."""
    rows[row] = value


def add_to_row(rows: np.ndarray, row: int, value: float) -> None:
    """Add a number to the number at a place in `rows`."""
    rows[row] += value


def names_of_law(law: ContactLaw, composition: Composition) -> dict[str, Untyped]:
    """Return the values of the placeholders above for a law."""
    columns, first, reads, writes = composition.columns, HISTORY, [], []
    for name, column in columns.items():
        reads.append(f"load(block, {first}, i)" if column.size > 1 else f"block[{first} + i]")
        write = f"store(block, {first}, i" if column.size > 1 else f"write_row(block, {first} + i"
        writes.append(f"{write}, history.{name})")
        first += column.size * WIDTH
    not_in_padding = {  # padding contacts overlap deeply: only springs and dashpots dissipate nothing there
        name for kind, part in law.parts_by_kind.items() if kind not in WITHOUT_NORMAL_FORCE for name in part.losses
    }
    adds = []
    for k, name in enumerate(composition.losses):
        real = " if distance > 0.0 else 0.0" if name in not_in_padding else ""
        adds.append(f"add_to_row(work, {FIRST_LOSS + k * WIDTH} + i, losses.{name}{real})")
    known = {
        "load": load,
        "store": store,
        "write_row": write_row,
        "add_to_row": add_to_row,
        "History": composition.make_history,
        "ZERO": ZERO,
    }
    forces = [f"history.{name}" for name, column in columns.items() if column.is_force]
    texts = {
        "history_at": f"lambda block, i: History({', '.join(reads)})",
        "keep_history": f"lambda block, i, history: ({''.join(f'{write}, ' for write in writes)})",
        "add_losses": f"lambda work, i, losses, distance: ({''.join(f'{one}, ' for one in adds)})",
        "tangential_force": f"lambda history: {' + '.join(forces) or 'ZERO'}",
    }
    return {
        "pair": composition.pair,
        "normal_force": composition.normal_force,
        "moves": composition.moves,
        **{name: write_function(text, **known) for name, text in texts.items()},
    }
