"""Scatter of a laboratory, and the misfit of a simulation relative to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray

from labkit.errors import InputError, require_type
from labkit.runs.read.run import Run

# Quantities along a test. Dimensionless quantities can be used for tests at several pressures.
CURVES: dict[str, Callable[[xarray.Dataset], xarray.DataArray]] = {
    "stress_ratio": lambda data: data.lab.stress_ratio(),
    "volumetric_strain": lambda data: data.lab.volumetric_strain(),
    "axial_stress": lambda data: data["stress"].sel(i="z", j="z"),
    "q": lambda data: data.lab.q(),
    "p": lambda data: data.lab.mean_stress(),
    "void_ratio": lambda data: data["void_ratio"],
    "r_u": lambda data: data.lab.pore_pressure_ratio(),
}


def curve(run: Run, quantity: str, at: np.ndarray) -> np.ndarray:
    """Interpolate a quantity of CURVES at the strains of the path, or numbers of cycles, `at`; NaN outside the run.

    Raises InputError for an unknown quantity.
    """
    if quantity not in CURVES:
        raise InputError(field="quantity", value=quantity, allowed=f"one of {', '.join(CURVES)}")
    x, forward, sign = _along(run)
    y = CURVES[quantity](run.data).values[forward]
    return np.interp(at * sign, sign * x, y, left=np.nan, right=np.nan)


def _along(run: Run) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the strain or number of cycles in rows where it advances, a mask of these rows, and its final sign."""
    along = run.data.lab.abscissa().values
    sign = float(np.sign(along[-1]))
    forward = np.concatenate([[True], np.diff(np.maximum.accumulate(along * sign)) > 0.0])
    return along[forward], forward, sign


def misfit(run: Run, measured: Run, scatter: Mapping[str, float]) -> dict[str, float]:
    """Return the root mean square of (run - measured)/scatter for each quantity, and for `all` of them.

    1 means that the run differs from the measurement by one standard deviation of the scatter. Rows of the measurement
    beyond the end of the run are ignored. Raises InputError for an unknown quantity, or if no row can be compared.

    Args:
        run: A simulation, or a prediction of the model.
        measured: The measured test.
        scatter: Quantity of CURVES -> standard deviation between repeated tests, SI units (see scatter_between).
    """
    for name, test in (("run", run), ("measured", measured)):
        require_type(test, Run, name, "labkit.Run.open('r.run.nc')")
    at, squares = _along(measured)[0], {}
    for quantity, deviation in scatter.items():
        if not deviation > 0.0:
            raise InputError(field="scatter", value=deviation, allowed=f"a standard deviation above 0 of {quantity}")
        difference = (curve(run, quantity, at) - curve(measured, quantity, at)) / deviation
        squares[quantity] = difference[np.isfinite(difference)] ** 2
    if not any(map(len, squares.values())):
        raise InputError("this run and this measurement have no strain in common: give runs of the same test")
    found = {name: float(np.sqrt(one.mean())) for name, one in squares.items() if len(one)}
    return found | {"all": float(np.sqrt(np.concatenate([*squares.values()]).mean()))}


def scatter_between(tests: Sequence[Run], quantities: Sequence[str]) -> dict[str, float]:
    """Return the standard deviation of each quantity of CURVES between repeated tests, pooled over all points.

    Raises InputError for fewer than two tests.
    """
    if len(tests) < 2:
        raise InputError(field="tests", value=len(tests), allowed="two or more tests of the same kind")
    at = _along(tests[0])[0][1:]
    values = {name: np.array([curve(one, name, at) for one in tests]) for name in quantities}
    return {name: float(np.sqrt(np.nanmean(np.var(one, axis=0, ddof=1)))) for name, one in values.items()}
