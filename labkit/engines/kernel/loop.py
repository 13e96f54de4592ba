"""Runs the host's loop over time steps (labkit/engines/host/loop.hpp) with NumPy arrays and compiled functions."""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from labkit.engines.kernel import host
from labkit.engines.kernel.blocks import PLAN, Needs
from labkit.engines.kernel.bodies import BODIES, Bodies
from labkit.engines.kernel.host import POINTER
from labkit.engines.kernel.layout import ARRAYS, Arrays, LoopStruct, PlanStruct
from labkit.engines.kernel.motion import MOTION, Motion
from labkit.engines.kernel.tables import Pointers
from labkit.engines.threads import warn_once
from labkit.servo.formula import ServoPlan

if TYPE_CHECKING:
    from labkit.engines.kernel.exchange import Exchange


class _Team:
    """The threads of this process. After a fork, OpenMP would wait forever for the threads of the parent process."""

    used, lost = False, False
    here = threading.local()  # `started`: threads that OpenMP has started for this thread of Python

    @classmethod
    def after_fork(cls) -> None:
        """Record in a forked process that it lacks the threads of its parent."""
        cls.lost = cls.lost or cls.used

    @classmethod
    def size(cls, threads: int) -> int:
        """Return how many of the requested threads can run."""
        if threads > 1 and cls.lost:
            warn_once(
                "the fused engine runs on 1 thread in a process forked from one that ran on several: start it anew"
            )
            return 1
        if threads > getattr(cls.here, "started", 1):
            if not host.call_common("can_start", threads):
                warn_once("the fused engine runs on 1 thread: the system starts no more (`ulimit -u`, or the memory)")
                return 1
            cls.here.started = threads
        cls.used = cls.used or threads > 1
        return threads


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_Team.after_fork)


class Loop:
    """The loop over time steps, for the arrays of one neighbour search.

    Args:
        arrays: Arrays of grains and contacts.
        moving: The cell and its motion.
        rigid: The clumps, or None.
        functions: Addresses of the functions of labkit.engines.kernel.blocks.
        needs: The Needs on which these functions depend.
        damping: Coefficient of local damping, or None.
        exchange: The exchange with other ranks, or None.
    """

    def __init__(
        self,
        arrays: Arrays,
        moving: Motion,
        rigid: Bodies | None,
        functions: Sequence[int],
        needs: Needs,
        damping: float | None,
        exchange: Exchange | None = None,
    ) -> None:
        """Build the structures for the host. Raises ValueError if the arrays are inconsistent."""
        domains, unused = len(arrays.contact_first), len(arrays.places) - 1
        if len(arrays.grain_first) != domains + 1 or arrays.grain_first[-1] != len(arrays.start):
            raise ValueError("the domains do not divide the grains")
        if arrays.pairs.max(initial=0) > unused or arrays.owner.max(initial=0) >= unused:
            raise ValueError("a contact or an image refers to a site that does not exist")
        if arrays.contact_last.max(initial=0) > arrays.pairs.shape[1] or arrays.image_first[-1] != len(arrays.owner):
            raise ValueError("the domains do not divide the contacts and images")
        self._arrays, ends = ARRAYS.pointers(arrays, needs.real), arrays.image_first
        self._last = ARRAYS.pointers(arrays._replace(image_first=ends.clip(min=ends[-2])), needs.real)
        self._motion = MOTION.pointers(moving, needs.real)
        self._bodies = None if rigid is None else BODIES.pointers(rigid, needs.real)
        self._numbers, gradient = needs.flat_numbers(), np.zeros(9, needs.real) if needs.energy else None
        self._kept, self._exchange = (arrays, moving, rigid, gradient), exchange
        self._plan: tuple[ServoPlan, Pointers] | None = None
        self._moving, self._suffix = moving, host.precision_of(np.dtype(needs.real))
        self._loop = LoopStruct(
            arrays=self._arrays.address,
            functions=(POINTER * 10)(*functions),
            motion=self._motion.address,
            **{name: getattr(moving, name).ctypes.data for name in ("cell", "drift", "wanted", "back", "totals")},
            bodies=self._bodies and self._bodies.address,
            arms=None if rigid is None else rigid.arms.ctypes.data,
            numbers=self._numbers.ctypes.data,
            gradient=None if gradient is None else gradient.ctypes.data,
            damping=damping or 0.0,
            turning=int(needs.law.moves),
            radii=int(needs.law.by_radii),
            first=exchange.first if exchange else 0,
            last=exchange.last if exchange else domains,
            exchange=exchange and exchange.pointer,
        )

    def advance(self, steps: int, moved: bool, dt: float, plan: ServoPlan, threads: int) -> tuple[int, bool]:
        """Run up to `steps` steps of dt (s); return the number completed, and True if a neighbour search is needed.

        If a search is needed, the grains have already been moved for the next step, but its forces have not been
        computed: run the search, then call again with `moved`.

        Args:
            steps: Maximum number of time steps, at most those left in the plan.
            moved: True if the grains have already been moved for the first step.
            dt: Time step (s).
            plan: Velocity gradients of the coming steps.
            threads: Number of threads.
        """
        if self._plan is None or self._plan[0] is not plan:  # many short calls follow the same plan
            self._plan = plan, PLAN.pointers(plan, np.float64)
        table, search = self._plan[1], ctypes.c_bool()
        place = self._moving.place.ctypes.data
        of_plan = PlanStruct(table.address, plan.steps.ctypes.data, place, int(plan.controlled))
        name = f"advance_{self._suffix}"
        done = host.call(name, self._loop, of_plan, int(steps), int(moved), float(dt), _Team.size(threads), search)
        if self._exchange is not None:
            self._exchange.moved()
        return done, search.value

    def place_images(self, drift: np.ndarray, of_last: bool = False) -> None:
        """Copy the grains, or those of the last domain alone, to their images in other periods and domains.

        Args:
            drift: Velocity that each period adds, (3, 3), in m/s.
            of_last: True to copy the grains of the last domain alone.
        """
        arrays, drift = self._last if of_last else self._arrays, host.as_array(float, drift, 3, 3)
        host.call(f"place_images_{self._suffix}", POINTER(arrays.address), self._moving.cell, drift)

    def branch_force(self) -> None:
        """Set `totals` of the Motion to the sums of branch (x) force over all contacts, without dashpot forces."""
        host.call(f"branch_force_{self._suffix}", self._loop)
