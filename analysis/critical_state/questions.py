"""The questions that the campaign answers, as tables: stationarity, one critical state, the rule of stiffness."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas

from analysis.critical_state.ends import BEGIN, QUANTITIES
from analysis.paper.lines import LINES, PAPER, critical_Lambda, critical_Z, line_parameters, line_slopes
from analysis.statistics import adjusted, adjusted_once, cluster_mean, one_line, slope_table, stationarity_table

# (begin, end) of the strain over which slopes are fitted; the first is the end of the paper's tests
WINDOWS = ((0.3, 0.4), (BEGIN, 1.0))
COMPRESSION = ("cv", "cp", "cr")
# the smallest slope that matters, per 0.1 of strain: 1 % of M, A, F, Ft and Z; Lambda and e as the paper rounds them
JUDGED = {"Lambda": 1e-4, "e": 1e-3}
STRAIGHT = ("M", "A", "F", "Ft")  # constant at the critical state according to the paper; here linear in e


def stationarity(records: pandas.DataFrame) -> pandas.DataFrame:
    """Slopes per 0.1 of strain in each window of WINDOWS, a row per window, direction and quantity.

    direction: compression, extension or other. See analysis.statistics.stationarity_table; corrected for all rows of a
    window.
    """
    tables = []
    labelled = records.assign(direction=[direction(test) for test in records["test"]])
    for begin, end in WINDOWS:
        slopes = slope_table(labelled, QUANTITIES, begin, end, by=["direction"])
        table = stationarity_table(slopes, by=["direction"], judged=JUDGED)
        table.insert(0, "window", f"{100 * begin:.0f}-{100 * end:.0f} %")
        tables.append(table)
    return pandas.concat(tables, ignore_index=True)


def direction(test: str) -> str:
    """Of a test of the campaign: extension, other (true triaxial, simple shear), or compression."""
    if "extension" in test:
        return "extension"
    return "compression" if test.split("_")[0] in COMPRESSION else "other"


def questions(ends: pandas.DataFrame) -> dict[str, tuple[pandas.DataFrame, Sequence[object]]]:
    """factor -> (the tests compared, the group or the number of each); the paper's stiffness rule where not said."""
    paper = ends[(ends["stiffness"] == "paper") & (ends["size"] == "4000")]
    compressed = paper[[direction(test) == "compression" for test in paper["test"]]]
    both = ends[(ends["size"] == "4000") & (ends["test"].isin(["cv", "cv_series", "cp", "cp_series"]))]
    sizes = ends[(ends["stiffness"] == "paper") & ends["test"].isin(["cv", "cv_full"])]
    return {
        "path": (compressed, compressed["path"].tolist()),
        "density": (compressed, compressed["density"].tolist()),
        "seed": (compressed, [name.rpartition("-")[2] for name in compressed["specimen"]]),
        "Lode angle": (paper, paper["lode"].to_numpy(dtype=float)),
        "stiffness rule": (both, both["stiffness"].tolist()),
        "size": (sizes, sizes["size"].tolist()),
    }


def one_critical_state(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Do all tests end in one critical state? A row per quantity, factor and group.

    Z and Lambda are compared with lines of e, e with a line of p, and M, A, F and Ft with straight lines of e, each
    fitted to the tests compared. offset, within: of a group from all others; p_value: that no group is off, corrected
    for the number of quantities and factors (Holm); for the Lode angle the offset is a slope per 60 degrees.
    """
    rows = []
    for factor, (tests, groups) in questions(ends).items():
        for quantity in ("e", "Z", "Lambda", *STRAIGHT):
            found = one_line(*residuals(tests, quantity), np.asarray(groups), tests["specimen"].tolist())
            numeric = factor == "Lode angle"
            for row in found.offsets.itertuples():
                group = "per 60 degrees" if numeric else row.group
                offset = (size * (60.0 if numeric else 1.0) for size in (row.offset, row.within))
                of_line = found.scatter, found.shared, found.p_value
                rows.append((quantity, factor, group, row.tests, row.specimens, *offset, *of_line))
    columns = "quantity factor group tests specimens offset within scatter shared p_value".split()
    table = pandas.DataFrame(rows, columns=columns)
    table["corrected"] = adjusted_once(table, ["quantity", "factor"])
    return table


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
    """Critical state lines for each rule of stiffness in compression, beside the paper's.

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
            found = cluster_mean(tests[quantity] - np.asarray(line(tests), dtype=float), tests["specimen"])
            row = {"stiffness": rule, "size": size, "quantity": quantity, "tests": len(tests)}
            rows.append(row | found.columns("offset"))
    columns = "stiffness size quantity offset within tests specimens p_value".split()
    table = pandas.DataFrame(rows, columns=columns)
    table["corrected"] = adjusted(table["p_value"])
    return table


def by_lode_angle(ends: pandas.DataFrame) -> pandas.DataFrame:
    """M, A, F, Ft, Z - Z^c(e) and Lambda - Lambda^c(e) against the Lode angle: means per test and 95 % half-widths."""
    paper = ends[(ends["stiffness"] == "paper") & (ends["size"] == "4000") & (ends["density"] == "medium")]
    values = paper.assign(
        Z_off=paper["Z"] - critical_Z(paper["e"]),
        Lambda_off=paper["Lambda"] - critical_Lambda(paper["e"]),
    )
    rows = []
    for test, group in values.groupby("test", sort=False):
        row = {"test": test, "specimens": group["specimen"].nunique(), "lode": group["lode"].mean()}
        for quantity in (*STRAIGHT, "e", "p_MPa", "Z_off", "Lambda_off"):
            found = cluster_mean(group[quantity], group["specimen"])
            row |= {quantity: found.value, f"{quantity}_within": found.within}
        rows.append(row)
    return pandas.DataFrame(rows).sort_values("lode", ignore_index=True)
