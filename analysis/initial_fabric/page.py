"""The page of the study: what balances the fabric under isotropic stress, and what the fabric and Z change."""

from __future__ import annotations

from collections.abc import Mapping

import pandas

from analysis.initial_fabric.response import BEFORE, MEASURES
from analysis.markdown import table
from analysis.paper.estimates import text
from analysis.statistics import SIGNIFICANT

INTRODUCTION = """# What an isotropic stress hides: initial fabric and Z

Section 5.3 of the paper draws two tests from the model alone. In Fig. 9 the contacts are anisotropic under an
isotropic stress, with F^0 = -A^0 [I + 4/7 A^0]^-1, and the response of a CR test depends on the direction. In Fig. 10
specimens of equal e and p have different Z. Here both are made of grains, 2,000 per specimen, with Table 1 and a CR
test at 500 kPa, and the model with Table 2 is driven along the same path from the measured e, Z, Lambda, A, F and F^t
(beyond e_cmax with the reading `flat`). The campaign is `analysis/initial_fabric/campaign.yaml`; its runs are made by
`./lab initial-fabric FOLDER`, which can be interrupted and resumed, and this page was written by `{command}`.

{done} of the {planned} tests. Intervals are 95 %, a specimen counts once, and p-values are corrected for the number
of rows that are compared (Holm); **bold**: resolved."""

BALANCE = """## Under isotropic stress (Fig. 9)

Loose specimens were sheared by 8 % at constant volume along an axis at 0, 45 or 90 degrees from z and returned to 500
kPa in all directions. Components along the axis of that shear; `share`: the part of -A that F and 15/2 F^t balance.
C0 with F^t is F = -(A + 15/2 F^t) [I + 4/7 A]^-1."""

DIRECTIONS = """## Reloading at 0, 45 and 90 degrees (Fig. 9)

CR compression along z. Along z the fabric of a shear at an angle theta is proportional to 1 + 3 cos(2 theta): each
measure is fitted with an offset for each specimen and a common slope in cos(2 theta), so that a specimen is compared
with itself."""

TWINS = """## Different Z at equal e and p (Fig. 10)

Solid: grains, dashed: model. `loose`, `medium`: specimens made by compression of a gas with reduced friction (high Z)
or by insertion with overlap (low Z); different specimens, Welch's test. The differences are those of high minus low
Z; Z0, e0 (nominal) and Lambda0 are before the CR test. An effect of the preparation other than Z cannot be told from
that of Z."""

DENSE = """ `dense`: compressed without friction, and the same specimens after one cycle of shear of 1 % at constant
mean stress (paired)."""


REGRESSION = """Each measure over all loose and medium specimens, fitted with a + b e0 + c Z0; c, at the same p:"""

PAIRS = """Means of high minus low Z:"""


def page(tables: Mapping[str, pandas.DataFrame], planned: int, command: str) -> str:
    """README.md of the study; planned: number of tests in the campaign."""
    parts = [
        INTRODUCTION.format(command=command, done=len(tables["states"]), planned=planned),
        BALANCE,
        "![balance](balance.png)",
        _balance(tables["balance"]),
        DIRECTIONS,
        "Solid: grains, dashed: model.",
        "![directions](directions.png)",
        _effects(tables["directions"], "0 minus 90 degrees"),
        TWINS + (DENSE if "dense" in set(tables["twins"]["kind"]) else ""),
        "![twins](twins.png)",
        REGRESSION,
        _effects(tables["coordination"], "per unit of Z0"),
        PAIRS,
        _differences(tables["twins"], "kind", [*BEFORE, *MEASURES]),
    ]
    return "\n\n".join(parts) + "\n"


def _bold(cell: str, p_value: float) -> str:
    return f"**{cell}**" if p_value <= SIGNIFICANT else cell


def _balance(rows: pandas.DataFrame) -> str:
    body = [
        [row.quantity, _bold(text(row.value, row.within), row.corrected), str(row.specimens), f"{row.corrected:.2g}"]
        for row in rows.itertuples()
    ]
    return table(["quantity", "mean", "specimens", "p"], body)


def _effects(rows: pandas.DataFrame, heading: str) -> str:
    """A row per measure: the effect in the grains, its p-value, and that in the model."""
    known = rows.set_index(["source", "measure"])
    body = []
    for measure in MEASURES:
        grains, model = known.loc[("grains", measure)], known.loc[("model", measure)]
        effect = _bold(text(grains["difference"], grains["within"]), grains["corrected"])
        of_model = text(model["difference"], model["within"])
        body.append([measure, effect, str(int(grains["specimens"])), f"{grains['corrected']:.2g}", of_model])
    return table(["measure", f"grains, {heading}", "specimens", "p", "model"], body)


def _differences(rows: pandas.DataFrame, by: str, measures: list[str]) -> str:
    """A row per pair or kind and measure: the difference in the grains, its p-value, and that of the model."""
    known = rows.set_index(["source", by, "measure"])
    body = []
    for name in dict.fromkeys(rows[by]):
        for measure in measures:
            grains, model = (known.loc[(source, name, measure)] for source in ("grains", "model"))
            p_value = float(grains["corrected"])
            body.append(
                [
                    str(name),
                    measure,
                    _bold(text(grains["difference"], grains["within"]), p_value),
                    str(int(grains["specimens"])),
                    "" if pandas.isna(p_value) else f"{p_value:.2g}",
                    "" if measure in BEFORE else text(model["difference"], model["within"]),
                ]
            )
    return table([by, "measure", "grains", "specimens", "p", "model"], body)
