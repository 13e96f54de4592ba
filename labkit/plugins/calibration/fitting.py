"""Calibration of the model with run files: critical state lines and evolution equations, by least squares.

There are two steps. `critical_fit` fits the lines Z^c(e), Lambda^c(e) and the norms |A^c|, |F^c|, |F^tc| to the ends of
shear tests. `fit` then drives the model with the recorded strain of each run, from an initial state that is also
fitted, and fits Z, Lambda, A_zz, F_zz and F^t_zz of all runs simultaneously; it also refines the critical state
parameters. Stresses are not fitted, because C0 follows from these five variables. scipy does the optimisation.

Standard errors come from the Jacobian at the solution and from the misfit of each variable, assuming that misfits of
different records are independent. This holds for synthetic runs. In simulations the fluctuations within one test are
correlated and the equations are not exact, so the actual errors are larger. To account for the correlation, the number
of records is divided by the correlation length of the misfit.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas
import scipy.optimize
import xarray

from labkit.errors import InputError
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.model.equations import critical_coordination_number, critical_force
from labkit.model.parameters import TABLE_2, Model, Parameters
from labkit.parameters import Values
from labkit.paths.registry import PATHS
from labkit.plugins.calibration.observation import Observation, observe, require_usable
from labkit.plugins.calibration.residuals import AXIS, NATURAL, Residuals, is_exponent, parameter_value
from labkit.results.critical import ENOUGH_STRAIN, at_end, is_shear
from labkit.results.dataset import datasets_of
from labkit.sff.c0 import c0_stress

SHORT = ("Z", "Lambda", "A_zz", "F_zz", "Ft_zz")
CRITICAL = ("e_cmax", "c_cZ", "gamma_cZ", "c_cLam", "A_c", "F_c", "Ft_c")
DETERMINED = 0.5  # largest standard error of a parameter that the data determine, divided by its fitted value
CORRELATED = 0.95
AMENDMENT = ("c_dLam",)  # constants of Model that are not in Table 2, fitted if the model has them
COLUMNS = ("parameter", "fitted", "standard_error", "low", "high", "table_2", "determined")


def critical_fit(observations: Iterable[Observation], model: Model = TABLE_2) -> dict[str, float]:
    """Fit the seven critical state parameters to the ends of shear tests: name -> value.

    The fit uses means over the last quarter of the strain of CV, CR and CP tests to 15 % axial strain or more. e_cmax,
    c_cZ, gamma_cZ and c_cLambda follow from a simultaneous fit of both lines. Parameters that these tests cannot
    determine, because their void ratios are too few or too similar, keep the values of the model. Raises InputError if
    none of the runs is such a test.
    """
    ends = [
        (o.e[end].mean(), *o.values[end].mean(axis=0))
        for o in observations
        if o.path in PATHS and PATHS[o.path].shear and abs(o.strain_step[:, 2].sum()) >= ENOUGH_STRAIN
        for end in [at_end(np.concatenate([[0.0], np.cumsum(o.strain_step[:, 2])]))]
    ]
    if not ends:
        raise InputError(
            f"none of the runs is a shear test (cv, cr, cp, ...) that reaches {ENOUGH_STRAIN:.0%} axial strain: "
            "the critical state needs at least one; give more runs"
        )
    e, Z, Lam, A, F, Ft = np.array(ends).T
    norms = {name: float(np.mean(np.abs(zz))) * np.sqrt(1.5) for name, zz in zip(CRITICAL[4:], (A, F, Ft), strict=True)}
    p = model.parameters
    values = {"e_cmax": p.e_cmax, "c_cZ": p.c_cZ, "gamma_cZ": p.gamma_cZ, "c_cLam": p.c_cLam}
    if np.ptp(e) > 0.02:
        free = ("e_cmax", "c_cZ", "c_cLam", "gamma_cZ")[: 4 if len(e) >= 3 else 3]
        start = np.log([values[name] for name in free])

        def misfit(logarithms: np.ndarray) -> np.ndarray:
            trial = model.constants._replace(**values | dict(zip(free, np.exp(logarithms), strict=True)))
            lines = critical_coordination_number(e, trial) - Z, critical_force(e, trial) - Lam
            prior = 0.1 * (logarithms - start)  # keeps a line through few points near the model's line
            return np.concatenate([lines[0] / NATURAL[0], lines[1] / NATURAL[1], prior])

        solved = scipy.optimize.least_squares(misfit, start)
        values |= dict(zip(free, np.exp(solved.x).tolist(), strict=True))
    return {**values, **norms}


@dataclasses.dataclass(frozen=True, eq=False)
class Fit:
    """A calibration: the `model` with the fitted parameters, and tables that describe the fit.

    Exponents (gamma, beta) are fitted directly, the other parameters as logarithms.

    Args:
        model: The model with the fitted parameters.
        table: A pandas.DataFrame with the columns parameter, fitted, standard_error, low, high, table_2, determined;
            low and high bound the 95 % interval. A parameter is determined if its standard error is less than half
            its fitted value.
        correlation: Correlation matrix of the parameters, a pandas.DataFrame.
        misfit: RMS misfit per run and variable, of p (relative) and of q/p, both computed from C0, a pandas.DataFrame.
        warnings: Sentences about the fit.
        predicted: Predicted statistics, name of the run -> (n, 5).
    """

    model: Model
    table: pandas.DataFrame
    correlation: pandas.DataFrame
    misfit: pandas.DataFrame
    warnings: list[str]
    predicted: dict[str, np.ndarray]

    def __str__(self) -> str:
        return self.report()

    def report(self) -> str:
        """Return the whole calibration report as text."""
        pairs = _strongest(self.correlation, 8)
        lines = [
            self.table.drop(columns=["standard_error"]).to_string(index=False, float_format="%.4g"),
            "",
            "strongest correlations: " + "; ".join(pairs),
            "",
            "misfit, RMS (of p relative to p; the model follows the strain of the runs, and with it their volume):",
            self.misfit.to_string(index=False, float_format="%.3g"),
            "",
            *(f"warning: {warning}" for warning in self.warnings),
        ]
        return "\n".join(lines).rstrip()


FEW_RUNS = 6
ENOUGH = (
    "even intervals that look narrow may be wrong; give shear tests at several void ratios and pressures, isotropic "
    "compression and dilation, with a few thousand grains each"
)


KINDS = ("shear at constant volume", "drained shear", "isotropic compression", "isotropic dilation")


def _kind(run: xarray.Dataset) -> str:
    """Return the entry of KINDS for a run; without shear, the sign of the volume change decides."""
    if is_shear(run):
        return KINDS[0 if run.lab.is_undrained else 1]
    return KINDS[2 if float(run.lab.volumetric_strain()[-1]) > 0.0 else 3]


def calibrate(runs: Mapping[str, object], model: Model = TABLE_2) -> Fit:
    """Fit the parameters of the model to runs; returns a Fit.

    Predictions of the model, measured tests, unfinished runs and runs that are not axisymmetric are left out, each with
    a warning. Raises InputError if no run is left.

    Args:
        runs: Name -> labkit.Run, or Dataset of labkit.open_run.
        model: Initial values; E becomes that of the grains.
    """
    usable, left_out = require_usable(datasets_of(runs))
    result = fit([observe(name, run) for name, run in usable.items()], model)
    warnings = [f"left out: {name}: {reason}" for name, reason in left_out.items()]
    if len(usable) < FEW_RUNS:
        warnings.append(f"{len(usable)} runs: {ENOUGH}")
    kinds = {_kind(run) for run in usable.values()}
    if missing := [kind for kind in KINDS if kind not in kinds]:
        warnings.append(
            f"no test of {', '.join(missing)}: do not trust the model there, whatever the intervals; add one"
        )
    return dataclasses.replace(result, warnings=[*warnings, *result.warnings])


def fit(observations: Iterable[Observation], model: Model = TABLE_2) -> Fit:
    """Fit the parameters of Table 2 to the observations of several runs; returns a Fit.

    Each run adds five unknowns, its initial Z, Lambda, A_zz, F_zz and F^t_zz, since the first record is as noisy as the
    others. The first pass weights the variables by NATURAL, the second by their misfit over all runs. Parameters on
    which no record depends keep the values of the model. Raises InputError without observations, and for grains with
    different Young's moduli.

    Args:
        observations: One per run.
        model: Initial values; E becomes that of the grains.
    """
    observations = list(observations)
    if not observations:
        raise InputError("calibration needs at least one run: give run files")
    names = tuple(field.name for field in dataclasses.fields(Parameters)) + (AMENDMENT if model.c_dLam > 0.0 else ())
    moduli = {o.young_modulus: o.name for o in observations}
    if len(moduli) > 1:
        different = ", ".join(f"{modulus:g} Pa in {name}" for modulus, name in moduli.items())
        raise InputError(f"the grains have different Young's moduli ({different}): give runs with one")
    model = dataclasses.replace(model, young_modulus=observations[0].young_modulus)
    model = model.reading(beyond_e_cmax="flat")  # a trial e_cmax may lie below a recorded void ratio
    initial = dataclasses.asdict(model.parameters) | {name: getattr(model, name) for name in AMENDMENT}
    try:
        initial |= critical_fit(observations, model)
    except InputError:
        pass  # without the end of a shear test the fit starts at the critical state of the model
    problem = Residuals(observations, model, names, initial)
    free, untouched = problem.sensitive()
    problem = dataclasses.replace(problem, names=free)
    weight = NATURAL
    x = problem.start()
    for _ in range(2):
        solved = problem.solve(x, weight)
        x = solved.x
        weight = np.maximum(np.sqrt(np.mean(problem.misfit(x) ** 2, axis=0)), 1e-3 * NATURAL)
    return _judge(problem, solved, x, weight, untouched)


def _interval(name: str, initial: float, u: float, s: float) -> tuple[float, float, float]:
    """Return standard error and 95 % interval (low, high) of a parameter from the standard error s of its unknown u."""
    slope = initial if is_exponent(name) else parameter_value(name, initial, u)
    return slope * s, parameter_value(name, initial, u - 1.96 * s), parameter_value(name, initial, u + 1.96 * s)


def _judge(problem: Residuals, solved: Any, x: np.ndarray, weight: np.ndarray, untouched: tuple[str, ...]) -> Fit:
    """Return the Fit of a solved problem, with standard errors, correlations and warnings."""
    n = len(problem.names)
    r = problem.residuals(x, weight)
    J = problem.jacobian(x, weight) / np.sqrt(_correlation_lengths(problem, r))[:, None]
    covariance = np.linalg.pinv(J.T @ J, rcond=1e-14)[:n, :n] * r.size / max(r.size - x.size, 1)
    error = np.sqrt(np.diag(covariance))
    values, initial = problem.values(x), problem.initial
    table_2 = dataclasses.asdict(Parameters()) | dict.fromkeys(AMENDMENT, 0.0)
    bounds = {
        name: _interval(name, initial[name], u, s) for name, u, s in zip(problem.names, x[:n], error, strict=True)
    }
    relative = {name: bounds[name][0] / values[name] if values[name] > 0.0 else np.inf for name in problem.names}
    determined = {name for name, s in relative.items() if s < DETERMINED}
    bounds |= {name: (np.nan, np.nan, np.nan) for name in untouched}
    rows = [(name, values[name], *bounds[name], table_2[name], name in determined) for name in bounds]
    order = list(table_2)
    table = pandas.DataFrame(sorted(rows, key=lambda row: order.index(row[0])), columns=COLUMNS)
    correlation = pandas.DataFrame(covariance / np.outer(error, error), index=problem.names, columns=problem.names)
    warnings = []
    if untouched:
        warnings.append("no record of these runs depends on " + ", ".join(untouched) + ": not fitted")
    loose = [f"{name} ({s:.0%})" for name, s in relative.items() if name not in determined]
    if loose:
        warnings.append("not determined by these runs (standard error over fitted value): " + ", ".join(loose))
    together = _strongest(correlation, 99, CORRELATED)
    if together:
        warnings.append("hardly distinguishable with these runs (correlation): " + "; ".join(together))
    if not solved.success:
        warnings.append(f"the fit stopped before it converged ({solved.message})")
    rms = pandas.DataFrame(problem.misfit(x), columns=SHORT)
    predicted = {o.name: problem.predictions(x, k) for k, o in enumerate(problem.observations)}
    both = [(p_and_ratio(o, o.values), p_and_ratio(o, predicted[o.name])) for o in problem.observations]
    rms["p"] = [float(np.sqrt(np.mean((fitted[0] / p - 1.0) ** 2))) for (p, _), fitted in both]
    rms["q/p"] = [float(np.sqrt(np.mean((fitted[1] - ratio) ** 2))) for (_, ratio), fitted in both]
    rms.insert(0, "run", [o.name for o in problem.observations])
    amended: Values = {name: values.pop(name) for name in AMENDMENT}
    fitted = dataclasses.replace(problem.model, parameters=Parameters(**values), **amended)
    return Fit(fitted, table, correlation, rms, warnings, predicted)


def p_and_ratio(observation: Observation, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return p/E and q/p of C0 at each record, (n,), for the statistics `values` (n, 5)."""
    A, F, Ft = (values[:, k, None, None] * AXIS for k in (2, 3, 4))
    stress = c0_stress(1.0, values[:, 0], values[:, 1], observation.e, A, F, Ft)
    return mean_stress(stress), deviatoric_stress(stress) / mean_stress(stress)


