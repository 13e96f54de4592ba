"""What a number would be if something else had been chosen: tested causes of differences from the paper.

Each cause is an alternative to what the number is made of; its effect is the number with it less the number without,
with a 95 % interval over tests. Laws, engines and definitions are compared on the very same tests or specimens, pairs
whose common scatter cancels.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas
import xarray as xr

from analysis.paper.ends import (
    HOLDS_A_STRESS,
    Runs,
    between,
    blocks,
    ends,
    extrapolated,
    main,
    matching,
    sheared,
    starts,
    table,
)
from analysis.paper.estimates import NOTHING, Estimate, jackknife, two_samples
from analysis.speed_error.errors import same_specimens
from analysis.speed_error.table import open_study
from labkit.runs import SHEAR, WINDOW

if TYPE_CHECKING:
    from analysis.paper.fidelity import Number

SAME_SPECIMENS = ("share_cv", "share_cr", "share_cp", "full_cv")
STUDY_FACTORS = ("rate", "time step", "local damping", "grains", "Young's modulus", "settings")
STUDY_COLUMNS = {
    "M": "ratio_critical",
    "A_zz": "A_critical",
    "F_zz": "F_critical",
    "Ft_zz": "Ft_critical",
    "Z": "Z_critical",
    "Lambda": "Lambda_critical",
}


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Tables of tests, of analysis.paper.ends, whose numbers are compared: `other` against `ours`.

    `how`: `paired`, the rows are the same tests; `definition`, they are the same records too, and the difference is
    exact for a single test; `two samples`, they are independent; `part`, other is some rows of ours.
    """

    cause: str
    alternative: str
    how: str
    ours: pandas.DataFrame
    other: pandas.DataFrame

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs behind it."""
        return tuple(
            dict.fromkeys(
                [*self.ours.attrs.get("runs", self.ours["run"]), *self.other.attrs.get("runs", self.other["run"])]
            )
        )

    def of_paths(self, paths: Collection[str]) -> Comparison:
        """The same with the tests of some paths alone."""
        kept = [one[one["path"].isin(paths)] for one in (self.ours, self.other)]
        return dataclasses.replace(self, ours=kept[0], other=kept[1])

    def effect(self, statistic: Callable[[pandas.DataFrame], float], parameters: int = 1) -> Estimate:
        """The Estimate of what the alternative adds to a statistic (table -> number)."""
        ours, other = self.ours, self.other
        if self.how == "two samples":
            return two_samples(statistic, ours, other)
        if len(other) == 0 or (self.how != "part" and len(ours) != len(other)):
            return NOTHING
        if self.how != "part":
            found = jackknife(
                lambda rows: statistic(other.iloc[rows]) - statistic(ours.iloc[rows]), len(ours), parameters
            )
            exact = self.how == "definition" and len(ours) == 1
            return dataclasses.replace(found, within=0.0) if exact else found
        inside = ours["run"].isin(other["run"]).to_numpy()
        return NOTHING if inside.all() else _part_against_all(statistic, ours, inside, parameters)


def _part_against_all(statistic, ours, inside, parameters):
    def difference(rows):
        own = ours.iloc[rows[inside[rows]]]
        return statistic(own) - statistic(ours.iloc[rows]) if len(own) else math.nan

    return jackknife(difference, len(ours), parameters)


@dataclasses.dataclass(frozen=True)
class Effect:
    """`alternative`: in words, what is otherwise; `effect`: what that adds to a number; `runs`: their names."""

    cause: str
    alternative: str
    effect: Estimate
    runs: tuple[str, ...]


def effects(comparisons: Iterable[Comparison], number: Number) -> list[Effect]:
    """The Effects of some Comparisons on a analysis.paper.fidelity.Number; those that do not touch it are left out."""
    found = []
    for one in comparisons:
        one = one if number.at_start else one.of_paths(number.paths)
        estimate = one.effect(number.statistic, number.parameters)
        if math.isfinite(estimate.value) and (estimate.value != 0.0 or estimate.within > 0.0):
            found.append(Effect(one.cause, one.alternative, estimate, one.runs))
    return found


def end_comparisons(runs: Runs) -> list[Comparison]:
    """The Comparisons for numbers of the critical state."""
    own = sheared(main(runs))
    ours = ends(own)
    nominal = {name: run.assign(void_ratio=run["void_ratio_nominal"]) for name, run in own.items()}
    c0 = {name: run.assign(stress=run["stress_sff"]) for name, run in own.items()}
    linear = 1.5 * (0.4 * ours["A_zz"] + 0.4 * ours["F_zz"] + 3.0 * ours["Ft_zz"])
    same_tests = [
        ("window", "the last tenth of the strain, not the last quarter", ends(own, 0.9, 1.0)),
        ("strain", "the third quarter of the strain, not the last", ends(own, 0.5, 0.75)),
        ("not yet critical", "the strain extrapolated beyond the end of the tests", extrapolated(own)),
        ("definition of e", "the nominal void ratio, overlaps not taken out", ends(nominal)),
        ("stress", "the stress of C0, not Love's", ends(c0)),
        ("reading", "q/p from 3/2 (2/5 A_zz + 2/5 F_zz + 3 F^t_zz)", ours.assign(M=linear)),
    ]
    found = [Comparison(cause, words, "paired", ours, other) for cause, words, other in same_tests]
    found += [
        Comparison("path", f"{path.upper()} tests alone", "part", ours, ours[ours["path"] == path]) for path in SHEAR
    ]
    found += [
        Comparison(
            "density", f"{density} specimens alone", "part", ours, ours[ours["run"].astype(str).str.contains(density)]
        )
        for density in ("dense", "medium", "loose")
    ]
    found.append(_same_specimens(runs, "law", "law yade, not law paper", "paper", "fused"))
    found.append(_same_specimens(runs, "engine", "YADE, not the engine fused, law yade on both", "fused", "yade"))
    return [*found, *_size(runs), *_rate(runs)]


def _same_specimens(runs, cause, words, ours, other):
    """Tests from the same specimens: NAME-other against NAME-ours."""
    names = [name for name in SAME_SPECIMENS if f"{name}-{ours}" in runs and f"{name}-{other}" in runs]
    first, second = (
        ends(sheared({f"{name}-{kind}": runs[f"{name}-{kind}"] for name in names})) for kind in (ours, other)
    )
    return Comparison(cause, words, "paired", first, second)


def _size(runs):
    """The CV test of a share of the grains against that of the full size, law paper and rate the same."""
    names = "full_cv-paper", "share_cv-paper"
    if all(name in runs for name in names):
        full, share = (runs[name] for name in names)
        last = min(float(run["axial_strain"][-1]) for run in (full, share))
        words = f"{share.attrs['grains']} grains, not {full.attrs['grains']} (e differs too)"
        tables = [blocks(name, runs[name], (1.0 - WINDOW) * last, last) for name in names]
        yield Comparison("size", words, "two samples", *tables)


def _rate(runs):
    """A CV test at another rate against those of the same density, law and size, over the same strains."""
    slow, fast = matching(runs, r"cv-medium(_more-s\d+)?"), runs.get("full_cv-paper")
    if slow and fast is not None:
        last = min(float(run["axial_strain"][-1]) for run in (fast, *slow.values()))
        begin = (1.0 - WINDOW) * last
        ours = table({name: between(run, begin, last) for name, run in slow.items()})
        words = "twice the rate, from a specimen made with law yade"
        yield Comparison("rate", words, "two samples", ours, blocks("full_cv-paper", fast, begin, last))


def study_effects(number: Number, study: xr.Dataset | None) -> Iterator[Effect]:
    """Effects that ./lab speed-error measured: a level of a factor against the baseline from the same specimens.

    `study`: data set of analysis.speed_error.table, or None.
    """
    if study is None or number.column not in STUDY_COLUMNS:
        return
    values = study["value"].sel(observable=STUDY_COLUMNS[number.column])
    for path in sorted(set(study["path"].values.tolist()) & set(number.paths)):
        base = study["case"].values[((study["path"] == path) & (study["factor"] == "baseline")).values]
        cases = study["case"].values[((study["path"] == path) & study["factor"].isin(STUDY_FACTORS)).values]
        for case in cases if len(base) else ():
            same = same_specimens(study.sel(case=case), study.sel(case=base[0]))
            change = (values.sel(case=case) - values.sel(case=base[0])).values[same]
            change = change[np.isfinite(change)]
            if len(change) > 1:
                factor, level = (str(study[name].sel(case=case).values) for name in ("factor", "level"))
                words = f"{factor} {level} in {path.upper()} tests of labkit speed-error"
                effect = jackknife(lambda rows: change[rows].mean(), len(change))
                yield Effect(f"study: {factor}", words, effect, (str(case), str(base[0])))


def guarded_study(file: Path | None) -> xr.Dataset | None:
    """The data set of ./lab speed-error in memory, or None without the file. What was run without the guards, steps
    beyond the limit, is no cause that a run of ours could have, and is left out.
    """
    if file is None or not file.exists():
        return None
    with open_study(file) as data:
        return data.isel(case=data["guarded"].values == 1).load()


def start_comparisons(number: Number, runs: Runs) -> list[Comparison]:
    """The Comparisons for a number of specimens before shearing."""
    ours = starts(number.select(runs))
    found = [
        Comparison(
            "definition of e",
            "the nominal void ratio, overlaps not taken out",
            "definition",
            ours,
            ours.assign(e=ours["e_nominal"]),
        )
    ]
    if ours["path"].isin(HOLDS_A_STRESS).any():
        words = "the void ratio that the specimen was made with, before it was brought to the pressure"
        found.append(Comparison("consolidation", words, "definition", ours, ours.assign(e=ours["e_made"])))
    if number.name == "p0 dense":
        words = "a specimen of the same density with a larger first friction"
        high = starts(matching(runs, "cv_other-dense_high"))
        found.append(Comparison("first friction", words, "two samples", ours, high))
    return found
