"""The engine `lammps`: LAMMPS divides the grains among MPI ranks, and each rank computes its own like the engine fused.

Contacts between grains of two ranks are computed on both, so that no forces cross ranks; on each rank, half of their
work, losses and stress counts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from labkit.engines.base import Abilities
from labkit.engines.followers import Ranks, alone
from labkit.engines.fused import FusedEngine
from labkit.engines.kernel.exchange import SUMS, Exchange
from labkit.engines.kernel.layout import CELL_WORK, SUM_ROWS, WIDTH
from labkit.engines.kernel.motion import Motion
from labkit.engines.kernel.packing import History, PackedArrays
from labkit.engines.kernel.specimen import Kinematics, Pairs, history_of
from labkit.engines.lammps.carrier import Carrier, LabelledGrains, belongs, require_lammps
from labkit.errors import InputError, PhysicsError
from labkit.grains.state import State
from labkit.records.energy import kinetic_energy

NO_GRAINS = np.zeros(0, np.int64)  # `number` of a History with labels


class CarriedExchange(Exchange):
    """The exchange between ranks that only have their own grains and those near them.

    Args:
        ranks: All ranks.
        packing: Arrays of the kernel; contacts with grains of other ranks are in the last domain.
        label: Label of each grain, (grain,).
        rank: Rank of each grain, (grain,).
        place_images: Copies the grains of other ranks to their images.
    """

    def __init__(
        self, ranks: Ranks, packing: PackedArrays, label: np.ndarray, rank: np.ndarray, place_images: Callable[[], None]
    ) -> None:
        """Let the other ranks know which of their grains this rank needs."""
        super().__init__(ranks, packing.arrays, 0, len(packing.arrays.contact_first))
        grains, self._place_images = len(packing.arrays.start), place_images
        label, rank = label.take(packing.order), rank.take(packing.order)
        in_contact = np.zeros(len(packing.arrays.places), bool)  # LAMMPS also lets a rank know others
        in_contact[packing.arrays.pairs] = in_contact[packing.arrays.owner] = True
        of_contacts = grains + np.flatnonzero(in_contact[grains : len(rank)])
        needed = [of_contacts[rank[of_contacts] == q] for q in range(ranks.size)]
        asked = ranks.comm.alltoall([label[sites] for sites in needed])
        by = np.argsort(label[:grains])
        self._into = self._records(dict(enumerate(needed)))
        self._out = self._records({q: by[np.searchsorted(label[by], wanted)] for q, wanted in enumerate(asked)})

    def refresh(self) -> None:
        super().refresh()
        self._place_images()

    def _carry_out(self, what: int, array: Any, count: int) -> None:
        if what == SUMS:
            sums = np.ctypeslib.as_array(array, (count,)).reshape(self.last, -1)
            self._sum_on_first(sums)
            self._ranks.wait(self._ranks.comm.Ibcast(sums[0]))

    def gather(self) -> None:
        if not self._gathered:
            self._sum_on_first(self._arrays.work[:, CELL_WORK : CELL_WORK + SUM_ROWS * WIDTH])
            self._sum_on_first(self._arrays.doubles)
            self._gathered = True

    def _sum_on_first(self, sums: np.ndarray) -> None:
        """Move the sums of all domains (domain, n) and ranks to the first domain of rank 0."""
        sums[np.diff(self._arrays.grain_first) == 0] *= 0.5  # contacts with grains of other ranks
        total = sums.sum(axis=0)
        sums[:] = 0.0
        self._ranks.wait(self._ranks.comm.Ireduce(total, sums[0] if self._ranks.rank == 0 else None))


class LammpsEngine(FusedEngine):
    """The grains of one rank. The State is on rank 0 alone: what the others load and return has no grains.

    Args:
        state: State to load.
        threads: 1; all processors of a computer are used by ranks.
        ranks: All ranks; None for one.
    """

    name = "lammps"
    shares_state = False
    abilities = Abilities(
        parallel=("ranks",),
        require_computer=require_lammps,
        follow=lambda engine, corrections: engine.follow(corrections),
    )

    def __init__(self, state: State, threads: int = 1, ranks: Ranks | None = None) -> None:
        """Start LAMMPS and load the state. Raises InputError."""
        ranks = ranks or alone()
        self._comm, self._carrier = ranks.comm, Carrier(ranks.comm)
        self.version = self._carrier.version
        super().__init__(state, threads, ranks=ranks)

    def load(self, state: State) -> None:
        first = self._comm.rank == 0
        if first:
            self._accept(state)
        start, scale = self._comm.bcast((self._start.replace(radius=None), self._scale) if first else None)
        if not first:
            self._start, self._scale, self._bodies_of_state = start, scale, None
        self._prepare()
        self._search(*self._divide(state))
        self._settle()

    def _divide(self, state: State) -> tuple[Kinematics, History]:
        """Take the grains of this rank and the history of their contacts, with labels; `state` is on rank 0 alone."""
        ends = self._comm.gather(self._carrier.create_box(self._cell))
        if self._comm.rank == 0:
            arrays = self._start.radius, state.position, state.velocity, state.angular_velocity
            everything = LabelledGrains(np.arange(self._scale.grains, dtype=np.int32), *arrays)
            history = history_of(state, self._needs.law.columns)._replace(number=NO_GRAINS)
            inside = self._carrier.inside(state.position)
            for rank in range(len(ends))[::-1]:
                near = belongs(inside, *ends[rank])
                part = everything.take(near), take_pairs(history, np.logical_or(*near.take(history.pairs)))
                if rank:
                    self._comm.send(part, rank)
            del everything, history, inside
        else:
            part = self._comm.recv(source=0)
        grains = self._carrier.create_grains(part[0])
        self._label, self._rank = grains.label, np.full(len(grains.label), self._comm.rank, np.int32)
        counts = self._comm.allgather(len(grains.label))
        if min(counts) == 0:
            raise InputError("are too many for these grains", field="ranks", value=len(counts), allowed="fewer")
        if sum(counts) != self._scale.grains:
            raise PhysicsError(
                f"LAMMPS took only {sum(counts)} of {self._scale.grains} grains: report this, with the specimen"
            )
        return grains.kinematics, part[1]

    def _search_again(self) -> None:
        self._fit_margin()
        self._search(self.packing.unpack_grains(), self._labelled(self.packing.unpack_history()))

    def _labelled(self, history: History) -> History:
        """Return a history with labels in place of the kernel's indices."""
        return history._replace(pairs=self._label.take(self.packing.order).take(history.pairs), number=NO_GRAINS)

    def _search(self, kinematics: Kinematics, history: History) -> None:
        """Let grains move to other ranks, and find the neighbours of those of this rank; `history` has labels."""
        self._free()
        reach = self._scale.largest_diameter + self._scale.reach + self._skin
        before = self._label[self._rank == self._comm.rank]
        grains, self._rank = self._carrier.carry(self._cell, reach, *kinematics)
        del kinematics
        self._label, mine = grains.label, self._rank == self._comm.rank
        history = self._follow_grains(before, grains.label[mine], history)
        self._solids = self._solids_of(grains.radius)
        self._solids[~mine, 1:] = 0.0
        super()._search(grains.kinematics, history)

    def _follow_grains(self, before: np.ndarray, now: np.ndarray, history: History) -> History:
        """Return the history of the contacts of the grains of this rank now, with indices of the grains that it knows.

        Args:
            before: Labels of the grains that this rank had, (n,).
            now: Labels of the grains that it has now, (m,).
            history: Contact history with labels.
        """
        parts = [self._local(history)]
        if self._comm.size > 1:
            arrived = self._comm.allgather(np.setdiff1d(now, before, assume_unique=True))
            gone = np.setdiff1d(before, now, assume_unique=True)
            moved = take_pairs(history, np.logical_or(*np.isin(history.pairs, gone)))
            for_others = [take_pairs(moved, np.logical_or(*np.isin(moved.pairs, labels))) for labels in arrived]
            parts += map(self._local, self._comm.alltoall(for_others))
        return history._replace(
            pairs=np.concatenate([part.pairs for part in parts], axis=1),
            shift=np.concatenate([part.shift for part in parts]),
            rows=np.concatenate([part.rows for part in parts]),
            number=np.arange(len(self._label)),
        )

    def _local(self, history: History) -> History:
        """Return the contacts among the grains that this rank knows, with their indices; `history` has labels."""
        index = np.searchsorted(self._label, history.pairs).clip(max=len(self._label) - 1)
        here = (self._label.take(index) == history.pairs).all(axis=0)
        return take_pairs(history._replace(pairs=index.astype(np.int32)), here)

    def _exchange_of(self, packing: PackedArrays, moving: Motion) -> Exchange | None:
        if self._ranks is None or self._ranks.size == 1:
            return None
        return CarriedExchange(
            self._ranks, packing, self._label, self._rank, lambda: self._loop.place_images(moving.drift, of_last=True)
        )

    def _divide_work(self) -> None:
        """Use one thread per rank."""

    def state(self) -> State:
        self._enter_flows()
        everything = self._unpack()
        return self._state_of(*everything) if self._comm.rank == 0 else self._start

    def _unpack(self) -> tuple[Kinematics, Pairs]:
        """Return the grains and pairs of all ranks on rank 0, and those of this rank on others."""
        p = self.packing
        mine = p.pairs[0] < len(p.arrays.start)  # a contact of two ranks is of the rank of its first grain
        pair = self._on_first(self._label.take(p.order).take(p.pairs.T[mine]))
        pairs = Pairs(pair, self._on_first(p.pair_shift[mine]), self._on_first(p.take_history(mine)))
        order = np.argsort(self._on_first(self._label[self._rank == self._comm.rank]))
        position, velocity, spin = (self._on_first(values).take(order, 0) for values in p.unpack_grains())
        return (position, velocity, spin), pairs

    def _on_first(self, values: np.ndarray) -> np.ndarray:
        """Return the rows of all ranks on rank 0, and those of this rank on others: one array at a time, for memory."""
        return np.concatenate(self._comm.gather(values) or [values])

    def stop_grains(self) -> None:
        state = self.state()
        if self._comm.rank == 0:
            lost = kinetic_energy(state)
            state = state.without_velocities().replace(ledger=state.ledger.plus(0.0, 0.0, 0.0, lost))
        self.load(state)


def take_pairs(history: History, which: np.ndarray) -> History:
    """Return some of the pairs of a History."""
    return history._replace(pairs=history.pairs[:, which], shift=history.shift[which], rows=history.rows[which])
