"""Two forms, judged once on held-out seeds: F with the stiffness K(Z), and dilatancy with A:n that is not clipped."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
import pandas

from analysis.hidden_state.loading import HELD_OUT
from analysis.hidden_state.table import TRAINING, Test, deviatoric, intervals, tensor
from labkit.model import Model, Problem, Reversals, strain_control

PRINTED_K = (58.7, 3.15)  # K = 58.7 (Z - 3.15), from other packings
FIRST = 5e-4  # deviatoric strain within which the initial slope of F is measured
ENDS = 0.12  # axial strain from which compression and extension give the sizes of attractors
LEAST_VOLUME = 0.002  # least range of the volumetric strain by which its error is divided
PARTS = 4  # parts of an interval between two records in the integration of F
SHEARED = ("compression", "extension")
GROUPS = {"small": "cycles", "large": "cycles", "loops": "cycles", **dict.fromkeys(SHEARED, "monotonic")}


@dataclasses.dataclass(frozen=True)
class Constants:
    """Constants measured in the training seeds; `A_c` and `F_c` are straight lines in e, (slope, value at e = 0)."""

    A_c: np.ndarray
    F_c: np.ndarray
    M: np.ndarray
    K: tuple[float, float]

    def reversals(self) -> Reversals:
        """The constants of both forms in labkit's model."""
        (F_e, F_0), (A_e, A_0) = self.F_c, self.A_c
        return Reversals(*self.K, *(float(value) for value in (F_0, F_e, A_0, A_e)))

    def table(self) -> pandas.DataFrame:
        """A row per constant: at e = 0.6, 0.7 and 0.8, or the two numbers of K(Z)."""
        rows = [(name, *np.polyval(getattr(self, name), [0.6, 0.7, 0.8])) for name in ("A_c", "F_c", "M")]
        return pandas.DataFrame([*rows, ("K", *self.K, np.nan)], columns=["constant", "e = 0.6", "e = 0.7", "e = 0.8"])


def group_of(test: str) -> str:
    """The group in which errors are averaged."""
    return GROUPS.get(test, test)


def slopes(tests: Sequence[Test]) -> pandas.DataFrame:
    """Initial slope dF:n/d(strain) at first loading and after each reversal of `small` and `loops`, and Z there."""
    rows = []
    for test in tests:
        if test.name not in ("small", "loops"):
            continue
        for section in np.unique(test["section"]):
            inside = np.flatnonzero(test["section"] == section)
            start = inside[0] - 1 if section else 0
            end = int(np.searchsorted(test["along"], test["along"][start] + FIRST))
            if start < 0 or end > inside[-1]:
                continue
            off = deviatoric(test["strain"][end] - test["strain"][start])
            size = np.linalg.norm(off)
            slope = float((test["F"][end] - test["F"][start]) @ off / size**2)
            rows.append((test.density, test.seed, test.packing, test.name, section, test["Z"][start], slope))
    return pandas.DataFrame(rows, columns="density seed packing test section Z slope".split())


def stiffness_line(table: pandas.DataFrame) -> tuple[float, float]:
    """(k, Z_0) of K = k (Z - Z_0) by least squares."""
    k, value = np.polyfit(table["Z"], table["slope"], 1)
    return float(k), float(-value / k)


def stiffness_fit(table: pandas.DataFrame) -> pandas.DataFrame:
    """K(Z) of the training seeds with 95 % intervals (jackknife over packings), rows k and Z_0, and R2 held out."""
    own = table[table["seed"].isin(TRAINING)]
    values, packings = np.array(stiffness_line(own)), own["packing"].unique()
    left = np.array([stiffness_line(own[own["packing"] != one]) for one in packings])
    count = len(packings)
    within = 1.96 * np.sqrt((count - 1) / count * ((left - left.mean(axis=0)) ** 2).sum(axis=0))
    held = table[table["seed"].isin(HELD_OUT)]
    rows = []
    for part, of in (("training", own), ("held out", held)):
        for k, zero, form in ((*values, "fitted"), (*PRINTED_K, "printed")):
            off = of["slope"] - k * (of["Z"] - zero)
            r2 = 1.0 - (off**2).sum() / ((of["slope"] - of["slope"].mean()) ** 2).sum() if len(of) else np.nan
            rows.append((form, part, len(of), k, within[0], zero, within[1], r2))
    return pandas.DataFrame(rows, columns="form part slopes k k_within Z_0 Z_0_within R2".split())


def chosen_stiffness(fit: pandas.DataFrame) -> tuple[float, float]:
    """The printed K(Z) if both of its numbers lie inside the intervals of the fitted ones, else these."""
    own = fit.iloc[0]
    near = abs(own["k"] - PRINTED_K[0]) <= own["k_within"] and abs(own["Z_0"] - PRINTED_K[1]) <= own["Z_0_within"]
    return PRINTED_K if near else (float(own["k"]), float(own["Z_0"]))


