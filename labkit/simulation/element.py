"""Grains in memory as the material of a finite element: increments of strain give stress and stiffness."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from labkit.engines import Device, device_of
from labkit.errors import InputError
from labkit.grains.state import State
from labkit.grains.valid import require_state
from labkit.micro.snapshot import love_stress
from labkit.micro.tensors import symmetric, to_six, to_tensor
from labkit.parameters import Parameter
from labkit.paths.rates import default_rate
from labkit.paths.standard import ConstantVolume
from labkit.records.energy import open_ledger, require_balanced
from labkit.records.schedule import LEAST_STEPS, MOST_STEPS
from labkit.servo.correction import cell_stiffness, exact_gradient
from labkit.specimens.ready import ready

LEAST_INCREMENT = 1e-7  # norm of the smallest strain that corrects the tangent
LEAST_STRAIN = 0.1  # norm of this strain divided by the norm of the increment, which may also rotate


class StressUpdate(NamedTuple):
    """The response of grains to an increment of strain.

    `stress` is Love's stress, (3, 3), Pa. `tangent` is (6, 6), Pa, in Mandel notation (labkit.micro.tensors). `state`
    holds the grains after the increment, in motion; the next Element starts from this State.
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

    def __init__(self, state: State, *, engine: str | Device = "fused", rate: float | None = None) -> None:
        """Store the arguments; nothing is loaded yet. Raises InputError for a rate that is not positive and finite."""
        require_state(state)
        self._state, self._device = state, device_of(engine)
        number = Parameter("rate", unit="1/s", above=0.0, optional=True).read(rate)
        self.rate = number or default_rate(ConstantVolume, state.scene)

    @property
    def state(self) -> State:
        """The State from which every increment starts."""
        return self._state

    def strain(self, increment: ArrayLike) -> StressUpdate:
        """Strain the cell by an increment, compression positive, at a constant rate; the Element does not change.

        The tangent is the affine stiffness K (labkit.servo.correction.cell_stiffness), an upper bound, corrected by
        Broyden's rank-one formula so that T d equals the stress change of this increment d:

            T = K + (stress change - K d) d / (d . d)

        The grains are never quite at rest. The stress after an increment of at most LEAST_STEPS time steps is therefore
        compared with the stress after LEAST_STEPS time steps without strain; the stress after a larger increment is
        compared with the stress at its start. The response to a strain with a norm below LEAST_INCREMENT = 1e-7, or
        below a tenth of the norm of an increment that mostly rotates, is lost in the noise of local damping, which
        changes with the sign of velocities: the tangent is K, as without strain.

        increment: (3, 3), or six components in Mandel notation. Raises InputError for anything else and for more than
        MOST_STEPS time steps, PhysicsError if the energy balance is off.
        """
        tensor, begin = _tensor(increment), self._begin
        size = math.hypot(*tensor.ravel())
        if size >= 1.0:
            raise InputError(field="increment", value=size, allowed="strains as fractions, e.g. 1e-4 for 0.01 %")
        if not size <= self.rate * begin.time_step * MOST_STEPS:
            raise InputError(field="increment", value=size, allowed=f"a strain that takes at most {MOST_STEPS:g} steps")
        steps = max(LEAST_STEPS, math.ceil(size / (self.rate * begin.time_step)))
        state = self._after(steps, tensor)
        snapshot = state.snapshot()
        require_balanced(state, snapshot)
        stress, six = love_stress(snapshot), to_six(symmetric(tensor))
        tangent = cell_stiffness(snapshot, 6)
        if math.hypot(*six) >= max(LEAST_INCREMENT, LEAST_STRAIN * size):
            change = to_six(symmetric(stress - (self._still if steps == LEAST_STEPS else self._stress)))
            tangent += np.outer(change - tangent @ six, six) / (six @ six)
        return StressUpdate(stress, tangent, state)

    def _after(self, steps: int, tensor: np.ndarray) -> State:
        """Return the State after a number of time steps that strain the cell by a tensor (3, 3)."""
        engine = self._device(self._begin)
        engine.advance(steps, exact_gradient(tensor / (steps * self._begin.time_step), self._begin.time_step))
        return engine.state()

    @functools.cached_property
    def _begin(self) -> State:
        """The State with its contacts and a new energy balance, from which every increment starts."""
        state = self.state if self.state.step else self.state.at_rest()
        return open_ledger(self._device.drive(ready(state)))

    @functools.cached_property
    def _stress(self) -> np.ndarray:
        """Love's stress at the start of every increment, (3, 3), Pa."""
        return love_stress(self._begin.snapshot())

    @functools.cached_property
    def _still(self) -> np.ndarray:
        """Love's stress after LEAST_STEPS time steps without strain, (3, 3), Pa."""
        return love_stress(self._after(LEAST_STEPS, np.zeros((3, 3))).snapshot())


def _tensor(increment: ArrayLike) -> np.ndarray:
    """Return the increment as a tensor (3, 3). Raises InputError for an invalid increment."""
    try:
        tensor = np.asarray(increment)
    except ValueError:  # a ragged list
        tensor = np.empty(0)
    numbers = tensor.dtype.kind in "iuf" and not np.ma.is_masked(increment)
    if not numbers or tensor.shape not in ((6,), (3, 3)) or not np.isfinite(tensor).all():
        problem, allowed = "is not an increment of strain", "a tensor (3, 3), or six numbers in Mandel notation"
        raise InputError(problem, field="increment", allowed=allowed)
    return to_tensor(tensor.astype(float)) if tensor.shape == (6,) else tensor.astype(float)
