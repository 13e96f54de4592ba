"""The page of the study: which constants change with which parameter, and what shifts Lambda^c."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pandas

from analysis.constants.materials import AT, CONSTANTS, PAPER, REFERENCE
from analysis.markdown import table
from analysis.paper.estimates import text
from analysis.statistics import SIGNIFICANT
from labkit.model import Parameters

INTRODUCTION = """# The constants of Table 2 for other grains

Table 2 is calibrated on one material. Here one parameter of the grains is changed at a time: friction mu, rolling
friction mu_r, kappa = kn/kt, and the spread of the uniform grading, D ± spread D. CV tests on dense and loose
specimens of 2,000 grains, three of each (five with Table 1's grains), give each material's critical state lines. The
campaign is `analysis/constants/campaign.yaml`; its runs are made by `./lab constants FOLDER`, which can be
interrupted and resumed, and this page was written by `{command}`.

{done} of the {planned} tests, on {specimens} specimens. The state of a test is its mean over {begin:.0f} to {end:.0f}
% of strain ([ends.csv](ends.csv)). M, A, F and F^t (components zz) are compared at Lambda = {reference:g}, by
interpolation between the dense and the loose specimens; the parameters of Z^c and Lambda^c are those of the lines
through both states. All intervals are 95 %; the scatter of specimens is pooled over the materials at each density,
and p-values are corrected for the number of rows of their table (Holm)."""

STATE = """## How near to the critical state

Slopes within the window per 10 % of strain, over all specimens. At 35 to 50 % some quantities still drift (up to 70 %
of strain, see [the critical state](../critical_state/README.md)); materials are compared over the same strains."""

RATE = """The inertial number is 1e-3, above the paper's bound of 3e-4. The study of
[the critical state](../critical_state/README.md) has tests of Table 1's grains at 2.5e-4, with 4,000 grains, another
dense void ratio (0.606) and taller cells. Constants measured here minus those of these tests, over the same strains:"""

SCALING = """## E and p

Young's modulus is not among the rows. Young's modulus and all stresses times 4, with the rate times 2, is a change of
units: in double precision the records of a CV and of a CP test are then the same to the last bit, with stresses times
4 (`tests/analysis/test_constants.py`). So the constants depend on p/E only, and p/E and the critical void ratio
determine each other: what Table 2 neglects of E/p is the dependence of M, A, F and F^t on the void ratio
([findings](../../docs/findings.md))."""


def page(tables: Mapping[str, pandas.DataFrame], planned: int, window: tuple[float, float], command: str) -> str:
    """README.md of the study; planned: number of tests in the campaign; window: of strain."""
    ends = tables["ends"][tables["ends"]["test"] != "slow"]
    parts = [
        INTRODUCTION.format(
            command=command,
            done=len(ends),
            planned=planned,
            specimens=ends["specimen"].nunique(),
            begin=100 * window[0],
            end=100 * window[1],
            reference=REFERENCE,
        ),
        "## Which constants change",
        "![changes](changes.png)",
        "Constant and its difference from Table 1's grains; **bold**: resolved, and not within 2 % (e_cmax: 0.005); "
        "`=`: the whole interval is within 2 % (0.005); all others are not resolved.",
        _constants(tables["constants"]),
        _summary(tables["constants"]),
        "![lines](lines.png)",
        "## What shifts the lines",
        "Slopes at Table 1's grains, from a parabola through the materials: per unit of mu, mu_r and spread, per "
        "doubling of kappa.",
        _slopes(tables["slopes"]),
        _needed(tables["slopes"], tables["constants"]),
        STATE,
        _drift(tables["stationarity"]),
        RATE,
        _rate(tables["rate"]),
        SCALING,
    ]
    return "\n\n".join(parts) + "\n"


def _constants(rows: pandas.DataFrame) -> str:
    base = rows[rows["parameter"] == PAPER].set_index("constant")
    body = [["Table 1", *(text(base.loc[c, "estimate"], base.loc[c, "within"]) for c in CONSTANTS)]]
    for (parameter, value), group in rows[rows["parameter"] != PAPER].groupby(["parameter", "value"], sort=False):
        known = group.set_index("constant")
        cells = []
        for constant in CONSTANTS:
            row = known.loc[constant]
            cell = text(row["difference"], row["difference_within"])
            marks = {"differs": "**", "agrees": "", "not resolved": ""}[row["verdict"]]
            cells.append(f"{marks}{cell}{marks}{' =' if row['verdict'] == 'agrees' else ''}")
        body.append([f"{parameter} = {value:g}", *cells])
    return table(["grains", *CONSTANTS], body)


def _summary(rows: pandas.DataFrame) -> str:
    """Which constants change with each parameter, a line per parameter."""
    lines = []
    others = rows[rows["parameter"] != PAPER]
    for parameter, group in others.groupby("parameter", sort=False):
        changed = [c for c in CONSTANTS if (group[group["constant"] == c]["verdict"] == "differs").any()]
        same = [c for c in CONSTANTS if (group[group["constant"] == c]["verdict"] == "agrees").all()]
        parts = [f"changes {', '.join(changed)}" if changed else "no change is resolved"]
        parts += [f"{', '.join(same)} agree"] if same else []
        rest = [c for c in CONSTANTS if c not in changed + same]
        parts += [f"not resolved for {', '.join(rest)}"] if rest else []
        lines.append(f"- {parameter}: {'; '.join(parts)}.")
    count = int(others["p_value"].notna().sum())
    return "\n".join(lines) + f"\n\n{count} comparisons, corrected together."


def _slopes(rows: pandas.DataFrame) -> str:
    body = []
    for parameter, group in rows.groupby("parameter", sort=False):
        cells = []
        for row in group.itertuples():
            marks = "**" if row.corrected <= SIGNIFICANT else ""
            cells.append(f"{marks}{text(row.slope, row.within)}{marks}")
        body.append([str(parameter), *cells])
    return table(["parameter", *CONSTANTS], body)


def _needed(slopes: pandas.DataFrame, rows: pandas.DataFrame) -> str:
    """By how much each parameter would have to differ to shift Lambda^c(0.67) to the paper's line; M and F^t then."""
    base = rows[rows["parameter"] == PAPER].set_index("constant")
    paper = Parameters()
    above = base.loc["Lambda_067", "estimate"] - paper.c_cLam * (paper.e_cmax - AT)
    known = slopes.set_index(["parameter", "constant"])
    body = []
    for parameter in dict.fromkeys(slopes["parameter"]):
        of_line = known.loc[(parameter, "Lambda_067")]
        if of_line["corrected"] > SIGNIFICANT:
            body.append([parameter, "slope not resolved", "", ""])
            continue
        change = -above / of_line["slope"]
        shifted = [
            text(
                base.loc[c, "estimate"] + change * known.loc[(parameter, c), "slope"],
                abs(change) * known.loc[(parameter, c), "within"],
            )
            for c in ("M", "Ft")
        ]
        body.append([parameter, f"{change:+.2g}{' doublings' if parameter == 'kappa' else ''}", *shifted])
    offset = text(above, base.loc["Lambda_067", "within"])
    norm = math.sqrt(1.5)
    return (
        f"Lambda^c(0.67) of Table 1's grains is {offset} above the paper's line. One parameter alone would remove "
        "that (to first order) if it differed from Table 1 by `change`. M and F^t would then be as given (± from the "
        f"slopes); the paper has 0.92 and {paper.Ft_c / norm:.3f}:\n\n"
        + table(["parameter", "change", "M", "F^t"], body)
    )


def _drift(rows: pandas.DataFrame) -> str:
    body = [
        [row.quantity, str(row.specimens), text(row.slope, row.within), f"{row.corrected:.2g}", row.verdict]
        for row in rows.itertuples()
    ]
    return table(["quantity", "specimens", "slope", "p", "verdict"], body)


def _rate(rows: pandas.DataFrame) -> str:
    if rows.empty:
        return "(results/critical_state holds no such tests)"
    body = [
        [row.constant, text(row.slow), text(row.difference, row.within), str(row.specimens), f"{row.corrected:.2g}"]
        for row in rows.itertuples()
    ]
    return table(["constant", "slow", "difference", "specimens", "p"], body)