def _correlation_lengths(problem: Residuals, residuals: np.ndarray) -> np.ndarray:
    """Return the correlation length of each residual, in records: one length per variable and run, 1 for the prior."""
    lengths, first = [], 0
    for o in problem.observations:
        block = residuals[first : first + o.values.size].reshape(o.values.shape)
        first += o.values.size
        lengths.append(np.tile([_correlation_length(block[:, k]) for k in range(5)], len(block)))
    return np.concatenate([*lengths, np.ones(len(problem.names))])


def _correlation_length(series: np.ndarray) -> float:
    """Return 1 + 2 sum of the autocorrelation up to its first value below the noise level of independent records."""
    n = len(series)
    size = float(series @ series)
    length = 1.0
    for lag in range(1, n // 2):
        rho = float(series[lag:] @ series[:-lag]) / size if size > 0.0 else 0.0
        if rho < 2.0 / np.sqrt(n):
            break
        length += 2.0 * rho
    return length


def _strongest(correlation: pandas.DataFrame, most: int, least: float = 0.5) -> list[str]:
    """Describe at most `most` pairs of parameters with a correlation above `least`, strongest first."""
    values = correlation.to_numpy()
    pairs = [
        (abs(values[i, j]), f"{correlation.index[i]} and {correlation.index[j]} ({values[i, j]:+.2f})")
        for i in range(len(values))
        for j in range(i)
    ]
    return [text for size, text in sorted(pairs, reverse=True)[:most] if size > least]
