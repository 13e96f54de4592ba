"""Detects unreachable targets: a held stress does not approach its target although the servo is at its limit.

The servo limits its strain rates to `rate_limit` times the rate of the path. A target is out of reach if the
rates stay at this limit over a strain of STRAIN while the largest relative error stays above ERROR and does not fall
below (1 - PROGRESS) times its smallest value: the material then flows, or has lost its contacts. A stress that only
lags, in a transient or far from its target, approaches it within that strain. The state is examined at every record.
The limit of 2 % strain is several times the strain within which the stress of a dense specimen responds to a change of
strain rate; an error of 2 % is the largest that `labkit verify` allows.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from labkit.errors import InputError
from labkit.micro.stress import mean_stress
from labkit.micro.tensors import symmetric, to_six
from labkit.parameters import parameters_of
from labkit.paths.control import Control
from labkit.paths.path import Path
from labkit.paths.step import Here, StressReached

STRAIN = 0.02
ERROR = 0.02
PROGRESS = 0.02
AT_LIMIT = 0.9  # fraction of the limit of the strain rate, which the servo's low-pass filter only approaches


@dataclasses.dataclass(frozen=True)
class Lag:
    """How long the servo has been at its limit.

    Args:
        strain: Strain since the error was smallest.
        least_error: This smallest error: the largest relative error of the held stresses (see `errors`).
    """

    strain: float = 0.0
    least_error: float = np.inf

    @property
    def hopeless(self) -> bool:
        """True if the target is out of reach."""
        return self.strain >= STRAIN

    def after(self, strain: float, error: float, at_limit: bool) -> Lag:
        """Return the lag after a further strain; `error` is the current relative error."""
        if error <= ERROR or not at_limit:
            return Lag()
        if error < (1.0 - PROGRESS) * self.least_error:
            return Lag(0.0, error)
        return Lag(self.strain + strain, self.least_error)


def errors(control: Control, stress: np.ndarray, accumulated_strain: float, volume: float | None = None) -> np.ndarray:
    """Return the errors (k,) of held stresses relative to the target or the mean stress, whichever is larger.

    With water in the pores, give the `volume` of the cell, m3.
    """
    target = control.at(accumulated_strain, volume)
    missing = target - control.measure @ to_six(symmetric(stress))
    scale = np.maximum(np.abs(target), abs(float(mean_stress(stress))))
    return np.abs(missing) / np.maximum(scale, np.finfo(float).tiny)


def is_at_limit(control: Control, rate: np.ndarray, prescribed: np.ndarray, limit: float) -> bool:
    """Return True if a strain rate that the servo adjusts is at its limit.

    Args:
        control: The held stresses and free rates.
        rate: Strain rate, (3, 3), in 1/s, compression positive.
        prescribed: Prescribed strain rate, (3, 3), in 1/s.
        limit: Limit of the servo's rates (1/s).
    """
    adjusted = to_six(symmetric(rate - prescribed))[control.free.any(axis=1)]
    return bool(np.abs(adjusted).max() >= AT_LIMIT * limit)


def unreachable(
    control: Control, names: tuple[str, ...], stress: np.ndarray, accumulated_strain: float, volume: float
) -> str:
    """Return a sentence about the held stress with the largest error; `names` are the names of the held stresses."""
    worst = int(errors(control, stress, accumulated_strain, volume).argmax())
    now = float(control.measure[worst] @ to_six(symmetric(stress)))
    target = float(control.at(accumulated_strain, volume)[worst])
    return (
        f"{names[worst]} does not reach its target of {target / 1e3:.4g} kPa: it is {now / 1e3:.4g} kPa after "
        f"{STRAIN:.0%} of strain at the largest strain rate of the servo, so the target is beyond the strength of the "
        "specimen or its contacts are lost; choose a target within the strength, or prescribe this strain rate instead"
    )


def require_way(path: Path, stress: np.ndarray) -> None:
    """Raise InputError if this stress (3, 3), in Pa, already meets the end condition of a path of one step."""
    if (end := met_at_start(path, stress)) is not None:
        now = float(end.measured(stress))
        problem = f"Pa is where path {path.name} stops, but {end.name} of the specimen is {now:.4g} Pa"
        raise refusal(path, end, problem, "another stress, or another specimen")


def met_at_start(path: Path, stress: np.ndarray) -> StressReached | None:
    """Return the end condition of a path of one step that a stress (3, 3), in Pa, already meets, or None."""
    first, *others = itertools.islice(path.steps_from(Here(stress)), 2)
    return None if others else next((end for end in first.stress_ends if end.is_met(stress)), None)


def refusal(path: Path, end: StressReached, problem: str, allowed: str) -> InputError:
    """Return the error about the stress at which a path ends, with the parameter of the path that sets it, if any."""
    of_stress = (name for name, row in parameters_of(type(path)).items() if row.unit == "Pa")
    field = next((name for name in of_stress if end.level in np.ravel(getattr(path, name))), None)
    problem = problem if field else f"{end.level:g} {problem}: give {allowed}"
    return InputError(problem, field=field, value=end.level, allowed=allowed)
