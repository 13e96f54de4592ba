"""initialconditions.inp, the initial stress and state variables, and parameters.inp, the constants of a material."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.incremental.conventions import STRESS_UNITS, tensor
from labkit.incremental.source import Source

MOST_VALUES = 10_000
ISOTROPIC = 1e-3  # largest deviator of a stress that counts as isotropic, divided by its mean


@dataclasses.dataclass(frozen=True)
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


@dataclasses.dataclass(frozen=True)
class MaterialConstants:
    """A material of parameters.inp: its name and its constants as written."""

    file: Path
    name: str
    constants: tuple[float, ...]


def read_material(file: str | os.PathLike[str]) -> MaterialConstants:
    """Read parameters.inp. Raises InputError with the line."""
    source = Source(Path(file))
    name = source.need("the name of the material").text
    number = source.count("the number of constants", 0, MOST_VALUES)
    constants = [source.reals(1, f"constant {k + 1} of {number}")[0] for k in range(number)]
    return MaterialConstants(source.file, name, tuple(constants))
