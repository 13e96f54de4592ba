"""Possible causes of differences from the paper, each tested by computing a number with an alternative choice.

The effect of a cause is the number with the alternative minus the number without it, with a 95 % interval over
specimens. Contact laws, engines and definitions are compared on the same tests or specimens, in pairs whose common
scatter cancels. There are hundreds of comparisons, so whether one matters is decided after a correction for their
number.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas
import xarray as xr

from analysis.paper.ends import (
    HOLDS_A_STRESS,
    Runs,
    between,
    ends,
    extrapolated,
    main,
    matching,
    sheared,
    starts,
    table,
)
from analysis.paper.specimens import specimens_of
from analysis.speed_error.errors import same_specimens
from analysis.speed_error.table import open_study
from analysis.statistics import NOTHING, Tested, jackknife, two_samples
from labkit.results import SHEAR, WINDOW

if TYPE_CHECKING:
    from analysis.paper.numbers import Number

SAME_SPECIMENS = ("share_cv", "share_cr", "share_cp", "full_cv")
AT_20 = ", at 15 to 20 % strain"
STUDY_FACTORS = ("rate", "time step", "local damping", "grains", "Young's modulus", "settings")
STUDY_COLUMNS = {name: f"{name.removesuffix('_zz')}_critical" for name in ("A_zz", "F_zz", "Ft_zz", "Z", "Lambda")}
STUDY_COLUMNS["M"] = "ratio_critical"


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Two tables of tests from analysis.paper.ends whose numbers are compared: `other` against `ours`.

    `how`: `paired`, the rows belong to the same tests; `definition`, they also come from the same records, so that
    the difference is exact for a single test; `two samples`, the tables are independent; `part`, `other` is a subset
    of the rows of `ours`.
    """

    cause: str
    alternative: str
    how: str
    ours: pandas.DataFrame
    other: pandas.DataFrame

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs compared."""
        return tuple(dict.fromkeys([*self.ours["run"], *self.other["run"]]))

    def of_paths(self, paths: Collection[str]) -> Comparison:
        """The same comparison with only the tests along some paths."""
        kept = [tests[tests["path"].isin(paths)] for tests in (self.ours, self.other)]
        return dataclasses.replace(self, ours=kept[0], other=kept[1])

    def effect(self, statistic: Callable[[pandas.DataFrame], float], parameters: int = 1) -> Tested:
        """Estimate of the change in a statistic (table -> number) due to the alternative."""
        ours, other = self.ours, self.other
        if self.how == "two samples":
            return two_samples(statistic, ours, other)
        if len(other) == 0 or (self.how != "part" and len(ours) != len(other)):
            return NOTHING
        inside = ours["run"].isin(other["run"]).to_numpy()
        if self.how == "part" and inside.all():
            return NOTHING

        def difference(rows: np.ndarray) -> float:
            own = ours.iloc[rows[inside[rows]]] if self.how == "part" else other.iloc[rows]
            return statistic(own) - statistic(ours.iloc[rows]) if len(own) else math.nan

        found = jackknife(difference, len(ours), parameters, specimens_of(ours["run"]))
        exact = self.how == "definition" and len(ours) == 1
        return dataclasses.replace(found, within=0.0) if exact else found


Effect = dict[str, Any]  # cause, alternative (the other choice), effect (change of a number), within, p_value, runs


def _effect(cause: str, alternative: str, found: Tested, runs: Iterable[str]) -> Effect:
    row = {"cause": cause, "alternative": alternative, **found.columns("effect")}
    return row | {"tests": found.n, "runs": " ".join(runs)}


def effects(comparisons: Iterable[Comparison], number: Number) -> list[Effect]:
    """Effects of the Comparisons on an analysis.paper.numbers.Number, without those that do not change it."""
    tested = []
    for comparison in comparisons:
        chosen = comparison if number.at_start else comparison.of_paths(number.paths)
        estimate = chosen.effect(number.statistic, number.parameters)
        if math.isfinite(estimate.value) and (estimate.value != 0.0 or estimate.within > 0.0):
            tested.append(_effect(chosen.cause, chosen.alternative, estimate, chosen.runs))
    return tested


def end_comparisons(runs: Runs) -> list[Comparison]:
    """Comparisons for numbers of the critical state."""
    own = sheared(main(runs))
    ours = ends(own)
    nominal = {name: run.assign(void_ratio=run["void_ratio_nominal"]) for name, run in own.items()}
    c0 = {name: run.assign(stress=run["stress_sff"]) for name, run in own.items()}
    linear = 1.5 * (0.4 * ours["A_zz"] + 0.4 * ours["F_zz"] + 3.0 * ours["Ft_zz"])
    same_tests = [
        ("averaging window", "the last tenth of the strain instead of the last quarter", ends(own, 0.9, 1.0)),
        ("strain range", "the third quarter of the strain instead of the last", ends(own, 0.5, 0.75)),
        ("extrapolation", "values extrapolated to infinite strain", extrapolated(own)),
        ("definition of e", "the nominal void ratio (not corrected for overlaps)", ends(nominal)),
        ("stress", "the stress of C0 instead of Love's", ends(c0)),
        (
            "definition of q",
            "q = sigma_1 - sigma_3 instead of sigma_zz - (sigma_xx + sigma_yy)/2",
            _principal(own, ours),
        ),
        ("formula for q/p", "q/p = 3/2 (2/5 A_zz + 2/5 F_zz + 3 F^t_zz)", ours.assign(M=linear)),
    ]
    comparisons = [Comparison(cause, label, "paired", ours, other) for cause, label, other in same_tests]
    for path in SHEAR:
        comparisons.append(Comparison("path", f"{path.upper()} tests only", "part", ours, ours[ours["path"] == path]))
    for density in ("dense", "medium", "loose"):
        some = ours[ours["run"].astype(str).str.contains(density)]
        comparisons.append(Comparison("density", f"{density} specimens only", "part", ours, some))
    law = "YADE's rolling-resistance law instead of the spring-dashpot law (e differs too in CR and CP)"
    comparisons.append(_same_specimens(runs, "law", law, "paper", "fused"))
    engine = "YADE instead of the fused engine, both with the rolling-resistance law"
    comparisons.append(_same_specimens(runs, "engine", engine, "fused", "yade"))
    return [*comparisons, *_size(runs), *_rate(runs)]


def _principal(runs: Runs, ours: pandas.DataFrame) -> pandas.DataFrame:
    """The table of ends with M from the largest and the smallest principal stress."""
    change = []
    for run in runs.values():
        last = between(run, (1.0 - WINDOW) * float(run["axial_strain"][-1]), math.inf)
        love = last["stress"].values
        stress = np.linalg.eigvalsh(0.5 * (love + np.swapaxes(love, 1, 2)))
        q = stress[:, 2] - stress[:, 0] - last.lab.deviatoric_stress().values
        change.append(float((q / last.lab.mean_stress().values).mean()))
    return ours.assign(M=ours["M"] + np.array(change, dtype=float))


def _same_specimens(runs: Runs, cause: str, alternative: str, ours: str, other: str) -> Comparison:
    """Comparison of tests from the same specimens: NAME-other against NAME-ours."""
    names = [name for name in SAME_SPECIMENS if f"{name}-{ours}" in runs and f"{name}-{other}" in runs]
    first, second = (
        ends(sheared({f"{name}-{kind}": runs[f"{name}-{kind}"] for name in names})) for kind in (ours, other)
    )
    return Comparison(cause, alternative, "paired", first, second)


def _size(runs: Runs) -> Iterator[Comparison]:
    """Comparison of the CV test with fewer grains against the full-size one, at the same contact law and rate."""
    names = "full_cv-paper", "share_cv-paper"
    if all(name in runs for name in names):
        full, share = (runs[name] for name in names)
        last = min(float(run["axial_strain"][-1]) for run in (full, share))
        alternative = f"{share.attrs['grains']} grains instead of {full.attrs['grains']} (e differs too)"
        ours, other = (table({name: between(runs[name], (1.0 - WINDOW) * last, last)}) for name in names)
        yield Comparison("size", alternative + AT_20, "two samples", ours, other)


def _rate(runs: Runs) -> Iterator[Comparison]:
    """Comparison of a CV test at another rate with tests of the same density, law and size, over the same strains."""
    slow, fast = matching(runs, r"cv-medium(_more-s\d+)?"), runs.get("full_cv-paper")
    if slow and fast is not None:
        last = min(float(run["axial_strain"][-1]) for run in (fast, *slow.values()))
        begin = (1.0 - WINDOW) * last
        ours = table({name: between(run, begin, last) for name, run in slow.items()})
        alternative = "twice the rate, from a specimen made with the rolling-resistance law"
        other = table({"full_cv-paper": between(fast, begin, last)})
        yield Comparison("rate", alternative + AT_20, "two samples", ours, other)


def study_effects(number: Number, study: xr.Dataset | None) -> Iterator[Effect]:
    """Effects measured by ./lab speed-error: a level of a factor against the baseline from the same specimens.

    `study`: data set of analysis.speed_error.table, or None.
    """

    def mean_of(values: np.ndarray) -> Callable[[np.ndarray], float]:
        return lambda rows: values[rows].mean()

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
                alternative = f"{factor} {level} in {path.upper()} tests of ./lab speed-error"
                found, compared = jackknife(mean_of(change), len(change)), (str(case), str(base[0]))
                yield _effect(f"{factor} (speed-error study)", alternative, found, compared)


def guarded_study(file: Path | None) -> xr.Dataset | None:
    """Data set of ./lab speed-error in memory, or None if the file is missing.

    Cases run without the checks, with time steps above the limit, are left out: none of our runs could be affected.
    """
    if file is None or not file.exists():
        return None
    with open_study(file) as data:
        return data.isel(case=data["guarded"].values == 1).load()


def start_comparisons(number: Number, runs: Runs) -> list[Comparison]:
    """Comparisons for a number measured on specimens before shearing."""
    ours = starts(number.select(runs))
    alternative = "the nominal void ratio (not corrected for overlaps)"
    nominal = ours.assign(e=ours["e_nominal"])
    comparisons = [Comparison("definition of e", alternative, "definition", ours, nominal)]
    if ours["path"].isin(HOLDS_A_STRESS).any():
        alternative = "the void ratio of the specimen as generated, before consolidation"
        made = ours.assign(e=ours["e_made"])
        comparisons.append(Comparison("consolidation", alternative, "definition", ours, made))
    if number.name == "p0 dense":
        alternative = "a specimen of the same density generated with a higher friction"
        high = starts(matching(runs, "cv_other-dense_high"))
        comparisons.append(Comparison("friction during generation", alternative, "two samples", ours, high))
    return comparisons