def ends_of(tests: Sequence[Test]) -> pandas.DataFrame:
    """Means of e, |A|, |F|, |s|/p beyond ENDS in compression and extension."""
    rows = []
    for test in tests:
        if test.name in SHEARED:
            far = np.abs(test["strain"][:, 2]) >= ENDS
            p = test["stress"][far, :3].mean(axis=1)
            ratio = np.linalg.norm(deviatoric(test["stress"][far]), axis=1) / p
            sizes = (np.linalg.norm(test[name][far], axis=1).mean() for name in ("A", "F"))
            rows.append((test.density, test.seed, test.name, test["e"][far].mean(), *sizes, ratio.mean()))
    return pandas.DataFrame(rows, columns="density seed test e A F M".split())


def measured(tests: Sequence[Test], K: tuple[float, float]) -> Constants:
    """The constants from the tests of the training seeds."""
    ends = ends_of([test for test in tests if test.seed in TRAINING])
    A_c, F_c, M = (np.polyfit(ends["e"], ends[name], 1) for name in ("A", "F", "M"))
    return Constants(A_c, F_c, M, K)


Rate = Callable[[np.ndarray, np.ndarray, float, float, float], np.ndarray]


def stiff(constants: Constants, clipped_range: bool) -> Rate:
    """dF per strain: K(Z) [n - max(0, F:n)/F_c F/F_c], or without elastic range K(Z) [n - F/F_c]."""

    def rate(F: np.ndarray, n: np.ndarray, Z: float, e: float, Lam: float) -> np.ndarray:
        size = np.polyval(constants.F_c, e)
        k, zero = constants.K
        share = max(0.0, float(F @ n)) / size if clipped_range else 1.0
        return k * (Z - zero) * (n - share * F / size)

    return rate


def c3(model: Model) -> Rate:
    """C3 with the constants of a model."""
    problem = Problem(model, strain_control(np.zeros((3, 3))))

    def rate(F: np.ndarray, n: np.ndarray, Z: float, e: float, Lam: float) -> np.ndarray:
        problem.control = strain_control(tensor(n))
        return problem.rates(np.concatenate([[e, Z, Lam], np.zeros(6), F, np.zeros(12)]))[9:15]

    return rate


def followed(test: Test, rate: Rate) -> np.ndarray:
    """F (n, 6) along the recorded strain, in the measured e, Z and Lambda."""
    F = np.empty((len(test), 6))
    F[0] = test["F"][0]
    for k in range(len(test) - 1):
        off = deviatoric(test["strain"][k + 1] - test["strain"][k])
        size, now = float(np.linalg.norm(off)), F[k].copy()
        if size > 0.0:
            n = off / size
            Z, e, Lam = (0.5 * (test[name][k] + test[name][k + 1]) for name in ("Z", "e", "Lambda"))
            for _ in range(PARTS):
                now = now + size / PARTS * rate(now, n, Z, e, Lam)
        F[k + 1] = now
    return F


def errors_of_F(tests: Sequence[Test], rates: dict[str, Rate]) -> pandas.DataFrame:
    """Root mean square error of F, % of the largest |F| of a test, for each form; a row per test and form."""
    rows = []
    for test in tests:
        scale = np.linalg.norm(test["F"], axis=1).max()
        for form, rate in rates.items():
            error = np.sqrt(((followed(test, rate) - test["F"]) ** 2).sum(axis=1).mean())
            labels = (test.density, test.seed, group_of(test.name), test.name)
            rows.append((*labels, form, 100.0 * error / scale))
    return pandas.DataFrame(rows, columns="density seed group test form error".split())


CLIPPED, BOLD = "max(0, A:n)", "A:n"
FORMS = ("C4", "amended", CLIPPED, BOLD, "dilative half")
FORM_OF_F = "K(Z), elastic range"


