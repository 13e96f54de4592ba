"""Ends of shear tests: means over the last part of each test, whether they are stationary, and the critical-state line.

A state is critical if e, q/p and p stay constant while the shear goes on. The end of a test is called critical only if
it is shown to be stationary (labkit.results.stationary): the 95 % intervals of the slopes of e, q/p and p over the
last quarter of the strain are below 1 % of their means per 10 % strain.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping

import numpy as np
import pandas
import xarray
from numpy.typing import ArrayLike
from scipy import stats

from labkit.errors import InputError, require_type
from labkit.parameters import Parameter
from labkit.paths.registry import PATHS
from labkit.results.dataset import datasets_of
from labkit.results.stationary import CONFIDENCE, slope

WINDOW = 0.25  # fraction of the strain of a test: its last quarter
ENOUGH_STRAIN = 0.15  # least strain at which the end of a shear test is treated as critical
LEAST_RANGE = 1.2  # ratio of the largest to the least p from which a line in p is fitted
COMPRESSION = "triaxial compression"
SHEAR = ("cv", "cr", "cp")  # the shear tests of the paper
SCALARS = {"void_ratio": "e", "coordination_number": "Z", "mean_normalised_force": "Lambda"}
TENSORS = {"contact_anisotropy": "A_zz", "normal_force_anisotropy": "F_zz", "mobilisation": "Ft_zz"}


def is_shear(run: xarray.Dataset) -> bool:
    """Return True if the path of the run leads to a critical state; False for a path that is not registered here."""
    return run.attrs["path"] in PATHS and PATHS[run.attrs["path"]].shear


def why_not_critical(run: xarray.Dataset, least_strain: float = ENOUGH_STRAIN) -> str | None:
    """Return why the end of a run is not critical; None for a complete shear test to a sufficient strain.

    The strain is gamma_xz in simple shear, otherwise the axial strain. `run`: opened with labkit.open_run.
    """
    strain = run.lab.strain()
    reached, which = abs(float(strain[-1])), strain.attrs["long_name"]
    if not is_shear(run):
        return f"path {run.attrs['path']} is not a shear test"
    if not run.attrs["complete"]:
        return f"unfinished, stopped at {reached:.2%} {which}"
    if reached < least_strain * (1.0 - 1e-6):  # some files store strains in single precision
        return f"ends at {reached:.2%} {which}, before {least_strain:.3g}"
    return None


def require_critical(
    runs: Mapping[str, xarray.Dataset], least_strain: float = ENOUGH_STRAIN
) -> tuple[dict[str, xarray.Dataset], dict[str, str]]:
    """Select the runs that end in a critical state; returns (name -> run, name -> reason why a run is left out).

    A run is left out if its end is not critical (`why_not_critical`). Predictions of the model are also left out if
    other runs are simulations. `runs`: name -> run opened with labkit.open_run. Raises InputError if no run is left.
    """
    left_out = {name: reason for name, run in runs.items() if (reason := why_not_critical(run, least_strain))}
    tests = {name: run for name, run in runs.items() if name not in left_out}
    if any(run.attrs.get("engine") != "model" for run in tests.values()):
        predicted = [name for name, run in tests.items() if run.attrs.get("engine") == "model"]
        left_out |= dict.fromkeys(predicted, "prediction of the model, not a simulation")
    tests = {name: run for name, run in tests.items() if name not in left_out}
    if not tests:
        shear = any(is_shear(run) for run in runs.values())
        problem = "none of these runs reaches a critical state" if shear else "none of these runs is a shear test"
        reasons = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise InputError(f"{problem}: give complete runs of cv, cr, cp or another shear path ({reasons})")
    return tests, left_out


def at_end(strain: np.ndarray, window: float = WINDOW) -> np.ndarray:
    """Select the records treated as critical, in the last quarter of the strain; shape (time,) of bool.

    Args:
        strain: Strain of a test in compression, extension or shear, (time,).
        window: Fraction of the strain to use instead of the last quarter.
    """
    return np.abs(strain) >= (1.0 - window) * np.abs(strain[-1])


def mean_strengths(runs: Mapping[str, xarray.Dataset], states: pandas.DataFrame) -> list[str]:
    """Report the mean M in compression, in extension and on each path that is not triaxial, one line each.

    For the paper's soil, the lines also give the paper's M. `states`: the table `critical_states` of these runs.
    """
    kinds = [_kind(run) for run in runs.values()]
    lines = []
    paper = " (paper: 0.92)" if all(run.lab.scene.of_the_paper for run in runs.values()) else ""
    for kind in dict.fromkeys(kinds):
        M = states["M"][[each == kind for each in kinds]]
        which = "all runs" if len(set(kinds)) == 1 else f"the runs of {kind}"
        scatter = f" +- {M.std():.3f} between tests" if len(M) > 1 else ""
        lines.append(f"mean M of {which}: {M.mean():.3f}{scatter}" + paper * (kind == COMPRESSION))
    return lines


def _kind(run: xarray.Dataset) -> str:
    if not run.lab.axisymmetric:
        return str(run.attrs["path"])
    return COMPRESSION if float(run["axial_strain"][-1]) > 0.0 else "triaxial extension"


def critical_states(runs: Mapping[str, xarray.Dataset], window: float = WINDOW) -> pandas.DataFrame:
    """Return a table with a row per shear test: means over the last quarter of the strain, and if it is stationary.

    `specimen` numbers the specimens: tests have the same number if their specimens have the same material, recipe and
    seed. M = q/p; its scatter is the standard deviation over the records. `critical` is `yes` if e, q/p and p are shown
    to be stationary, else it says which of them drifts, or is not resolved; `M_slope`, `e_slope` and `p_slope` are the
    changes per 10 % strain divided by the mean, and the columns `_within` are the half-widths of their 95 % intervals.
    If a test is not axisymmetric, q is the invariant
    sqrt(3/2 s:s), and A_zz, F_zz and Ft_zz are the components along the stress deviator s, which equal the zz
    components in triaxial compression. All runs are used; `require_critical` selects long shear tests.

    Args:
        runs: Name -> labkit.Run, or Dataset of labkit.open_run.
        window: Fraction of the strain to use instead of the last quarter.
    """
    rows, specimens = [], dict[object, int]()
    for name, run in datasets_of(runs).items():
        strain = run.lab.strain().values
        last = at_end(strain, window)
        ratio, pressure = run.lab.stress_ratio().values[last], run.lab.mean_stress().values[last]
        ends = {"e": run["void_ratio"].values[last], "M": ratio, "p": pressure}
        mean = {label: float(run[key].values[last].mean()) for key, label in SCALARS.items()}
        zz = {label: float(run.lab.component(key).values[last].mean()) for key, label in TENSORS.items()}
        rows.append(
            {
                "run": name,
                "path": run.attrs["path"],
                "specimen": specimens.setdefault(_specimen(name, run), len(specimens) + 1),
                "strain": float(strain[-1]),
                "M": float(np.mean(ratio)),
                "M_scatter": float(np.std(ratio)),
                "p_MPa": float(pressure.mean() / 1e6),
                **mean,
                **zz,
                **_stationarity(np.abs(strain[last]), ends),
            }
        )
    return pandas.DataFrame(rows)


def _specimen(name: str, run: xarray.Dataset) -> object:
    """Return what tests of the same specimen have in common; the name of a run whose file does not say it."""
    return tuple(map(run.attrs.get, ("scene", "recipe", "seed"))) if run.attrs.get("recipe") else name


def _stationarity(strain: np.ndarray, quantities: Mapping[str, np.ndarray]) -> dict[str, object]:
    """Return the verdict on the records of a window and the relative slopes of its quantities, as columns."""
    slopes = {name: slope(strain, values) for name, values in quantities.items()}
    words = {
        verdict: [name.replace("M", "q/p") for name, trend in slopes.items() if trend.verdict == verdict]
        for verdict in ("drifts", "not resolved")
    }
    said = "; ".join(f"{', '.join(names)} {verdict}" for verdict, names in words.items() if names)
    columns: dict[str, object] = {"critical": said or "yes"}
    for name, trend in slopes.items():
        size = abs(trend.mean) or np.nan
        columns |= {f"{name}_slope": trend.value / size, f"{name}_within": trend.within / size}
    return columns


ATMOSPHERE = 100e3  # Pa, pressure to which a critical-state line refers
EXPONENT = 0.7  # of p in the line of Li and Wang (1998)


@dataclasses.dataclass(frozen=True, eq=False)
class CriticalLine:
    """The critical-state line e_c = e_0 - slope (p/100 kPa)**exponent (Li and Wang 1998).

    With exponent 0 it is e_c = e_0 - slope ln(p/100 kPa).

    Args:
        e_0: Void ratio at p = 0, or at 100 kPa if the exponent is 0.
        slope: Fall of the void ratio, positive.
        exponent: Exponent of p.
        scatter: Standard deviation of the void ratios about the line; NaN for two tests.
        pressures: Least and largest p of the tests, Pa.
        tests: Number of tests.
        specimens: Number of specimens of these tests.
        covariance: Covariance of e_0 and of the slope, divided by the square of the scatter, (2, 2).
    """

    e_0: float
    slope: float
    exponent: float
    scatter: float
    pressures: tuple[float, float]
    tests: int
    specimens: int
    covariance: np.ndarray = dataclasses.field(repr=False)

    def void_ratio(self, p: ArrayLike) -> np.ndarray:
        """Return the critical void ratio at the mean stress p, Pa."""
        return self.e_0 - self.slope * _of_pressure(p, self.exponent)

    def within(self, p: ArrayLike) -> np.ndarray:
        """Return the half-width of the 95 % interval of e_c at the mean stress p, Pa; NaN for two tests.

        The tests count as independent: the scatter between specimens is in the interval as far as they have several.
        """
        if self.tests < 3:
            return np.full(np.shape(p), np.nan)
        at = np.stack([np.ones(np.shape(p)), -_of_pressure(p, self.exponent)], axis=-1)
        error = self.scatter * np.sqrt(np.einsum("...i,ij,...j", at, self.covariance, at))
        return stats.t.ppf(0.5 + 0.5 * CONFIDENCE, self.tests - 2) * error

    def state_parameter(self, e: ArrayLike, p: ArrayLike) -> np.ndarray:
        """Return the state parameter psi = e - e_c(p) (Been and Jefferies 1985): positive if looser than critical."""
        return np.asarray(e, dtype=float) - self.void_ratio(p)

    def __str__(self) -> str:
        """Return the equation of the line and the number of tests and specimens."""
        term = "ln(p/100 kPa)" if self.exponent == 0.0 else f"(p/100 kPa)^{self.exponent:g}"
        several = f"{self.specimens} specimen" + "s" * (self.specimens > 1)
        return f"e_c = {self.e_0:.4g} - {self.slope:.3g} {term}, {self.tests} tests of {several}"


def _of_pressure(p: ArrayLike, exponent: float) -> np.ndarray:
    ratio = np.asarray(p, dtype=float) / ATMOSPHERE
    return np.log(ratio) if exponent == 0.0 else ratio**exponent


def critical_line(states: pandas.DataFrame, exponent: float = EXPONENT) -> CriticalLine:
    """Fit the critical-state line to a table of `critical_states`; only rows that are critical should be given.

    Raises InputError for fewer than two different pressures.

    Args:
        states: Rows with the columns p_MPa and e and, if there are several tests of a specimen, `specimen`.
        exponent: Exponent of p; 0 for a line in ln p.
    """
    require_type(states, pandas.DataFrame, "states", "labkit.critical_states(runs)")
    exponent = Parameter("exponent", low=0.0, high=2.0).read(exponent)
    if len(states) < 2:
        raise InputError(f"a critical-state line needs two tests or more, and the table has {len(states)}: give more")
    if missing := {"p_MPa", "e"} - set(states):
        raise InputError(f"the table has no column {min(missing)}: give the result of labkit.critical_states")
    p, e = (pandas.to_numeric(states[name], "coerce").to_numpy(dtype=float) for name in ("p_MPa", "e"))
    p = 1e6 * p
    if not (np.isfinite(e) & np.isfinite(p) & (p > 0.0)).all():
        raise InputError("a critical-state line needs tests with a positive p: leave out those without one")
    if p.max() < LEAST_RANGE * p.min():
        problem = f"a critical-state line needs tests whose p differs by a factor of {LEAST_RANGE:g}"
        raise InputError(f"{problem}: give tests at other pressures")
    design = np.column_stack([np.ones(len(p)), -_of_pressure(p, exponent)])
    (e_0, fall), *_ = np.linalg.lstsq(design, e)
    freedom = len(p) - 2
    scatter = float(np.sqrt(np.sum((e - design @ (e_0, fall)) ** 2) / freedom)) if freedom else float("nan")
    specimens = states["specimen"].nunique() if "specimen" in states else len(p)
    covariance = np.linalg.inv(design.T @ design)
    pressures = (float(p.min()), float(p.max()))
    return CriticalLine(float(e_0), float(fall), exponent, scatter, pressures, len(p), specimens, covariance)


def line_of(states: pandas.DataFrame) -> tuple[CriticalLine, str] | None:
    """Return the line through the critical rows of a table, or through all rows if they are too few, and its label."""
    of_critical = states[states["critical"] == "yes"]
    for rows, words in ((of_critical, "critical-state line"), (states, "line through ends not shown to be critical")):
        with contextlib.suppress(InputError):
            line = critical_line(rows)
            return line, f"{words}: {line}"
    return None


def verdicts(states: pandas.DataFrame) -> list[str]:
    """Say for each test of a table `critical_states` whether its end is shown to be critical."""
    critical = states["critical"] == "yes"
    lines = [
        f"{row.run}: the end is not shown to be critical ({row.critical})" for row in states[~critical].itertuples()
    ]
    shown = ", ".join(states["run"][critical])
    return [f"shown to be critical: {shown or 'none'}", *lines]
