"""Every number of the paper that the campaign measures: ours with its interval, the paper's, and causes of differences.

`number_table.py` lays the table out for readers.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import pandas
import xarray as xr

from analysis.paper import lines
from analysis.paper.bounds import NO_RUNS, limits
from analysis.paper.causes import Comparison, Effect, effects, end_comparisons, start_comparisons, study_effects
from analysis.paper.ends import Runs, blocks, ends, main, matching, sheared, starts
from analysis.paper.estimates import BLOCKS, Estimate, jackknife, text
from labkit.model import ROOT_3_2
from labkit.runs import SHEAR, WINDOW

Statistic = Callable[[pandas.DataFrame], float]  # of a table of analysis.paper.ends


@dataclasses.dataclass(frozen=True)
class Number:
    """A number of the paper, measured at the ends of shear tests along `paths` or at the starts of runs.

    rounding: half a unit of the last digit that the paper prints, including the rounding of e_cmax; statistic:
    function of a table of analysis.paper.ends, which fits `parameters` parameters; column: the table column behind
    the number, if there is only one; pattern: regular expression for the runs whose start is measured.
    """

    name: str
    label: str
    paper: float
    rounding: float
    statistic: Statistic
    column: str = ""
    parameters: int = 1
    paths: tuple[str, ...] = SHEAR
    pattern: str = ""

    @property
    def at_start(self) -> bool:
        """True if it is measured at the start of tests rather than at their end."""
        return bool(self.pattern)

    def select(self, runs: Runs) -> dict[str, xr.Dataset]:
        """Runs from which it is measured."""
        return matching(runs, self.pattern) if self.pattern else sheared(main(runs), self.paths)


def _mean(column: str) -> Statistic:
    return lambda table: float(table[column].mean())


def _critical(
    name: str, label: str, paper: float, rounding: float, column: str, paths: tuple[str, ...] = SHEAR
) -> Number:
    return Number(name, label, paper, rounding, _mean(column), column, paths=paths)


def _fit(k: int, name: str, label: str, rounding: float) -> Number:
    paper = dataclasses.astuple(lines.PAPER)[k]
    return Number(name, label, paper, rounding, lambda table: float(lines.both_lines(table)[k]), parameters=4)


def _start(name: str, label: str, paper: float, rounding: float, pattern: str, column: str) -> Number:
    return Number(name, label, paper, rounding, _mean(column), column, pattern=pattern)


SEEDS = r"(_more-s\d+)?"
HALF, MIDDLE = 0.005, 0.67  # rounding of e_cmax = 0.76, and the void ratio at which it is converted to other numbers
ROUNDED_Z = float(lines.critical_Z(MIDDLE - HALF) - lines.critical_Z(MIDDLE))  # rounding of Z^c
ROUNDED = HALF / (lines.PAPER.e_cmax - MIDDLE)  # relative rounding of c_cLambda; gamma_cZ times that for c_cZ
NUMBERS = (
    _critical("M", "critical strength M = q/p", 0.92, 0.005, "M"),
    _critical("M CV", "M in CV tests", 0.93, 0.005, "M", ("cv",)),
    _critical("A_zz", "critical A_zz", lines.PAPER.A_c / ROOT_3_2, 0.005, "A_zz"),
    _critical("F_zz", "critical F_zz", lines.PAPER.F_c / ROOT_3_2, 0.005, "F_zz"),
    _critical("Ft_zz", "critical F^t_zz", lines.PAPER.Ft_c / ROOT_3_2, 0.0005, "Ft_zz"),
    Number(
        "Z residual",
        "mean of Z - Z^c(e) at the end of tests",
        0.0,
        ROUNDED_Z,
        lambda table: float((table["Z"] - lines.critical_Z(table["e"])).mean()),
        "Z",
    ),
    Number(
        "Lambda residual",
        "mean of Lambda - Lambda^c(e) at the end of tests",
        0.0,
        lines.PAPER.c_cLam * HALF,
        lambda table: float((table["Lambda"] - lines.critical_Lambda(table["e"])).mean()),
        "Lambda",
    ),
    Number(
        "e residual",
        "mean of e - e^c(p) at the end of tests; e^c(p) from C0 with Table 2",
        0.0,
        HALF,
        lambda table: float((table["e"] - lines.paper_e(table["p_MPa"])).mean()),
        "e",
    ),
    Number(
        "c_cZ",
        "c_cZ with e_cmax = 0.76 and gamma_cZ = 0.7",
        lines.PAPER.c_cZ,
        0.005 + ROUNDED * lines.PAPER.gamma_cZ * lines.PAPER.c_cZ,
        lines.c_cZ,
    ),
    Number(
        "c_cLambda",
        "c_cLambda with e_cmax = 0.76",
        lines.PAPER.c_cLam,
        0.0005 + ROUNDED * lines.PAPER.c_cLam,
        lines.c_cLambda,
    ),
    _fit(0, "e_cmax free", "e_cmax, joint fit of the four parameters of both lines", 0.005),
    _fit(1, "c_cZ free", "c_cZ, joint fit", 0.005),
    _fit(2, "gamma_cZ free", "gamma_cZ, joint fit", 0.05),
    _fit(3, "c_cLambda free", "c_cLambda, joint fit", 0.0005),
    _start("e dense", "e of the specimen of Fig. 2", 0.606, 0.0005, "cv-dense" + SEEDS, "e"),
    _start("p0 dense", "p0 of the specimen of Fig. 2 (MPa)", 0.21, 0.005, "cv-dense" + SEEDS, "p0_MPa"),
    _start("e CV loose", "e of CV tests, loose", 0.724, 0.0005, "cv(_other)?-loose.*", "e"),
    _start("e CV medium", "e of CV tests, medium", 0.670, 0.0005, "cv(_other)?-medium.*", "e"),
    _start("e CV dense", "e of CV tests, dense", 0.606, 0.0005, "cv(_other)?-dense.*", "e"),
    _start("CR 0.5", "CR: radial stress held (MPa)", 0.5, 0.05, "cr_500kPa-.*", "held_MPa"),
    _start("CR 1", "CR: radial stress held (MPa)", 1.0, 0.5, "cr_1MPa-.*", "held_MPa"),
    _start("CP 0.5", "CP: mean stress held (MPa)", 0.5, 0.05, "cp_500kPa-.*", "held_MPa"),
    _start("CP 1", "CP: mean stress held (MPa)", 1.0, 0.5, "cp_1MPa-.*", "held_MPa"),
    _start("e ISO loose", "ISOC and ISOD: e0, loose", 0.724, 0.0005, "iso[cd]-loose", "e"),
    _start("e ISO dense", "ISOC and ISOD: e0, dense", 0.606, 0.0005, "iso[cd]-dense.*", "e"),
    _start("e cyclic loose", "cyclic CP: e0, loose", 0.77, 0.005, "cyclic-cyclic_loose", "e"),
    _start("e cyclic dense", "cyclic CP: e0, dense", 0.60, 0.005, "cyclic-cyclic_dense", "e"),
    _start("p cyclic", "cyclic CP: mean stress held (MPa)", 0.5, 0.05, "cyclic-.*", "held_MPa"),
)
COLUMNS = (
    "number",
    "label",
    "ours",
    "within",
    "uncertainty_of",
    "tests",
    "seed_scatter",
    "window_scatter",
    "paper",
    "paper_says",
    "paper_rounding",
    "difference",
    "in_units",
    "agrees",
    "explanation",
    "runs",
)


def fidelity(runs: Runs, study: xr.Dataset | None = None) -> tuple[pandas.DataFrame, pandas.DataFrame]:
    """Two pandas.DataFrames: the numbers (COLUMNS) and the tested causes (CAUSES).

    `runs`: name -> run from analysis.paper.ends.in_memory; `study`: data set of ./lab speed-error, or None.
    within: half-width of our 95 % interval, from the source named in `uncertainty_of`. in_units: absolute
    value of the difference divided by `within`. seed_scatter, window_scatter: standard deviations of one test, between
    seeds and within its averaging window. agrees: `yes` if the difference does not exceed `within` plus the paper's
    rounding, else `no`; `not determined` if the runs do not determine the number; `no runs`.
    """
    comparisons = end_comparisons(runs)
    rows, causes = [], []
    for number in NUMBERS:
        row, some = _row(number, runs, comparisons, study)
        rows.append(row)
        causes += some
    return pandas.DataFrame([*limits(runs), *rows], columns=COLUMNS), pandas.DataFrame(causes, columns=CAUSES)


CAUSES = (
    "number",
    "cause",
    "alternative",
    "effect",
    "within",
    "matters",
    "tests",
    "difference",
    "difference_left",
    "runs",
)


def _row(
    number: Number, runs: Runs, comparisons: Sequence[Comparison], study: xr.Dataset | None
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """(row of the numbers, rows of the causes)."""
    chosen = number.select(runs)
    row: dict[str, Any] = {
        "number": number.name,
        "label": number.label,
        "paper": number.paper,
        "paper_says": f"{number.paper:g}",
        "paper_rounding": number.rounding,
        "runs": " ".join(chosen),
    }
    of, basis = _tests(number, chosen)
    ours = jackknife(lambda rows: number.statistic(of.iloc[rows]), len(of), number.parameters)
    if not math.isfinite(ours.value):
        return {**row, "agrees": "not determined" if chosen else NO_RUNS, "tests": ours.n}, []
    difference = ours.value - number.paper
    known = ours.within if math.isfinite(ours.within) else 0.0
    agrees = abs(difference) <= known + number.rounding
    tested = effects(start_comparisons(number, runs) if number.at_start else comparisons, number)
    tested += study_effects(number, study)
    causes = [
        {
            "number": number.name,
            "cause": item.cause,
            "alternative": item.alternative,
            "effect": item.effect.value,
            "within": item.effect.within,
            "matters": item.effect.matters,
            "tests": item.effect.n,
            "difference": difference,
            "difference_left": difference + item.effect.value,
            "runs": " ".join(item.runs),
        }
        for item in tested
    ]
    return {
        **row,
        "ours": ours.value,
        "within": ours.within,
        "uncertainty_of": basis if ours.within != 0.0 else f"{ours.n} tests of the same specimen: exact",
        "tests": ours.n,
        **_scatter(number, chosen),
        "difference": difference,
        "agrees": "yes" if agrees else "no",
        "in_units": abs(difference) / known if known else math.nan,
        "explanation": "" if agrees else explanation(difference, known + number.rounding, tested),
    }, causes


def _tests(number: Number, chosen: Runs) -> tuple[pandas.DataFrame, str]:
    """(table from which a number is computed, source of its interval)."""
    if number.at_start:
        return starts(chosen), f"scatter of {len(chosen)} tests" if len(chosen) > 1 else "one test: no interval"
    if len(chosen) == 1:
        ((name, run),) = chosen.items()
        last = float(run["axial_strain"][-1])
        return blocks(name, run, (1.0 - WINDOW) * last, last), f"{BLOCKS} blocks of the averaging window of one test"
    return ends(chosen), f"scatter of {len(chosen)} tests: paths, densities, seeds"


def _scatter(number: Number, chosen: Runs) -> dict[str, float]:
    """Pooled standard deviations between the seeds of a specimen and of the window mean of one test, from its blocks.

    NaN between seeds if no specimen has several.
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
        last = float(run["axial_strain"][-1])
        own = blocks(name, run, (1.0 - WINDOW) * last, last)
        square.append(np.var([number.statistic(own.iloc[[k]]) for k in range(len(own))], ddof=1) / len(own))
    return {"seed_scatter": between, "window_scatter": math.sqrt(np.mean(square))}


def explanation(difference: float, unit: float, effects: Iterable[Effect]) -> str:
    """Sentences on how the tested causes change a difference. `unit`: the difference allowed for agreement."""
    removes, reduces, other = [], [], []
    for item in effects:
        left = difference + item.effect.value
        change = f"{item.alternative} ({_signed(item.effect)}"
        if item.effect.matters and abs(left) <= unit:
            removes.append(f"{change})")
        elif item.effect.matters and abs(left) < abs(difference):
            reduces.append(f"{change}, leaving {left:+.2g})")
        else:
            other.append(item.cause)
    sentences = []
    if removes:
        sentences.append("Agrees with " + "; or with ".join(removes))
    if reduces:
        sentences.append("Closer with " + "; with ".join(reduces))
    if not sentences:
        sentences.append("No tested alternative brings it closer")
    if other:
        sentences.append("Also varied, without getting closer: " + ", ".join(dict.fromkeys(other)))
    return ". ".join(sentences)


def _signed(effect: Estimate) -> str:
    value = text(effect.value, effect.within)
    return value if value.startswith("-") else f"+{value}"