def regressors(form: str, e: np.ndarray, Lam: np.ndarray, A_n: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Columns, linear in the constants, of D = -a (Lambda^c(e) - Lambda) times the factor of a form.

    Args:
        form: One of FORMS.
        e: Void ratios.
        Lam: Lambda.
        A_n: A:n/|A^c|.
        ratio: s:n/p less its critical value.
    """
    plain = np.column_stack([np.ones_like(e), e, Lam])
    if form == "amended":
        return np.column_stack([plain, Lam * ratio])
    factor = {CLIPPED: np.maximum(A_n, 0.0), BOLD: A_n}.get(form)
    return plain if factor is None else factor[:, None] * plain


def inputs(test: Test, pairs: Sequence[tuple[int, int]], constants: Constants) -> tuple[np.ndarray, ...]:
    """(D, size of the strain, e, Lambda, A:n/|A^c|, s:n/p - M) of pairs of records."""
    k, end = np.array(pairs).T
    step = test["strain"][end] - test["strain"][k]
    off = deviatoric(step)
    size = np.linalg.norm(off, axis=1)
    n = off / np.maximum(size, 1e-12)[:, None]
    e, Lam, A, s = (0.5 * (test[name][k] + test[name][end]) for name in ("e", "Lambda", "A", "stress"))
    A_n = np.einsum("ni,ni->n", A, n) / np.polyval(constants.A_c, e)
    ratio = np.einsum("ni,ni->n", deviatoric(s), n) / s[:, :3].mean(axis=1) - np.polyval(constants.M, e)
    return step[:, :3].sum(axis=1) / np.maximum(size, 1e-12), size, e, Lam, A_n, ratio


class Dilatancy:
    """Forms of D with constants from compression and extension of the training seeds."""

    def __init__(self, tests: Sequence[Test], constants: Constants) -> None:
        """Fit each form by linear least squares."""
        self.constants = constants
        training = [test for test in tests if test.seed in TRAINING]
        found = [inputs(test, list(intervals(test)), constants) for test in training if test.name in SHEARED]
        D, _, *columns = (np.concatenate(parts) for parts in zip(*found, strict=True))
        forms = [form for form in FORMS if form != "dilative half"]
        self.fitted = {form: np.linalg.lstsq(regressors(form, *columns), D, rcond=None)[0] for form in forms}
        groups: dict[tuple[str, str], list[np.ndarray]] = {}
        for test in training:
            if pairs := list(intervals(test)):
                groups.setdefault((test.density, group_of(test.name)), []).append(inputs(test, pairs, constants)[0])
        self.mean = {key: float(np.concatenate(values).mean()) for key, values in groups.items()}

    def predict(self, form: str, test: Test, columns: Sequence[np.ndarray]) -> np.ndarray:
        """D of a form at the rows of `inputs`."""
        if form == "a constant":
            return np.full(len(columns[0]), self.mean.get((test.density, group_of(test.name)), 0.0))
        if form == "dilative half":
            plain = regressors("C4", *columns) @ self.fitted["C4"]
            return np.where(plain < 0.0, plain * columns[2], plain)
        return regressors(form, *columns) @ self.fitted[form]

    def errors(self, tests: Sequence[Test]) -> pandas.DataFrame:
        """Errors of D and of the volumetric strain, a row per test and form.

        Columns: D (root mean square), D_std (standard deviation of D in the test), volume (root mean square over the
        range of the volumetric strain, %, which is integrated from D).
        """
        rows = []
        for test in tests:
            pairs = list(intervals(test))
            if not pairs:
                continue
            D, _, *columns = inputs(test, pairs, self.constants)
            _, size, *steps = inputs(test, [(k, k + 1) for k in range(len(test) - 1)], self.constants)
            volume = test["strain"][:, :3].sum(axis=1)
            scale = max(np.ptp(volume), LEAST_VOLUME)
            for form in (*FORMS, "a constant"):
                off = self.predict(form, test, columns) - D
                own = np.concatenate([[0.0], np.cumsum(self.predict(form, test, steps) * size)])
                error = 100.0 * np.sqrt(((own - volume + volume[0]) ** 2).mean()) / scale
                labels = (test.density, test.seed, group_of(test.name), test.name)
                rows.append((*labels, form, np.sqrt((off**2).mean()), D.std(), error))
        return pandas.DataFrame(rows, columns="density seed group test form D D_std volume".split())


def judged(errors: pandas.DataFrame, values: Sequence[str]) -> pandas.DataFrame:
    """Means of the errors over the tests of a packing, then over packings, by part, density, group and form."""
    own = errors.assign(part=np.where(errors["seed"].isin(TRAINING), "training", "held out"))
    by_packing = own.groupby(["part", "density", "group", "form", "seed"], sort=False)[list(values)].mean()
    keys = ["part", "density", "group", "form"]
    table = by_packing.groupby(keys, sort=False).agg(["mean", "min", "max"])
    table.columns = [f"{name}_{kind}".removesuffix("_mean") for name, kind in table.columns]
    table["packings"] = by_packing.groupby(keys, sort=False).size()
    return table.reset_index()


GOALS = (  # what, table, group, value over that of another form (None: the value itself), largest value
    ("F, turn 0.4 (%)", "F", "turn 0.4", FORM_OF_F, None, 15.0),
    ("F, turn 0.4, over C3 calibrated", "F", "turn 0.4", FORM_OF_F, "C3, calibrated", 1.25),
    ("volume in cycles, over C4", "volume", "cycles", BOLD, "C4", 0.5),
    ("volume, monotonic, over C4", "volume", "monotonic", BOLD, "C4", 1.05),
)


def goals(errors: pandas.DataFrame, dilatancy: pandas.DataFrame) -> pandas.DataFrame:
    """The goals of the plan on the held-out packings, a row per density and goal; `worst` is that of the packings."""
    rows = []
    for density in dict.fromkeys(errors["density"]):
        for what, table, group, form, other, largest in GOALS:
            own, value = (errors, "error") if table == "F" else (dilatancy, "volume")
            own = own[(own["density"] == density) & (own["group"] == group) & own["seed"].isin(HELD_OUT)]
            means = own.groupby(["form", "seed"])[value].mean()
            if form in means.index:
                values = means[form] if other is None else means[form] / means[other]
                rows.append((density, what, len(values), values.mean(), values.max(), largest, values.max() <= largest))
    return pandas.DataFrame(rows, columns="density goal packings mean worst largest reached".split())
