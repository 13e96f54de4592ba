"""The start of a test: initial state and constants from the driver's files, and the matching model and path."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.micro.stress import mean_stress
from labkit.micro.tensors import to_six
from labkit.model.parameters import Model, Parameters
from labkit.model.state import ModelState, isotropic_state
from labkit.paths.steps import Steps
from labkit.paths.variables import VARIABLES, mixed_step
from labkit.plugins.incremental.columns import VARIABLES as STATE_VARIABLES
from labkit.plugins.incremental.conventions import STRESS_UNITS, tensor
from labkit.plugins.incremental.source import Source

MOST_VALUES = 10_000
ISOTROPIC = 1e-3  # largest deviator of a stress that is treated as isotropic, divided by the mean stress


@dataclasses.dataclass(frozen=True, eq=False)
class InitialConditions:
    """The initial stress (3, 3), Pa, compression positive on labkit's axes, and the state variables as written."""

    file: Path
    stress: np.ndarray
    state: tuple[float, ...]

    @property
    def pressure(self) -> float:
        """Mean stress, Pa."""
        return float(np.trace(self.stress)) / 3.0

    @property
    def isotropic(self) -> bool:
        """True if the stress has no deviator."""
        return bool(np.abs(self.stress - self.pressure * np.eye(3)).max() <= ISOTROPIC * self.pressure)


def read_initial(file: str | os.PathLike[str], stress_unit: str = "kPa") -> InitialConditions:
    """Read initialconditions.inp. Raises InputError with the line, and for a mean stress that is not compressive."""
    source = Source(Path(file))
    number = source.count("the number of stress components", 1, 6)
    stress = np.zeros(6)
    for k in range(number):
        stress[k] = source.reals(1, f"stress component {k + 1} of {number}")[0]
    variables = source.count("the number of state variables", 0, MOST_VALUES)
    state = []
    for k in range(variables):
        line = source.next()
        if line is None:
            break
        state.append(line.reals(1, f"state variable {k + 1} of {variables}")[0])
    initial = InitialConditions(
        source.file, tensor(stress) * STRESS_UNITS[stress_unit], (*state, *(0.0,) * (variables - len(state)))
    )
    if initial.pressure <= 0.0:
        raise InputError(
            f"{source.file}: the mean stress is not compressive: give negative stresses, which are compressive in the "
            "Incremental Driver, e.g. -100"
        )
    return initial


def read_constants(file: str | os.PathLike[str]) -> list[float]:
    """Read the constants in parameters.inp, as written. Raises InputError with the line."""
    source = Source(Path(file))
    source.need("the name of the material")
    number = source.count("the number of constants", 0, MOST_VALUES)
    return [source.reals(1, f"constant {k + 1} of {number}")[0] for k in range(number)]


SAME = 0.01  # largest difference between the stress of a state and the given stress, divided by the given stress


def way_to(stress: np.ndarray, rate: float | str | None = None) -> Steps:
    """Return the path from an isotropic stress to a stress (3, 3), Pa, with the same mean; it holds all stresses.

    `rate` is the largest strain rate, 1/s.
    """
    pressure = float(mean_stress(stress))
    variables = VARIABLES["cartesian"]
    values = np.einsum("aij,ij->a", variables.tensors, stress)
    step = mixed_step(variables, (True,) * 6, values, absolute=True, label="the way to the initial stress")
    return Steps(steps=(step,), rate=rate, pressure=f"{pressure!r} Pa")


def model_from_constants(file: str | os.PathLike[str], stress_unit: str = "kPa") -> Model:
    """Return the model with the constants of parameters.inp: Young's modulus, then the parameters of Table 2 in order.

    Raises InputError for a wrong number of constants, or for invalid values.
    """
    constants, names = read_constants(file), [field.name for field in dataclasses.fields(Parameters)]
    if len(constants) != 1 + len(names):
        raise InputError(
            f"{file} has {len(constants)} constants, and labkit's model has {1 + len(names)}: give "
            f"Young's modulus of the grains, {', '.join(names)}, or leave --parameters out for Table 2"
        )
    modulus, *values = constants
    try:
        parameters = Parameters(**dict(zip(names, values, strict=True)))
        return Model(parameters, young_modulus=modulus * STRESS_UNITS[stress_unit])
    except InputError as error:
        raise InputError(f"{file}: {error}") from None


def model_state(initial: InitialConditions, model: Model) -> ModelState:
    """Return the initial state of the model. Raises InputError if it is invalid or contradicts the initial stress.

    If the file contains 21 state variables, they are the whole state, as in the output file. Otherwise the first one is
    the void ratio, and the state is isotropic: Z is on the compression line, and Lambda follows from the mean stress.
    """
    try:
        if len(initial.state) == STATE_VARIABLES:
            return _whole_state(initial, model)
        if not initial.state:
            raise InputError("the model needs a void ratio: give it as the first state variable")
        return isotropic_state(model, initial.state[0], initial.pressure)
    except InputError as error:
        raise InputError(f"{initial.file}: {error}") from None


def _whole_state(initial: InitialConditions, model: Model) -> ModelState:
    e, Z, Lam, *rest = initial.state
    A, F, Ft = -tensor(np.reshape(rest, (3, 6)))
    state = ModelState(e, Z, Lam, A, F, Ft)
    stress = state.stress(model)
    if np.linalg.norm(to_six(stress - initial.stress)) > SAME * np.linalg.norm(to_six(initial.stress)):
        raise InputError(
            f"the stress contradicts the {STATE_VARIABLES} state variables, for which C0 gives a mean stress of "
            f"{mean_stress(stress):g} Pa: give the void ratio alone, or that stress"
        )
    return state
