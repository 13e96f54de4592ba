"""The page of the study: the questions, their tables, and the sentences that follow from them."""

from __future__ import annotations

from collections.abc import Mapping

import pandas

from analysis.critical_state.ends import BEGIN
from analysis.markdown import table
from analysis.paper.estimates import text
from analysis.statistics import SIGNIFICANT

INTRODUCTION = """# The critical state at 100 % strain

The paper's tests end at 40 % axial strain, where q/p, A and F still fall. These tests go to 100 % (logarithmic) strain,
from cells that are tall in compression and flat in extension: CV, CP and CR in compression and extension, true triaxial
tests and simple shear, with the paper's stiffness rule and with springs in series. Most specimens have 4,000 grains,
because the scatter between specimens limits what can be said and several small specimens show it; the tests named
`full` have the paper's 14,000. The campaign is `analysis/critical_state/campaign.yaml`. A specimen counts once in every
interval and test, and every p-value is corrected for the number of rows of its table (Holm).

The runs are made by `./lab critical-state FOLDER`, which can be interrupted and resumed; this page was written by
`{command}`."""


def page(tables: Mapping[str, pandas.DataFrame], planned: int, command: str) -> str:
    """README.md of the study; planned: number of tests in the campaign."""
    ends = tables["ends"]
    parts = [
        INTRODUCTION.format(command=command),
        f"{len(ends)} of the {planned} tests of the campaign, on {ends['specimen'].nunique()} specimens. The end state "
        f"of a test is its mean over the last {100 * (1 - BEGIN):.0f} % of the strain ([ends.csv](ends.csv)).",
        "## Do the tests reach a critical state?",
        "![drift](drift.png)",
        "Mean and standard deviation over specimens; the shaded ranges are 30 to 40 % and the last 30 %.",
        "Slope per 10 % of strain, with the 95 % interval over specimens. A quantity is `stationary` if no slope is "
        "resolved and the whole interval is within 1 % of the mean (Lambda: 1e-4, e: 1e-3); `passed`: tests whose own "
        "slope is not resolved.",
        _stationarity(tables["stationarity"]),
        "## Is there one critical state?",
        "![lines](lines.png)",
        "p-values that no group of tests is off the common line, corrected for all of the table; `shared`: part of the "
        "variance about the line that tests of one specimen share.",
        _one(tables["one_critical_state"]),
        _found(tables["one_critical_state"]),
        "## Against the Lode angle",
        "![Lode angle](lode_angle.png)",
        _lode(tables["by_lode_angle"]),
        "## Which rule of stiffness?",
        "Critical state lines in compression, ± 95 % over specimens:",
        _lines(tables["lines"]),
        "Distance of the end states from the paper's lines and constants (Table 2):",
        _offsets(tables["offsets"]),
    ]
    return "\n\n".join(parts) + "\n"


def _stationarity(rows: pandas.DataFrame) -> str:
    body = [
        [
            row.window,
            row.direction,
            row.quantity,
            f"{row.specimens}",
            text(row.slope, row.within),
            f"{row.corrected:.2g}",
            f"{row.passed} of {row.tests}",
            row.verdict,
        ]
        for row in rows.itertuples()
    ]
    return table(["window", "direction", "quantity", "specimens", "slope", "p", "passed", "verdict"], body)


def _one(rows: pandas.DataFrame) -> str:
    asked = rows.drop_duplicates(["quantity", "factor"])
    factors = list(dict.fromkeys(asked["factor"]))
    body = []
    for quantity, group in asked.groupby("quantity", sort=False):
        known = group.set_index("factor")
        cells = [f"{known.loc[f, 'corrected']:.2g}" if f in known.index else "" for f in factors]
        share = known["shared"].iloc[0]
        body.append([str(quantity), *cells, f"{share:.2f}"])
    return table(["quantity", *factors, "shared"], body)


def _found(rows: pandas.DataFrame) -> str:
    """The resolved offsets, one per line."""
    found = rows[(rows["corrected"] <= SIGNIFICANT) & (rows["offset"].abs() > rows["within"])]
    if found.empty:
        return "No offset is resolved."
    lines = [
        f"- {row.quantity}, {row.factor}, {row.group}: {text(row.offset, row.within)} ({row.specimens} specimens)"
        for row in found.itertuples()
    ]
    return "Resolved offsets from all other tests (± 95 %):\n\n" + "\n".join(lines)


def _lode(rows: pandas.DataFrame) -> str:
    names = {"M": "M", "A": "A", "F": "F", "Ft": "F^t", "Z_off": "Z - Z^c(e)", "Lambda_off": "Lambda - Lambda^c(e)"}
    body = [
        [
            str(row["test"]),
            f"{row['lode']:.0f}",
            str(row["specimens"]),
            *(text(row[name], row[f"{name}_within"]) for name in names),
        ]
        for _, row in rows.iterrows()
    ]
    return table(["test", "Lode angle", "specimens", *names.values()], body)


def _lines(rows: pandas.DataFrame) -> str:
    body = [
        [
            row.stiffness,
            row.line,
            row.parameter,
            text(row.value, row.within),
            text(row.paper),
            f"{row.tests} ({row.specimens})",
        ]
        for row in rows.itertuples()
    ]
    return table(["stiffness", "line", "parameter", "value", "paper", "tests (specimens)"], body)


def _offsets(rows: pandas.DataFrame) -> str:
    body = [
        [
            row.stiffness,
            row.size,
            row.quantity,
            text(row.offset, row.within),
            str(row.specimens),
            f"{row.corrected:.2g}",
        ]
        for row in rows.itertuples()
    ]
    return table(["stiffness", "grains", "quantity", "offset", "specimens", "p"], body)
