"""Every number of the paper that the campaign measures: ours with its interval, the paper's, and causes of differences.

`numbers.py` lists the numbers, `report_numbers.py` lays the table out for readers.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas
import xarray as xr

from analysis.markdown import text
from analysis.paper.bounds import NO_RUNS, limits
from analysis.paper.causes import Comparison, Effect, effects, end_comparisons, start_comparisons, study_effects
from analysis.paper.ends import Runs, blocks, ends, starts
from analysis.paper.numbers import NUMBERS, Number
from analysis.paper.specimens import specimens_of
from analysis.statistics import SIGNIFICANT, Method, Tested, adjusted, cluster_mean, jackknife, verdict
from labkit.results import WINDOW

COLUMNS = (
    "number label kind ours within uncertainty_of tests specimens seed_scatter window_scatter paper paper_says "
    "paper_rounding difference judged in_units agrees explanation runs"
).split()


def fidelity(runs: Runs, study: xr.Dataset | None = None) -> tuple[pandas.DataFrame, pandas.DataFrame]:
    """Two pandas.DataFrames: the numbers (COLUMNS) and the tested causes (CAUSES).

    The runs, by name, are those of analysis.paper.ends.in_memory; `study` is the data set of ./lab speed-error, or
    None.

    The `kind` is `measured`, `limit`, or `input` and `tuned` for numbers that were chosen. `within` is the half-width
    of our 95 % interval, from the source named in `uncertainty_of`, `judged` the smallest difference that would matter,
    and `in_units` the absolute value of the difference divided by `within`. `seed_scatter` and `window_scatter` are
    standard deviations of one test, between seeds and within its averaging window. `agrees` is, for a measured number,
    `yes`, `no` or `not resolved`, the verdict of analysis.statistics; for the others `yes` if the difference does not
    exceed `within` plus the paper's rounding; `not determined` if the runs do not determine the number; or `no runs`.
    """
    comparisons = end_comparisons(runs)
    parts: dict[str, pandas.DataFrame] = {}
    found = [_row(number, runs, comparisons, study, parts) for number in NUMBERS]
    tested = [
        {"number": row["number"], "difference": row["difference"], **item} for row, some in found for item in some
    ]
    causes = pandas.DataFrame(tested, columns=CAUSES)
    causes["difference_left"] = causes["difference"] + causes["effect"]
    for name, method in CORRECTED.items():
        causes[name] = adjusted(causes["p_value"].to_numpy(dtype=float), method)
    causes["matters"] = causes["fdr"] <= SIGNIFICANT
    matters = iter(causes["matters"].tolist())
    for row, some in found:
        resolved = [next(matters) for _ in some]
        if row["agrees"] == "no":
            row["explanation"] = explanation(row["difference"], row["allowed"], some, resolved)
    return pandas.DataFrame([*limits(runs), *(row for row, _ in found)], columns=COLUMNS), causes


CAUSES = (
    "number cause alternative effect within p_value holm fdr matters tests difference difference_left runs"
).split()
CORRECTED: dict[str, Method] = {"holm": "holm", "fdr": "fdr_bh"}  # column -> correction over all rows


def _row(
    number: Number,
    runs: Runs,
    comparisons: Sequence[Comparison],
    study: xr.Dataset | None,
    parts: dict[str, pandas.DataFrame],
) -> tuple[dict[str, Any], list[Effect]]:
    """(row of the numbers, tested causes); parts: see _scatter."""
    chosen = number.select(runs)
    row: dict[str, Any] = {
        "number": number.name,
        "label": number.label,
        "kind": number.kind,
        "paper": number.paper,
        "paper_says": f"{number.paper:g}",
        "paper_rounding": number.rounding,
        "runs": " ".join(chosen),
    }
    of = starts(chosen) if number.at_start else ends(chosen)
    ours = estimate(number, of)
    if not math.isfinite(ours.value):
        return {**row, "agrees": "not determined" if chosen else NO_RUNS, "tests": len(of)}, []
    difference = ours.value - number.paper
    known = ours.within if math.isfinite(ours.within) else 0.0
    tested = effects(start_comparisons(number, runs) if number.at_start else comparisons, number)
    tested += study_effects(number, study)
    agrees = "yes" if abs(difference) <= known + number.rounding else "no"
    if number.kind == "measured":
        agrees = AGREES[verdict(difference, ours.within, number.resolution, rounding=number.rounding)]
    return {
        **row,
        "ours": ours.value,
        "within": ours.within,
        "uncertainty_of": _basis(ours, len(of)),
        "tests": len(of),
        "specimens": ours.n,
        **_scatter(number, chosen, parts),
        "difference": difference,
        "allowed": known + number.rounding,
        "judged": number.resolution if number.kind == "measured" else math.nan,
        "agrees": agrees,
        "in_units": abs(difference) / known if known else math.nan,
        "explanation": "",
    }, tested


AGREES = {"agrees": "yes", "differs": "no", "not resolved": "not resolved"}


def _basis(ours: Tested, tests: int) -> str:
    """Source of an interval."""
    if ours.within == 0.0:
        return f"{tests} tests of the same specimen: exact"
    if ours.n < 2:
        return f"one specimen ({tests} test{'s' if tests > 1 else ''}): no interval"
    return f"scatter of {ours.n} specimens ({tests} tests)"


def estimate(number: Number, of: pandas.DataFrame) -> Tested:
    """A number from a table of tests, with the interval over specimens: each counts once.

    A mean is taken over the means of the specimens; a fit uses all tests, and its interval leaves out one specimen at
    a time.
    """
    specimens = specimens_of(of["run"])
    if number.is_mean:
        found = cluster_mean([number.statistic(of.iloc[[k]]) for k in range(len(of))], specimens)
        alike = len(of) > 1 and found.n == 1 and number.at_start
        return dataclasses.replace(found, within=0.0) if alike else found
    return jackknife(lambda rows: number.statistic(of.iloc[rows]), len(of), number.parameters, specimens)


def _scatter(number: Number, chosen: Runs, parts: dict[str, pandas.DataFrame]) -> dict[str, float]:
    """Pooled standard deviations between the seeds of a specimen and of the window mean of one test, from its blocks.

    NaN between seeds if no specimen has several. parts: name -> blocks of a test, filled as they are needed.
    """
    if number.at_start or number.parameters > 1 or not chosen:
        return {}
    of = ends(chosen)
    value = pandas.Series([number.statistic(of.iloc[[k]]) for k in range(len(of))])
    specimen = of["run"].str.replace(r"_more-s\d+$", "", regex=True)
    groups = [own.to_numpy() for _, own in value.groupby(specimen) if len(own) > 1]
    freedom = sum(len(own) - 1 for own in groups)
    between = math.sqrt(sum(len(own) * own.var() for own in groups) / freedom) if freedom else math.nan
    square = []
    for name, run in chosen.items():
        if name not in parts:
            last = float(run["axial_strain"][-1])
            parts[name] = blocks(name, run, (1.0 - WINDOW) * last, last)
        own = parts[name]
        square.append(np.var([number.statistic(own.iloc[[k]]) for k in range(len(own))], ddof=1) / len(own))
    return {"seed_scatter": between, "window_scatter": math.sqrt(np.mean(square))}


def explanation(difference: float, unit: float, effects: Iterable[Effect], matters: Iterable[bool]) -> str:
    """Sentences on how the tested causes change a difference.

    `unit` is the difference allowed for agreement. `matters` says whether each effect is resolved after the correction
    for the number of all comparisons.
    """
    removes, reduces, other, unresolved = [], [], [], []
    for item, resolved in zip(effects, matters, strict=True):
        left = difference + item["effect"]
        effect = text(item["effect"], item["within"])
        change = f"{item['alternative']} ({'' if effect.startswith('-') else '+'}{effect}"
        if not resolved:
            unresolved.append(item["cause"])
        elif abs(left) <= unit:
            removes.append(f"{change})")
        elif abs(left) < abs(difference):
            reduces.append(f"{change}, leaving {left:+.2g})")
        else:
            other.append(item["cause"])
    sentences = []
    if removes:
        sentences.append("Agrees with " + "; or with ".join(removes))
    if reduces:
        sentences.append("Closer with " + "; with ".join(reduces))
    if not sentences:
        sentences.append("No tested alternative brings it closer by a resolved amount")
    if other:
        sentences.append("Farther away with: " + ", ".join(dict.fromkeys(other)))
    if unresolved:
        sentences.append("Effect not resolved: " + ", ".join(dict.fromkeys(unresolved)))
    return ". ".join(sentences)
