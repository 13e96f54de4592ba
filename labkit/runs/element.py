"""Grains in memory as the material of a finite element that turns increments of strain into stress and stiffness."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from labkit.engines import Start, start_of
from labkit.engines.base import drive_engine
from labkit.errors import InputError
from labkit.grains.state import State
from labkit.micro.snapshot import love_stress
from labkit.micro.tensors import symmetric, to_six, to_tensor
from labkit.paths.rates import default_rate
from labkit.paths.standard import ConstantVolume
from labkit.records.energy import opened, require_balanced
from labkit.records.schedule import LEAST_STEPS
from labkit.servo.correction import cell_stiffness, exact_gradient
from labkit.specimens.specimen import ready


class StressUpdate(NamedTuple):
    """The response of grains to an increment of strain.

    stress: Love's, (3, 3), Pa; tangent: (6, 6), Pa, in Mandel notation (labkit.micro.tensors); state: the grains after
    the increment, in motion, from which the next Element starts.
    """

    stress: np.ndarray
    tangent: np.ndarray
    state: State


class Element:
    """Grains that are strained in memory, always from the same State; nothing is written.

    Args:
        state: A specimen, or the State of a run or of a StressUpdate, which keeps its motion.
        engine: As for labkit.run.
        rate: Norm of the strain rate, 1/s (default: the standard rate of cv for these grains, 10 1/s for Table 1).
    """

    def __init__(self, state: State, engine: str | Start = "fused", rate: float | None = None) -> None:
        """Loads nothing yet. Raises InputError for a rate that is not positive."""
        if rate is not None and not rate > 0.0:
            raise InputError(field="rate", value=rate, allowed="a strain rate above 0, in 1/s")
        self.state, self._start = state, start_of(engine)
        self.rate = rate or default_rate(ConstantVolume, state.scene)

    def strain(self, increment: ArrayLike) -> StressUpdate:
        """Strain the cell by an increment, compression positive, at a constant rate; the Element does not change.

        The tangent is the affine stiffness K (labkit.servo.correction.cell_stiffness), an upper bound, corrected by
        Broyden's rank-one formula so that it gives the stress change of this increment d:

            T = K + (stress change - K d) d / (d . d)

        increment: (3, 3), or six components in Mandel notation. Raises InputError for another shape, PhysicsError if
        the energy balance is off.
        """
        given = np.asarray(increment, dtype=float)
        if given.shape not in ((6,), (3, 3)) or not np.isfinite(given).all():
            problem, allowed = "is not an increment of strain", "a tensor (3, 3), or six numbers in Mandel notation"
            raise InputError(problem, field="increment", allowed=allowed)
        tensor = to_tensor(given) if given.shape == (6,) else given
        begin = self._begin
        steps = max(LEAST_STEPS, math.ceil(float(np.linalg.norm(tensor)) / (self.rate * begin.time_step)))
        engine = self._start(begin)
        engine.advance(steps, exact_gradient(tensor / (steps * begin.time_step), begin.time_step))
        state = engine.state()
        snapshot = state.snapshot()
        require_balanced(state, snapshot)
        stress, six = love_stress(snapshot), to_six(symmetric(tensor))
        tangent = cell_stiffness(snapshot, 6)
        if six.any():
            change = to_six(symmetric(stress - self._stress))
            tangent += np.outer(change - tangent @ six, six) / (six @ six)
        return StressUpdate(stress, tangent, state)

    @functools.cached_property
    def _begin(self) -> State:
        """The State with its contacts and a new energy balance, from which every increment starts."""
        state = self.state if self.state.step else self.state.at_rest()
        return opened(drive_engine(ready(state), self._start))

    @functools.cached_property
    def _stress(self) -> np.ndarray:
        """Love's stress at the start of every increment, (3, 3), Pa."""
        return love_stress(self._begin.snapshot())
