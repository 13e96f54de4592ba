"""Every number of the paper that the campaign measures: ours with its interval, the paper's, and why they differ."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable

import numpy as np
import pandas
import xarray as xr

from analysis import markdown
from analysis.paper import lines
from analysis.paper.bounds import NO_RUNS, limits
from analysis.paper.causes import Effect, effects, end_comparisons, start_comparisons, study_effects
from analysis.paper.ends import Runs, blocks, ends, main, matching, sheared, starts
from analysis.paper.estimates import BLOCKS, jackknife, text
from labkit.model import ROOT_3_2
from labkit.runs import SHEAR, WINDOW


@dataclasses.dataclass(frozen=True)
class Number:
    """A number of the paper. `rounding`: half of the last digit that it prints, e_cmax's with it; `statistic`: table of
    analysis.paper.ends -> number, which fits so many `parameters`; `column`: of the table, if the number is of one.

    It is of the ends of the main shear tests of `paths`, or of the starts of the runs that the expression `pattern`
    matches.
    """

    name: str
    label: str
    paper: float
    rounding: float
    statistic: Callable[[pandas.DataFrame], float]
    column: str = ""
    parameters: int = 1
    paths: tuple[str, ...] = SHEAR
    pattern: str = ""

    @property
    def at_start(self) -> bool:
        """Whether it is of the starts of tests, not of their ends."""
        return bool(self.pattern)

    def select(self, runs: Runs) -> dict[str, xr.Dataset]:
        """The runs that it is measured on."""
        return matching(runs, self.pattern) if self.pattern else sheared(main(runs), self.paths)


def _mean(column):
    return lambda table: float(table[column].mean())


def _critical(name, label, paper, rounding, column, paths=SHEAR):
    return Number(name, label, paper, rounding, _mean(column), column, paths=paths)


def _fit(k, name, label, rounding):
    paper = dataclasses.astuple(lines.PAPER)[k]
    return Number(name, label, paper, rounding, lambda table: float(lines.both_lines(table)[k]), parameters=4)


def _start(name, label, paper, rounding, pattern, column):
    return Number(name, label, paper, rounding, _mean(column), column, pattern=pattern)


SEEDS = r"(_more-s\d+)?"
HALF, MIDDLE = 0.005, 0.67  # half of the last digit of e_cmax = 0.76, and the void ratio at which it is said in others:
ROUNDED_Z = float(lines.critical_Z(MIDDLE - HALF) - lines.critical_Z(MIDDLE))  # of Z^c
ROUNDED = HALF / (lines.PAPER.e_cmax - MIDDLE)  # of c_cLambda, relative; gamma_cZ times that of c_cZ
NUMBERS = (
    _critical("M", "critical strength M = q/p", 0.92, 0.005, "M"),
    _critical("M CV", "M in CV tests", 0.93, 0.005, "M", ("cv",)),
    _critical("A_zz", "critical A_zz", lines.PAPER.A_c / ROOT_3_2, 0.005, "A_zz"),
    _critical("F_zz", "critical F_zz", lines.PAPER.F_c / ROOT_3_2, 0.005, "F_zz"),
    _critical("Ft_zz", "critical F^t_zz", lines.PAPER.Ft_c / ROOT_3_2, 0.0005, "Ft_zz"),
    Number(
        "Z residual",
        "Z - Z^c(e) at the ends, mean",
        0.0,
        ROUNDED_Z,
        lambda table: float((table["Z"] - lines.critical_Z(table["e"])).mean()),
        "Z",
    ),
    Number(
        "Lambda residual",
        "Lambda - Lambda^c(e) at the ends, mean",
        0.0,
        lines.PAPER.c_cLam * HALF,
        lambda table: float((table["Lambda"] - lines.critical_Lambda(table["e"])).mean()),
        "Lambda",
    ),
    Number(
        "e residual",
        "e - e^c(p) at the ends, mean; e^c(p) of Table 2 through C0",
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
    _fit(0, "e_cmax free", "e_cmax, all four of both lines fitted", 0.005),
    _fit(1, "c_cZ free", "c_cZ, all four fitted", 0.005),
    _fit(2, "gamma_cZ free", "gamma_cZ, all four fitted", 0.05),
    _fit(3, "c_cLambda free", "c_cLambda, all four fitted", 0.0005),
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
    """Two pandas.DataFrames: the numbers (COLUMNS) and the tested causes (number, cause, alternative, effect, ...).

    `runs`: name -> run as analysis.paper.ends.in_memory gives them; `study`: data set of ./lab speed-error, or None.
    within: half-width of the 95 % interval of ours, of what `uncertainty_of` says. in_units: difference over within.
    seed_scatter, window_scatter: standard deviations of one test, between seeds and within its window.
    agrees: yes, no (the difference is more than within and the paper's rounding together), or `no runs`.
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


def _row(number, runs, comparisons, study):
    """(row of the numbers, rows of the causes)."""
    chosen = number.select(runs)
    row = {
        "number": number.name,
        "label": number.label,
        "paper": number.paper,
        "paper_says": f"{number.paper:g}",
        "paper_rounding": number.rounding,
        "runs": " ".join(chosen),
    }
    of, basis = _tests(number, chosen)
    found = jackknife(lambda rows: number.statistic(of.iloc[rows]), len(of), number.parameters)
    if not math.isfinite(found.value):
        return {**row, "agrees": "not determined" if chosen else NO_RUNS, "tests": found.n}, []
    difference = found.value - number.paper
    known = found.within if math.isfinite(found.within) else 0.0
    agrees = abs(difference) <= known + number.rounding
    tested = effects(start_comparisons(number, runs) if number.at_start else comparisons, number)
    tested += study_effects(number, study)
    causes = [
        {
            "number": number.name,
            "cause": one.cause,
            "alternative": one.alternative,
            "effect": one.effect.value,
            "within": one.effect.within,
            "matters": one.effect.matters,
            "tests": one.effect.n,
            "difference": difference,
            "difference_left": difference + one.effect.value,
            "runs": " ".join(one.runs),
        }
        for one in tested
    ]
    return {
        **row,
        "ours": found.value,
        "within": found.within,
        "uncertainty_of": basis,
        "tests": found.n,
        **_scatter(number, chosen),
        "difference": difference,
        "agrees": "yes" if agrees else "no",
        "in_units": abs(difference) / known if known else math.nan,
        "explanation": "" if agrees else explanation(difference, known + number.rounding, tested),
    }, causes


def _tests(number, chosen):
    """(the table that a number is of, what its interval is of)."""
    if number.at_start:
        return starts(chosen), f"scatter of {len(chosen)} tests" if len(chosen) > 1 else "one test: not known"
    if len(chosen) == 1:
        ((name, run),) = chosen.items()
        last = float(run["axial_strain"][-1])
        return blocks(name, run, (1.0 - WINDOW) * last, last), f"{BLOCKS} blocks of the window of one test"
    return ends(chosen), f"scatter of {len(chosen)} tests: paths, densities, seeds"


def _scatter(number, chosen):
    """Standard deviation between the seeds of a specimen, and of the window mean of one test as its blocks have it,
    both pooled; NaN for what a single test does not have.
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
    """What the tested causes say about a difference, in words. `unit`: what a difference may be."""
    removes, reduces, other = [], [], []
    for one in effects:
        left = difference + one.effect.value
        words = f"{one.alternative} ({_signed(one.effect)})"
        if one.effect.matters and abs(left) <= unit:
            removes.append(words)
        elif one.effect.matters and abs(left) < abs(difference):
            reduces.append(f"{words}, {left:+.2g} is left")
        else:
            other.append(one.cause)
    said = []
    if removes:
        said.append("Agrees with: " + "; ".join(removes))
    if reduces:
        said.append("Nearer with: " + "; ".join(reduces))
    if not said:
        said.append("No tested alternative brings it nearer")
    if other:
        said.append("Tested and not nearer with another: " + ", ".join(dict.fromkeys(other)))
    return ". ".join(said)


def _signed(effect):
    value = text(effect.value, effect.within)
    return value if value.startswith("-") else f"+{value}"


def page(numbers: pandas.DataFrame) -> str:
    """The numbers as a Markdown table for people."""
    rows = []
    for row in numbers.astype(object).where(numbers.notna(), None).to_dict("records"):
        ours, within = (math.nan if row[name] is None else row[name] for name in ("ours", "within"))
        units = "" if row["in_units"] is None else f"{row['in_units']:.1f}"
        says = [row[name] or "" for name in ("uncertainty_of", "explanation")]
        rows.append([row["label"], text(ours, within, 4), row["paper_says"], units, row["agrees"], *says])
    header = ("number", "ours", "paper", "difference / uncertainty", "agrees", "uncertainty of", "explanation")
    return markdown.table(header, rows)
