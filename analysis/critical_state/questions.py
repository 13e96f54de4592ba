"""The questions that the campaign answers, as tables: stationarity, one critical state, the stiffness rule."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pandas
import xarray as xr
from statsmodels.regression.linear_model import OLS

from analysis import statistics
from analysis.critical_state.ends import BEGIN, QUANTITIES, end_table, records
from analysis.paper.lines import LINES, PAPER, critical_Lambda, critical_Z, line_parameters, line_slopes, off_the_lines
from analysis.statistics.one_line import one_line
from analysis.statistics.stationarity import slope_table, stationarity_table

# (begin, end) over which slopes are fitted, in shares of a test's strain; the first is the end of the paper's tests
WINDOWS = ((0.3, 0.4), (0.4, BEGIN), (BEGIN, 1.0))
STEPS = (0.4, 0.55, 0.7, 0.85, 1.0)  # strains between which means are compared
COMPRESSION = ("cv", "cp", "cr")
# the smallest slope that matters, per 0.1 of strain: 1 % of M, A, F, Ft and Z; Lambda and e as the paper rounds them
JUDGED = {"Lambda": 1e-4, "e": 1e-3}
ROUNDING = 1e-6  # rounding of a share of the strain in single precision
STRAIGHT = ("M", "A", "F", "Ft")  # constant at the critical state according to the paper; here linear in e


def stationarity(records: pandas.DataFrame) -> pandas.DataFrame:
    """Slopes per 0.1 of strain in each window of WINDOWS, a row per window, direction and quantity.

    A window is a share of the strain of a test, so that it is also the end of simple shear, which goes to 173 %.
    direction: of `direction`. See stationarity_table; corrected for all rows of a window.
    """
    tables = []
    labelled = records.assign(direction=[direction(test) for test in records["test"]])
    share = records["strain"] / records.groupby("run")["strain"].transform("max")
    for begin, end in WINDOWS:
        slopes = slope_table(labelled[share.between(begin, end + ROUNDING)], QUANTITIES, 0.0, by=["direction"])
        table = stationarity_table(slopes, by=["direction"], judged=JUDGED)
        table.insert(0, "window", f"{100 * begin:.0f}-{100 * end:.0f} %")
        tables.append(table)
    return pandas.concat(tables, ignore_index=True)


def direction(test: str) -> str:
    """Direction of a test of the campaign: compression, extension, true triaxial or simple shear."""
    if "extension" in test:
        return "extension"
    if test.split("_")[0] in COMPRESSION:
        return "compression"
    return "simple shear" if test == "shear" else "true triaxial"


def plateau(records: pandas.DataFrame) -> pandas.DataFrame:
    """Means of QUANTITIES between neighbouring STEPS in compression, with the paper's rule and 4,000 grains.

    A row per window, means over the specimens.
    """
    chosen = (records["stiffness"] == "paper") & (records["size"] == "4000")
    tests = records[chosen & (records["test"].map(direction) == "compression")]
    rows = []
    for begin, end in itertools.pairwise(STEPS):
        inside = tests[tests["strain"].between(begin, end + ROUNDING)]
        means = inside.groupby(["specimen", "run"])[list(QUANTITIES)].mean().groupby("specimen").mean()
        rows.append({"window": f"{100 * begin:.0f}-{100 * end:.0f} %", "specimens": len(means), **means.mean()})
    return pandas.DataFrame(rows)


def questions(ends: pandas.DataFrame) -> dict[str, tuple[pandas.DataFrame, Sequence[object]]]:
    """factor -> (the tests compared, the group or the number of each); the paper's stiffness rule by default."""
    paper = ends[(ends["stiffness"] == "paper") & (ends["size"] == "4000")]
    ways = paper["test"].map(direction)
    compressed = paper[ways == "compression"]
    axial = ways.isin(["compression", "extension"])
    both = ends[(ends["size"] == "4000") & (ends["test"].isin(["cv", "cv_series", "cp", "cp_series"]))]
    sizes = ends[(ends["stiffness"] == "paper") & ends["test"].isin(["cv", "cv_full"])]
    return {
        "path": (compressed, compressed["path"].tolist()),
        "density": (compressed, compressed["density"].tolist()),
        "seed": (compressed, [name.rpartition("-")[2] for name in compressed["specimen"]]),
        "direction": (paper[axial], ways[axial].tolist()),
        "stiffness rule": (both, both["stiffness"].tolist()),
        "size": (sizes, sizes["size"].tolist()),
    }


