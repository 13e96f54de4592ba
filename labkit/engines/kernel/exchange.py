"""What the fused engine exchanges between MPI ranks: images, largest values, sums, and all grains before a search.

A rank computes some of the domains. Every rank has the arrays of all domains, from the same neighbour search, so that
it knows which images of its grains another rank uses. Sums are taken in the same order as on one rank.
"""

from __future__ import annotations

import abc
import ctypes
import math
import weakref
from typing import Any, NamedTuple

import numpy as np

from labkit.engines.followers import Ranks
from labkit.engines.kernel.layout import (
    FORCE_COLUMNS,
    INTEGER,
    PLACE_COLUMNS,
    POINTER,
    REAL,
    SITE_COLUMNS,
    WIDTH,
    Arrays,
)
from labkit.engines.mpi import mpi_library

CALLBACK = ctypes.CFUNCTYPE(REAL, INTEGER, REAL, ctypes.POINTER(REAL), INTEGER)
PLACES, FORCES, LARGEST, SUMS = range(4)  # enum Exchange in labkit/engines/host/loop.hpp


class Records(NamedTuple):
    """Records of sites that go to or come from another rank: its number, the sites (n,), and the records (n, k)."""

    rank: int
    sites: np.ndarray
    values: np.ndarray


class Exchange(abc.ABC):
    """The exchange of this rank with the others, for the arrays of one neighbour search.

    `pointer` is the function that the host calls.

    Args:
        ranks: All ranks.
        arrays: Arrays of grains and contacts.
        first: First domain that this rank computes.
        last: End of these domains.
    """

    def __init__(self, ranks: Ranks, arrays: Arrays, first: int, last: int) -> None:
        """Store the arrays."""
        self._ranks, self._arrays, self._mpi = ranks, arrays, mpi_library()
        self.first, self.last = first, last
        self._error: BaseException | None = None
        self._gathered = True
        self._out: list[Records] = []
        self._into: list[Records] = []
        here = weakref.proxy(self)  # a reference would keep the arrays in memory after the next search
        self._callback = CALLBACK(lambda *asked: here._exchange(*asked))
        self.pointer = ctypes.cast(self._callback, POINTER).value

    def _exchange(self, what: int, value: float, array: object, count: int) -> float:
        """Exchange what the host asks for. After an error, an infinite distance ends the loop of the host."""
        try:
            if self._error is not None:
                return math.inf
            if what == LARGEST:
                largest = np.array([value])
                self._ranks.wait(self._ranks.comm.Iallreduce(self._mpi.IN_PLACE, largest, self._mpi.MAX))
                return float(largest[0])
            if what == PLACES:
                self.refresh()
            else:
                self._carry_out(what, array, count)
            return 0.0
        except BaseException as error:  # no exception passes through the host
            self._error = error
        return math.inf

    @abc.abstractmethod
    def _carry_out(self, what: int, array: Any, count: int) -> None:
        """Exchange FORCES or SUMS; of SUMS, `array` has `count` for all domains."""

    def refresh(self) -> None:
        """Copy grains to their images on other ranks."""
        a = self._arrays
        for _, sites, records in self._out:
            records[:, :PLACE_COLUMNS], records[:, PLACE_COLUMNS:] = a.places.take(sites, 0), a.motions.take(sites, 0)
        self._swap(self._out, self._into)
        for _, sites, records in self._into:
            a.places[sites], a.motions[sites] = records[:, :PLACE_COLUMNS], records[:, PLACE_COLUMNS:]

    def _swap(self, out: list[Records], into: list[Records]) -> None:
        comm = self._ranks.comm
        requests = [comm.Irecv(records, q) for q, _, records in into]
        self._ranks.wait(*requests, *(comm.Isend(records, q) for q, _, records in out))

    def _records(self, sites: dict[int, np.ndarray]) -> list[Records]:
        """Return room for the records of some sites of each other rank."""
        width = PLACE_COLUMNS + SITE_COLUMNS
        return [
            Records(q, at, np.empty((len(at), width))) for q, at in sites.items() if q != self._ranks.rank and len(at)
        ]

    @abc.abstractmethod
    def gather(self) -> None:
        """Let rank 0 know the sums of all ranks."""

    def moved(self) -> None:
        """Note that the grains have moved. Raises the error of an exchange since then."""
        self._gathered = False
        if self._error is not None:
            raise self._error


class ImageExchange(Exchange):
    """The exchange between ranks that all have the arrays of the whole specimen."""

    def __init__(self, ranks: Ranks, arrays: Arrays) -> None:
        """Find the images that this rank sends and receives."""
        domains, images = len(arrays.contact_first), len(arrays.owner)
        self._cut = np.arange(ranks.size + 1) * domains // ranks.size
        super().__init__(ranks, arrays, *(int(end) for end in self._cut[ranks.rank : ranks.rank + 2]))
        user, first_image = np.zeros(images, np.int64), len(arrays.places) - 1 - images
        for d, (begin, end) in enumerate(zip(arrays.contact_first, arrays.contact_last, strict=True)):
            second = arrays.pairs[1, begin:end].astype(np.int64)
            user[second[second >= first_image] - first_image] = d
        home = np.searchsorted(arrays.grain_first, arrays.owner, side="right") - 1
        uses, has = (np.searchsorted(self._cut, domain, side="right") - 1 for domain in (user, home))
        here = ranks.rank
        every = range(ranks.size)
        self._out = self._records({q: np.flatnonzero((has == here) & (uses == q)) + first_image for q in every})
        self._into = self._records({q: np.flatnonzero((uses == here) & (has == q)) + first_image for q in every})

    def _carry_out(self, what: int, array: Any, count: int) -> None:
        a, comm = self._arrays, self._ranks.comm
        if what == FORCES:
            for _, sites, records in self._into:
                records[:, :FORCE_COLUMNS], a.forces[sites] = a.forces.take(sites, 0), 0.0
            self._swap(self._into, self._out)
            for _, sites, records in self._out:
                a.forces[sites] = records[:, :FORCE_COLUMNS]
        else:
            values = np.ctypeslib.as_array(array, (count,))
            self._ranks.wait(comm.Iallreduce(self._mpi.IN_PLACE, values, self._mpi.SUM))

    def gather(self) -> None:
        """Let every rank have the grains, contacts and sums of all ranks."""
        if self._gathered:
            return
        a, cut, requests = self._arrays, self._cut, []
        for q in range(self._ranks.size):
            begin, end = cut[q : q + 2]
            grains, contacts = a.grain_first[[begin, end]], (a.contact_first[begin], a.contact_last[end - 1])
            of_grains, of_contacts = (slice(*(-(-place // WIDTH) for place in places)) for places in (grains, contacts))
            parts = *(table[slice(*grains)] for table in (a.places, a.motions)), a.grains[of_grains]
            parts += a.blocks[of_contacts], a.work[begin:end], a.doubles[begin:end]
            requests += [self._ranks.comm.Ibcast(part, q) for part in parts]
        self._ranks.wait(*requests)
        self._gathered = True
