"""Scatter of a laboratory, and the misfit of a simulation relative to it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from labkit.errors import InputError, require_type, warn
from labkit.micro.stress import mean_stress
from labkit.paths.path import Path
from labkit.plugins.laboratory_data.measured import held_by
from labkit.results.endings import LABORATORY
from labkit.results.run import Run

SAME_PRESSURE = 0.05  # relative deviation of pressures of the same test
OTHER_PRESSURE = 0.2  # relative deviation of pressures that cannot be compared
SAME_DENSITY = 0.03  # difference of void ratios of the same test
SAME_RANGE = 0.98  # fraction of a test's strain that counts as all of it
LEAST_SCATTER = 1e-12  # in units of a fraction: below, the misfit would overflow
IMPLAUSIBLE = {"stress_ratio": 1.0, "volumetric_strain": 0.2, "void_ratio": 0.5, "r_u": 1.0}  # scatter of tests: in %?
GENERAL = ("steps", "mixed", "proportional")  # paths that may repeat a test of another name

# Quantities along a test. Dimensionless quantities can be used for tests at several pressures.
CURVES = ("stress_ratio", "volumetric_strain", "axial_stress", "q", "p", "void_ratio", "r_u")


def curve(run: Run, quantity: str, at: np.ndarray, total: str | None = None) -> np.ndarray:
    """Interpolate a quantity of CURVES at the strains of the path, or numbers of cycles, `at`; NaN outside the run.

    `total` is the component of the total stress that is constant (default: that of the run); a measured pore pressure
    is used as it is. Raises InputError for an unknown quantity.
    """
    if quantity not in CURVES:
        raise InputError(field="quantity", value=quantity, allowed=f"one of {', '.join(CURVES)}")
    x, forward, sign = _along(run)
    if quantity == "r_u" and total is not None and "measured_pore_pressure" not in run.data:
        quantity = f"r_u_{total}"
    y = run.data.lab.quantity(quantity).values[forward]
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
    beyond the end of the run are ignored; a warning says so, and also if pressures or void ratios differ a little.
    Raises InputError for an unknown quantity, for tests that cannot be compared (see `remarks`), or if no row can be.

    Args:
        run: A simulation, or a prediction of the model.
        measured: The measured test.
        scatter: Quantity of CURVES -> standard deviation between repeated tests, SI units (see scatter_between).
    """
    for name, test in (("run", run), ("measured", measured)):
        require_type(test, Run, name, "labkit.Run.open('r.run.nc')")
    warn(*remarks(run, measured))
    at, squares = _along(measured)[0], {}
    for quantity, deviation in scatter.items():
        if not deviation > LEAST_SCATTER:
            allowed = f"a standard deviation above {LEAST_SCATTER:g} of {quantity}"
            raise InputError(field="scatter", value=deviation, allowed=allowed)
        if deviation >= IMPLAUSIBLE.get(quantity, math.inf):
            allowed = f"a fraction, e.g. {quantity}={0.01 * deviation:g}"
            raise InputError(f"of {quantity} is too large", field="scatter", value=deviation, allowed=allowed)
        curves = (curve(test, quantity, at, measured.data.lab.total) for test in (run, measured))
        difference = np.subtract(*curves) / deviation
        squares[quantity] = difference[np.isfinite(difference)] ** 2
    if not any(map(len, squares.values())):
        raise InputError("this run and this measurement have no strain in common: give runs of the same test")
    errors = {name: float(np.sqrt(square.mean())) for name, square in squares.items() if len(square)}
    return errors | {"all": float(np.sqrt(np.concatenate([*squares.values()]).mean()))}


def remarks(run: Run, measured: Run) -> list[str]:
    """Return what differs between a run and a measured test that can be compared.

    Raises InputError for arguments in the wrong order, another path, a drained and an undrained test, or a pressure
    that differs by more than 20 %.
    """
    if run.engine == LABORATORY and measured.engine != LABORATORY:
        raise InputError("the run and the measured test are in the wrong order: give the run first, then the test")
    said = [] if measured.engine == LABORATORY else [f"the measured test is a run of the engine {measured.engine}"]
    return [*said, *_of_paths(run, measured), *_of_starts(run, measured), *_of_ranges(run, measured)]


