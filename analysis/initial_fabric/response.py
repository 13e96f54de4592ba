"""The CR test from each state: effects of initial fabric, and of Z at equal e and p, in grains and the model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pandas
import xarray as xr
from statsmodels.regression.linear_model import OLS

from analysis.curves import each_run
from analysis.initial_fabric.loading import ANGLES, STRAIN, specimen_of
from analysis.places import texts
from analysis.statistics import Tested, adjusted, cluster_mean, difference_of_means, paired_difference
from labkit.errors import PhysicsError
from labkit.micro import deviator
from labkit.model import Model, ModelState, Readings, drive
from labkit.paths import Steps, increments

MEASURES: dict[str, tuple[str, float | None, float]] = texts(__file__)["measures"]
KINDS = {  # kind of twins -> (test and specimens of high Z, of low Z)
    "loose": (("none", "high_loose"), ("none", "loose")),
    "medium": (("none", "high_medium"), ("none", "medium")),
    "dense": (("none", "high_dense"), ("cycled", "high_dense")),
}
FLAT = Model(readings=Readings(beyond_e_cmax="flat"))  # Table 2; the loosest states are beyond e_cmax
BEFORE = ("Z0", "e0", "Lambda0")


def measures_of(curves: dict[str, np.ndarray]) -> dict[str, float]:
    """MEASURES from curves at STRAIN; NaN if a curve ends before."""
    found = {}
    for name, (curve, at, factor) in MEASURES.items():
        values = curves[curve]
        found[name] = factor * float(values.max() if at is None else np.interp(at, STRAIN, values))
    return found


def response_table(data: xr.Dataset) -> pandas.DataFrame:
    """Response of every test in the grains and in the model from the same start, a row per run and source.

    Columns: run, test, group (kind of specimen), specimen, source (grains or model), Z0, e0, Lambda0, and MEASURES.
    """
    rows = []
    for name, run in each_run(data):
        specimen = specimen_of(name)
        labels = {"run": name, "test": name.partition("-")[0], "group": specimen.partition("-")[0]}
        grains = {key: run[key].values.astype(float) for key in ("ratio", "volumetric", "Z")}
        start = {f"{key}0": float(run[key][0]) for key in ("Z", "e", "Lambda")}
        for source, curves in (("grains", grains), ("model", model_curves(run))):
            rows.append({**labels, "specimen": specimen, "source": source, **start, **measures_of(curves)})
    return pandas.DataFrame(rows)


def model_curves(run: xr.Dataset) -> dict[str, np.ndarray]:
    """ratio, volumetric and Z of the model with Table 2 at STRAIN, from the measured e, Z, Lambda, A, F and F^t.

    NaN where the model cannot follow the path.
    """
    A, F, Ft = (deviator(run[key].values.astype(float)) for key in ("A", "F", "Ft"))
    state = ModelState(float(run["e"][0]), float(run["Z"][0]), float(run["Lambda"][0]), A, F, Ft)
    path = Steps(steps=(increments(strain={"zz": float(STRAIN[-1])}, stress={"xx": 0.0, "yy": 0.0, "xz": 0.0}),))
    try:
        result = drive(FLAT, path, state, record_strain=1e-3)
    except PhysicsError:
        return {name: np.full(STRAIN.shape, np.nan) for name in ("ratio", "volumetric", "Z")}
    curves = {
        "ratio": result.q / result.p,
        "volumetric": np.trace(result.strain, axis1=1, axis2=2),
        "Z": result.Z,
    }
    ends = {name: np.nan if result.failure else values[-1] for name, values in curves.items()}
    return {n: np.interp(STRAIN, result.axial_strain, values, right=ends[n]) for n, values in curves.items()}


def direction_table(response: pandas.DataFrame) -> pandas.DataFrame:
    """Effect of the direction of the previous shear, 0 minus 90 degrees, a row per source and measure.

    Each specimen is compared with itself and counts once. Columns: source, measure, difference, within, off, off_within
    (45 degrees minus the mean of 0 and 90: zero if a measure is linear in cos(2 theta), as the fabric along the axis of
    the test is), off_p_value, specimens, p_value, corrected (Holm).
    """
    rows = []
    after = response[response["test"].isin(ANGLES)]
    for source, tests in after.groupby("source", sort=False):
        for measure in MEASURES:
            along, between, across = (
                tests[tests["test"] == test].set_index("specimen")[measure].rename(None) for test in ANGLES
            )
            off = cluster_mean(between - 0.5 * (along + across))
            row = {"source": source, "measure": measure} | cluster_mean(along - across).columns("difference")
            rows.append(row | {"off": off.value, "off_within": off.within, "off_p_value": off.p_value})
    return _corrected(rows)


def coordination_table(response: pandas.DataFrame) -> pandas.DataFrame:
    """Effect of Z0 at equal e0 and p, per unit of Z0, a row per source and measure.

    All loose and medium specimens that were not sheared before, fitted with a + b e0 + c Z0. Columns: source, measure,
    difference (c), within, apart, apart_within, apart_p_value (c with an offset for the preparation), correlation (of
    Z0 and the preparation), specimens, p_value, corrected (Holm).
    """
    rows = []
    tested = response[(response["test"] == "none") & ~response["group"].str.contains("dense")]
    for source, table in tested.groupby("source", sort=False):
        prepared = table["group"].str.startswith("high").to_numpy(dtype=float)
        design = np.column_stack([table["Z0"], table["e0"] - table["e0"].mean(), np.ones(len(table))])
        for measure in MEASURES:
            y = table[measure].to_numpy(dtype=float)
            apart = coefficient(y, np.column_stack([design, prepared]), len(table))
            row = {"source": source, "measure": measure} | coefficient(y, design, len(table)).columns("difference")
            row |= {"apart": apart.value, "apart_within": apart.within, "apart_p_value": apart.p_value}
            rows.append(row | {"correlation": float(np.corrcoef(table["Z0"], prepared)[0, 1])})
    return _corrected(rows)


def coefficient(y: np.ndarray, design: np.ndarray, specimens: int) -> Tested:
    """Fit by least squares; returns the first coefficient with its interval and t test, NaN without degrees of freedom.

    NaN values of y (n,) are left out; the design is (n, k).
    """
    known = np.isfinite(y)
    if known.sum() <= np.linalg.matrix_rank(design[known]):
        return Tested(math.nan, math.nan, specimens, math.nan)
    fit = OLS(y[known], design[known]).fit()
    return Tested.of(float(fit.params[0]), float(fit.bse[0]), fit.df_resid, specimens)


def twin_table(response: pandas.DataFrame) -> pandas.DataFrame:
    """High minus low Z at equal e and p, a row per source, kind of twins and measure (and Z0, e0 and Lambda0).

    Kinds that have not been tested are left out.

    The dense twins are paired (the same specimen before and after a cycle); the others are different specimens (Welch).
    Columns: source, kind, measure, difference, within, specimens, p_value, corrected (Holm, measures of the grains).
    """
    rows = []
    for source, table in response.groupby("source", sort=False):
        for kind, (high, low) in KINDS.items():
            one, other = (table[(table["test"] == test) & (table["group"] == group)] for test, group in (high, low))
            if one.empty or other.empty:
                continue
            for measure in (*BEFORE, *MEASURES):
                if high[1] == low[1]:
                    both = pandas.concat([one, other])
                    found = paired_difference(both, measure, "test", low[0], high[0])
                else:
                    found = difference_of_means(other[measure], one[measure])
                rows.append({"source": source, "kind": kind, "measure": measure} | found.columns("difference"))
    return _corrected(rows)


def _corrected(rows: Sequence[Mapping[str, object]]) -> pandas.DataFrame:
    table = pandas.DataFrame(rows)
    table["specimens"] = table.pop("specimens")
    table["p_value"] = table.pop("p_value")
    asked = (table["source"] == "grains") & ~table["measure"].isin(BEFORE)
    table["corrected"] = adjusted(table["p_value"].where(asked, math.nan))
    return table