def one_critical_state(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Do all tests end in one critical state? A row per quantity, factor and group.

    Z and Lambda are compared with lines of e, e with a line of p, and M, A, F and Ft with straight lines of e, each
    fitted to the tests compared. The columns `offset` and `within` compare a group with all others, and `p_value` tests
    that no group is off, corrected for the number of quantities and factors (Holm). The factor `direction` compares
    extension with compression.
    """
    rows = []
    for factor, (tests, groups) in questions(ends).items():
        for quantity in ("e", "Z", "Lambda", *STRAIGHT):
            found = one_line(*residuals(tests, quantity), np.asarray(groups), tests["specimen"].tolist())
            for row in found.offsets.itertuples(index=False):
                rows.append((quantity, factor, *row, found.scatter, found.shared, found.p_value))
    columns = "quantity factor group tests specimens offset within scatter shared p_value".split()
    table = pandas.DataFrame(rows, columns=columns)
    table["corrected"] = statistics.adjusted_once(table, ["quantity", "factor"])
    return table


def limits_of_equivalence(asked: pandas.DataFrame) -> pandas.DataFrame:
    """Limits beyond which offsets are excluded: the largest |offset| + within; rows: quantities, columns: factors.

    asked: Result of one_critical_state.
    """
    limits = asked.assign(limit=asked["offset"].abs() + asked["within"])
    largest = limits.pivot_table("limit", "quantity", "factor", aggfunc="max")
    ordered = largest.loc[asked["quantity"].unique(), asked["factor"].unique()]
    return ordered.rename_axis(columns=None).reset_index()


def curvature(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Is a quantity linear in the Lode angle? A row per quantity, all tests of 4,000 grains with the paper's rule.

    The residuals of one_critical_state are fitted with a + b x + c x^2, x the Lode angle over 60 degrees. sag: -c/4,
    which is the height of the curve over its chord at 30 degrees (negative: below), within (95 %, clustered by
    specimen), p_value that it is zero, corrected (Holm), tests, specimens.
    """
    tests = ends[(ends["stiffness"] == "paper") & (ends["size"] == "4000")]
    x, specimens = tests["lode"].to_numpy() / 60.0, pandas.factorize(tests["specimen"])[0]
    rows = []
    for quantity in ("e", "Z", "Lambda", *STRAIGHT):
        y, line = residuals(tests, quantity)
        size = np.abs(line).max(axis=0)
        design = np.column_stack([-4.0 * x * x, x, line / size])
        robust = {"groups": specimens, "df_correction": True}
        fit = OLS(y, design).fit(cov_type="cluster", cov_kwds=robust, use_t=True)
        freedom = specimens.max() + 1 - design.shape[1]
        found = statistics.Tested.of(float(fit.params[0]), float(fit.bse[0]), freedom, int(specimens.max()) + 1)
        rows.append({"quantity": quantity, "tests": len(tests), **found.columns("sag")})
    return statistics.corrected(rows)


def inertia(data: xr.Dataset) -> pandas.DataFrame:
    """Inertial number of each test, a row per test: mean over the tests, and the largest stored."""
    numbers = data["inertial_number"].to_dataframe().reset_index().dropna()
    return numbers.groupby("test", sort=False)["inertial_number"].agg(["mean", "max"]).reset_index()


def same_cubes(data: xr.Dataset) -> pandas.DataFrame:
    """Compare extension with compression of the same cubes at 40 % strain, one row per quantity.

    The quantities are M, A, F and Ft, and Z and Lambda relative to the paper's lines of e. The columns are difference,
    within (paired, 95 %), specimens, p_value and corrected (Holm). The shape of the cell does not differ. `data`
    is results/other_paths/statistics.nc.
    """
    both = data.isel(run=data["test"].isin(["compression", "extension"]).values)
    ends = end_table(both, records(both), BEGIN + 0.05)
    ends = ends.assign(Z=ends["Z"] - critical_Z(ends["e"]), Lambda=ends["Lambda"] - critical_Lambda(ends["e"]))
    rows = []
    for quantity in ("Z", "Lambda", *STRAIGHT):
        found = statistics.paired_difference(ends, quantity, "test", "compression", "extension")
        rows.append({"quantity": quantity, **found.columns("difference")})
    return statistics.corrected(rows)


def residuals(tests: pandas.DataFrame, quantity: str) -> tuple[np.ndarray, np.ndarray]:
    """(residuals from the fitted line (n,), its derivatives with respect to its parameters (n, k))."""
    y = tests[quantity].to_numpy(dtype=float)
    if quantity in STRAIGHT:
        columns = np.column_stack([np.ones(len(tests)), tests["e"].to_numpy(dtype=float)])
        return y, columns
    name = {"e": "e(p)", "Z": "Z(e)", "Lambda": "Lambda(e)"}[quantity]
    _, fit, at, _ = LINES[name]
    x = fit(tests)
    return y - np.asarray(at(x, tests), dtype=float), line_slopes(at, tests, x)


def lines(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Critical state lines for each stiffness rule in compression, next to the paper's.

    A row per rule, line and parameter: value, within (95 %, jackknife over specimens), paper, tests, specimens.
    """
    parts = []
    compressed = ends[[direction(test) == "compression" for test in ends["test"]]]
    for rule, tests in compressed.groupby("stiffness", sort=False):
        parts.append(line_parameters(tests, tests["specimen"].tolist(), ("e(p)", "Z(e), Lambda(e)")))
        parts[-1].insert(0, "stiffness", rule)
    return pandas.concat(parts, ignore_index=True)


def offsets(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Distance of the end states in compression from the paper's own lines, a row per stiffness rule and quantity.

    Z - Z^c(e) and Lambda - Lambda^c(e) of Table 2, and M, A, F and Ft minus the paper's constants: mean over the
    specimens, within (95 %), p_value, corrected for the rows (Holm).
    """
    at = {
        "Z": lambda t: critical_Z(t["e"]),
        "Lambda": lambda t: critical_Lambda(t["e"]),
        "M": lambda t: 0.92,
        "A": lambda t: PAPER.A_c / math.sqrt(1.5),
        "F": lambda t: PAPER.F_c / math.sqrt(1.5),
        "Ft": lambda t: PAPER.Ft_c / math.sqrt(1.5),
    }
    rows = []
    compressed = ends[[direction(test) == "compression" for test in ends["test"]]]
    for (rule, size), tests in compressed.groupby(["stiffness", "size"], sort=False):
        for quantity, line in at.items():
            found = statistics.cluster_mean(tests[quantity] - np.asarray(line(tests), dtype=float), tests["specimen"])
            row = {"stiffness": rule, "size": size, "quantity": quantity, "tests": len(tests)}
            rows.append(row | found.columns("offset"))
    columns = "stiffness size quantity offset within tests specimens p_value".split()
    return statistics.corrected(rows, columns)


def by_lode_angle(ends: pandas.DataFrame) -> pandas.DataFrame:
    """M, A, F, Ft, Z - Z^c(e) and Lambda - Lambda^c(e) against the Lode angle: means per test and 95 % half-widths."""
    paper = ends[(ends["stiffness"] == "paper") & (ends["size"] == "4000") & (ends["density"] == "medium")]
    rows = []
    for test, group in off_the_lines(paper).groupby("test", sort=False):
        row = {"test": test, "specimens": group["specimen"].nunique(), "lode": group["lode"].mean()}
        for quantity in (*STRAIGHT, "e", "p_MPa", "Z_off", "Lambda_off"):
            found = statistics.cluster_mean(group[quantity], group["specimen"])
            row |= {quantity: found.value, f"{quantity}_within": found.within}
        rows.append(row)
    return pandas.DataFrame(rows).sort_values("lode", ignore_index=True)