def _of_paths(run: Run, measured: Run) -> list[str]:
    """Compare the paths. Raises InputError for paths that differ."""
    names = [str(test.data.attrs["path"]) for test in (run, measured)]
    if run.data.lab.is_undrained != measured.data.lab.is_undrained and run.data.sizes["time"] > 1:
        words = ["undrained" if test.data.lab.is_undrained else "drained" for test in (run, measured)]
        text = f"the run {names[0]} is {words[0]}, and the measured test {names[1]} is {words[1]}"
        raise InputError(f"{text}: give a run of the path {names[1]}")
    if names[0] == names[1]:
        return []
    if set(names) & set(GENERAL) or run.path is None or measured.path is None:
        return [f"the run follows the path {names[0]}, and the measured test {names[1]}"]
    if _conditions(run.path) == _conditions(measured.path):
        return []
    raise InputError(f"the run follows the path {names[0]}, and the measured test {names[1]}: give runs of one path")


def _conditions(path: Path) -> tuple[bool, list[tuple[str, str]], tuple[float, ...]]:
    """Return what distinguishes paths: cycles, what they hold, and the direction of strain."""
    return path.cyclic, sorted((condition.kind, condition.name) for condition in held_by(path)), tuple(path.direction)


def _of_starts(run: Run, measured: Run) -> list[str]:
    """Compare the pressures and void ratios at the start. Raises InputError for pressures that differ a lot."""
    pressures, said = [_start(test) for test in (run, measured)], []
    off = abs(pressures[0] / pressures[1] - 1.0) if pressures[1] > 0.0 else 0.0
    if off > SAME_PRESSURE:
        text = (
            f"the run starts from {pressures[0] / 1e3:.4g} kPa, and the measured test from {pressures[1] / 1e3:.4g} kPa"
        )
        if off > OTHER_PRESSURE:
            raise InputError(f"{text}: give a run at the pressure of the test")
        said.append(text)
    ratios = [float(test.data["void_ratio"].values[0]) for test in (run, measured)]
    if abs(ratios[0] - ratios[1]) > SAME_DENSITY:
        text = f"the run starts from a void ratio of {ratios[0]:.3f}, and the measured test from {ratios[1]:.3f}"
        said.append(f"{text}: compare relative densities")
    return said


def _start(run: Run) -> float:
    """Return the pressure from which a run starts, Pa: of its path, or of its first record; 0 if it has none."""
    stated = getattr(run.path, "pressure", None) if run.path is not None and run.path.start_pressure() else None
    stress = run.data["stress"].values[0]
    first = float(mean_stress(stress))
    return float(stated) if stated else 0.0 if np.isnan(first) else first


def _of_ranges(run: Run, measured: Run) -> list[str]:
    """Compare the ranges of strains, or numbers of cycles."""
    ends = [float(test.data.lab.abscissa().values[-1]) for test in (run, measured)]
    if not ends[0] * ends[1] > 0.0:
        return []
    shorter = min(ends, key=abs)
    if abs(ends[0]) >= SAME_RANGE * abs(ends[1]):
        return []
    name, unit = ("cycles", "") if measured.path is not None and measured.path.cyclic else ("strain", " %")
    common, whole = (value if not unit else 100.0 * value for value in (shorter, ends[1]))
    return [f"compared up to the {name} {common:.4g}{unit} of the run; the measured test goes to {whole:.4g}{unit}"]


def scatter_between(tests: Iterable[Run], quantities: Iterable[str]) -> dict[str, float]:
    """Return the standard deviation of each quantity of CURVES between repeated tests, pooled over all points.

    Raises InputError for fewer than two tests.
    """
    tests = list(tests)
    if len(tests) < 2:
        raise InputError(field="tests", value=len(tests), allowed="two or more tests of the same kind")
    at = _along(tests[0])[0][1:]
    values = {name: np.array([curve(test, name, at) for test in tests]) for name in quantities}
    return {name: float(np.sqrt(np.nanmean(np.var(curves, axis=0, ddof=1)))) for name, curves in values.items()}
