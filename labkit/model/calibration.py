"""Parameters of the model from run files: the critical state lines and the evolution equations, by least squares.

Two steps. `critical_fit` takes the ends of shear tests and fits the lines Z^c(e), Lambda^c(e) and the three norms.
`fit` then lets the model follow the strain that each run recorded, from a start of its own, and makes
Z, Lambda, A_zz, F_zz, F^t_zz of all runs agree at once; it refines the critical state too. Stresses are not fitted:
they are C0 of these five. scipy does the optimising.

Standard errors come from the Jacobian at the solution and from the misfit of each variable, on the
assumption that misfits are independent from record to record. In synthetic runs they are. In simulations the records
of one test fluctuate together and the equations are not exactly true, so that real errors are larger: the number of
records is divided by the correlation length of the misfit (`thinning`), which takes the first effect into account.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas
import scipy.optimize

from labkit.dem.paths import PATHS
from labkit.errors import InputError
from labkit.model.adaptive import advance
from labkit.model.compiled import compiled
from labkit.model.equations import critical_coordination_number, critical_force
from labkit.model.observation import Observation, observe
from labkit.model.parameters import Model, Parameters
from labkit.model.rates import FINE, SIZE, Control
from labkit.model.tensors import to_six
from labkit.runs.critical import at_end

SHORT = ("Z", "Lambda", "A_zz", "F_zz", "Ft_zz")
NATURAL = np.array([0.1, 5e-4, 0.05, 0.05, 0.005])  # misfits with which the first fit weighs the variables
CRITICAL = ("e_cmax", "c_cZ", "gamma_cZ", "c_cLam", "A_c", "F_c", "Ft_c")
AXIS = np.diag([-0.5, -0.5, 1.0])
TOLERANCE = 1e-7  # of the integration, well below what the finite differences of the Jacobian resolve
PRIOR = 3.0  # width of a weak prior on the unknown of a parameter: keeps what is not determined within reason
MOST_EVALUATIONS = 100
DETERMINED = 0.5  # relative standard error from which the data do not determine a parameter
CORRELATED = 0.95
ENOUGH_STRAIN = 0.15  # axial, from which the end of a shear test counts as critical


def critical_fit(observations: Sequence[Observation], model: Model = Model()) -> dict[str, float]:
    """The seven critical state parameters from the ends of shear tests: name -> value.

    Means over the last quarter of the strain of CV, CR and CP tests that went to 15 % or more. e_cmax, c_cZ,
    gamma_cZ and c_cLambda follow from both lines at once. Parameters that these tests do not determine, too few or too
    similar void ratios, keep the model's value. Raises InputError without such a test.
    """
    ends = [
        (o.e[end].mean(), *o.values[end].mean(axis=0))
        for o in observations
        if o.path in PATHS and PATHS[o.path].shear and abs(o.strain_step[:, 2].sum()) >= ENOUGH_STRAIN
        for end in [at_end(np.concatenate([[0.0], np.cumsum(o.strain_step[:, 2])]))]
    ]
    if not ends:
        raise InputError(
            f"no shear test (cv, cr, cp, ...) among the runs goes to {ENOUGH_STRAIN:.0%} axial strain: "
            "the critical state needs one, give more runs"
        )
    e, Z, Lam, A, F, Ft = np.array(ends).T
    norms = {name: abs(float(np.mean(zz))) * np.sqrt(1.5) for name, zz in zip(CRITICAL[4:], (A, F, Ft), strict=True)}
    p = model.parameters
    found = {"e_cmax": p.e_cmax, "c_cZ": p.c_cZ, "gamma_cZ": p.gamma_cZ, "c_cLam": p.c_cLam}
    if np.ptp(e) > 0.02:
        free = ("e_cmax", "c_cZ", "c_cLam", "gamma_cZ")[: 4 if len(e) >= 3 else 3]

        def misfit(logarithms):
            v = model.constants._replace(**found | dict(zip(free, np.exp(logarithms), strict=True)))
            lines = critical_coordination_number(e, v) - Z, critical_force(e, v) - Lam
            prior = 0.1 * (logarithms - start)  # a line through few points stays near Table 2
            return np.concatenate([lines[0] / NATURAL[0], lines[1] / NATURAL[1], prior])

        start = np.log([found[name] for name in free])
        solved = scipy.optimize.least_squares(misfit, start)
        found |= dict(zip(free, np.exp(solved.x).tolist(), strict=True))
    return {**found, **norms}


@dataclasses.dataclass(frozen=True)
class Fit:
    """A calibration: `model` with the fitted parameters, `table` (pandas: parameter, fitted, standard_error, low, high,
    table_2, determined), `correlation` (pandas), `misfit` (pandas: RMS per run and variable), `warnings`, `predicted`.

    low and high bound the 95 % interval. Exponents (gamma, beta) are fitted as they are, the others as logarithms.
    """

    model: Model
    table: pandas.DataFrame
    correlation: pandas.DataFrame
    misfit: pandas.DataFrame
    warnings: list[str]
    predicted: dict[str, np.ndarray]  # name of the run -> (n, 5)

    def report(self) -> str:
        """All of it as text."""
        shown = self.table.drop(columns=["low", "high"])
        pairs = _strongest(self.correlation, 8)
        lines = [
            shown.to_string(index=False, float_format="%.4g"),
            "",
            "strongest correlations: " + "; ".join(pairs),
            "",
            "misfit, RMS:",
            self.misfit.to_string(index=False, float_format="%.3g"),
            "",
            *(f"warning: {warning}" for warning in self.warnings),
        ]
        return "\n".join(lines).rstrip()


def calibrate(runs: Mapping[str, Any], model: Model = Model()) -> Fit:
    """The parameters of the model that follow runs best, name -> labkit.Run or Dataset of labkit.open_run; a Fit."""
    return fit([observe(name, getattr(run, "data", run)) for name, run in runs.items()], model)


def fit(
    observations: Sequence[Observation],
    model: Model = Model(),
    names: Sequence[str] | None = None,
    thinning: bool = True,
) -> Fit:
    """Fits `names` (default: all of Table 2) to the observations of several runs at once; a Fit.

    Each run has five more unknowns, its start (Z, Lambda, A_zz, F_zz,
    F^t_zz), since the first record is as noisy as any. Two passes: NATURAL weighs the variables in the first, their
    misfit over all runs in the second. Parameters on which no record depends keep the model's value. Raises InputError.
    """
    if not observations:
        raise InputError("there are no runs to calibrate with: give run files")
    names = tuple(field.name for field in dataclasses.fields(Parameters)) if names is None else tuple(names)
    model = model.reading(beyond_e_cmax="flat")  # a trial e_cmax may lie below a void ratio that was seen
    begin = dataclasses.asdict(model.parameters)
    try:
        begin |= {k: v for k, v in critical_fit(observations, model).items() if k in names}
    except InputError:
        pass  # no end of a shear test: the fit starts at the model's critical state
    problem = _Problem(observations, model, names, begin)
    free, untouched = problem.sensitive()
    problem = dataclasses.replace(problem, names=free)
    weight = NATURAL
    x = problem.start()
    for _ in range(2):
        solved = problem.solve(x, weight)
        x = solved.x
        weight = np.maximum(np.sqrt(np.mean(problem.misfit(x) ** 2, axis=0)), 1e-3 * NATURAL)
    return _judge(problem, solved, x, weight, untouched, model, thinning)


def _exponent(name):
    return name.startswith(("gamma", "beta"))


def _value(name, begin, u):
    """The parameter at its unknown u: begin exp(u); for an exponent, which may be zero, begin (1 + u)."""
    if _exponent(name):
        return float(max(begin * (1.0 + u), 0.0))
    return float(begin * np.exp(np.clip(u, -20.0, 20.0)))


def _interval(name, begin, u, s):
    """(standard error, low, high) of a parameter, the last two of 95 %, from the standard error s of its unknown."""
    slope = begin if _exponent(name) else _value(name, begin, u)
    return slope * s, _value(name, begin, u - 1.96 * s), _value(name, begin, u + 1.96 * s)


@dataclasses.dataclass(frozen=True)
class _Problem:
    """The unknowns are one number per parameter, zero at its first value (`_value`), then five per run, in NATURAL."""

    observations: list
    model: Model
    names: tuple
    begin: dict

    def start(self):
        return np.zeros(len(self.names) + 5 * len(self.observations))

    def values(self, x):
        """name -> value of every parameter at the unknowns x."""
        return self.begin | {name: _value(name, self.begin[name], u) for name, u in zip(self.names, x, strict=False)}

    def constants(self, x):
        return self.model.constants._replace(**self.values(x))

    def predicted(self, x, k, constants=None):
        """(n, 5) of run k."""
        o, n = self.observations[k], len(self.names)
        offset = x[n + 5 * k : n + 5 * (k + 1)] * NATURAL
        first = o.values[0] + offset
        first[:2] = np.maximum(first[:2], (1.0, 1e-6))
        return _follow(o, first, constants or self.constants(x))

    def residuals(self, x, weight):
        constants = self.constants(x)
        blocks = [
            ((self.predicted(x, k, constants) - o.values) / weight).ravel() for k, o in enumerate(self.observations)
        ]
        return np.concatenate([*blocks, x[: len(self.names)] / PRIOR])

    def jacobian(self, x, weight):
        """Forward differences; the start of a run moves that run alone."""
        n, step = len(self.names), 1e-4
        base = [self.predicted(x, k) for k in range(len(self.observations))]
        sizes = [b.size for b in base]
        rows = np.concatenate([[0], np.cumsum(sizes)])
        J = np.zeros((rows[-1] + n, x.size))
        J[rows[-1] :, :n] = np.eye(n) / PRIOR
        for j in range(x.size):
            moved = x.copy()
            moved[j] += step
            constants = self.constants(moved)
            runs = range(len(base)) if j < n else [(j - n) // 5]
            for k in runs:
                change = (self.predicted(moved, k, constants) - base[k]) / (step * weight)
                J[rows[k] : rows[k + 1], j] = change.ravel()
        return J

    def solve(self, x, weight):
        return scipy.optimize.least_squares(
            self.residuals,
            x,
            self.jacobian,
            method="lm",
            args=(weight,),
            x_scale="jac",
            xtol=1e-5,
            ftol=1e-6,
            max_nfev=MOST_EVALUATIONS,
        )

    def misfit(self, x):
        """RMS (runs, 5)."""
        return np.array(
            [np.sqrt(np.mean((self.predicted(x, k) - o.values) ** 2, axis=0)) for k, o in enumerate(self.observations)]
        )

    def sensitive(self):
        """(names that some record depends on, the others)."""
        n = len(self.names)
        J = self.jacobian(self.start(), NATURAL)[:-n, :n]
        size = np.sqrt((J**2).sum(axis=0))
        free = tuple(
            name for name, s in zip(self.names, size, strict=False) if s > 1.0 / PRIOR and self.begin[name] > 0.0
        )
        return free, tuple(name for name in self.names if name not in free)


def _judge(problem, solved, x, weight, untouched, model, thinning):
    """Standard errors, correlations and warnings of a solved problem."""
    n = len(problem.names)
    J, r = problem.jacobian(x, weight), problem.residuals(x, weight)
    if thinning:
        J = J / np.sqrt(_correlation_lengths(problem, r))[:, None]
    covariance = np.linalg.pinv(J.T @ J, rcond=1e-14)[:n, :n] * r.size / max(r.size - x.size, 1)
    error = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(error, error)
    values, begin = problem.values(x), problem.begin
    table_2 = dataclasses.asdict(Parameters())
    bounds = {name: _interval(name, begin[name], u, s) for name, u, s in zip(problem.names, x, error, strict=False)}
    bounds |= {name: (np.nan, np.nan, np.nan) for name in untouched}
    relative = {name: bounds[name][0] / max(values[name], begin[name] * _exponent(name)) for name in problem.names}
    determined = {name for name, s in relative.items() if s < DETERMINED}
    rows = [(name, values[name], *bounds[name], table_2[name], name in determined) for name in bounds]
    order = list(table_2)
    table = pandas.DataFrame(sorted(rows, key=lambda row: order.index(row[0])), columns=COLUMNS)
    warnings = []
    if untouched:
        warnings.append("no record of these runs depends on " + ", ".join(untouched) + ": not fitted")
    loose = [f"{name} ({s:.0%})" for name, s in relative.items() if name not in determined]
    if loose:
        warnings.append("not determined by these runs (standard error): " + ", ".join(loose))
    correlation = pandas.DataFrame(correlation, index=problem.names, columns=problem.names)
    together = _strongest(correlation, 99, CORRELATED)
    if together:
        warnings.append("hardly told apart by these runs (correlation): " + "; ".join(together))
    if not solved.success:
        warnings.append(f"the fit stopped before it converged ({solved.message})")
    rms = pandas.DataFrame(problem.misfit(x), columns=SHORT)
    rms.insert(0, "run", [o.name for o in problem.observations])
    predicted = {o.name: problem.predicted(x, k) for k, o in enumerate(problem.observations)}
    fitted = dataclasses.replace(model, parameters=Parameters(**values))
    return Fit(fitted, table, correlation, rms, warnings, predicted)


COLUMNS = ("parameter", "fitted", "standard_error", "low", "high", "table_2", "determined")


def _correlation_lengths(problem, residuals):
    """For each residual the integrated autocorrelation of its variable in its run, in records, at least 1."""
    lengths, first = [], 0
    for o in problem.observations:
        block = residuals[first : first + o.values.size].reshape(o.values.shape)
        first += o.values.size
        lengths.append(np.tile([_correlation_length(block[:, k]) for k in range(5)], len(block)))
    return np.concatenate([*lengths, np.ones(len(problem.names))])


def _correlation_length(series):
    """1 + 2 sum of the autocorrelation up to its first value below the noise of white records."""
    n = len(series)
    size = float(series @ series)
    length = 1.0
    for lag in range(1, n // 2):
        rho = float(series[lag:] @ series[:-lag]) / size if size > 0.0 else 0.0
        if rho < 2.0 / np.sqrt(n):
            break
        length += 2.0 * rho
    return length


def _strongest(correlation, most, least=0.5):
    values = correlation.to_numpy()
    pairs = [
        (abs(values[i, j]), f"{correlation.index[i]} and {correlation.index[j]} ({values[i, j]:+.2f})")
        for i in range(len(values))
        for j in range(i)
    ]
    return [words for size, words in sorted(pairs, reverse=True)[:most] if size > least]


def _follow(observation, first, constants):
    """The model along the strain of an observation: (n, 5), zz components."""
    y = np.zeros(SIZE)
    y[0], y[1], y[2] = observation.e[0], first[0], first[1]
    for start, zz in zip((3, 9, 15), first[2:], strict=True):
        y[start : start + 6] = to_six(zz * AXIS)
    found = np.empty((len(observation.e), SIZE))
    _follow_strain(y, observation.strain_step, constants, TOLERANCE, found)
    return found[:, (1, 2, 5, 11, 17)]


@compiled
def _follow_strain(y, strain_step, c, tolerance, found):
    """Integrates along given strain steps; where the equations end, the last state is repeated."""
    free, measure, target, x = np.zeros((6, 0)), np.zeros((0, 6)), np.zeros(0), np.zeros(0)
    found[0] = y
    step = 1e-4
    for k in range(strain_step.shape[0]):
        size = np.sqrt(np.sum(strain_step[k] ** 2))
        if size > 0.0:
            control = Control(strain_step[k] / size, free, measure, target, 0.0)
            status, step, _, _ = advance(y, size, step, control, x, c, tolerance, 10_000)
            if status != FINE:
                found[k + 1 :] = y
                return
        found[k + 1] = y
