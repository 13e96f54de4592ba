"""The tables of the study, from the snapshots of all runs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas
import xarray as xr
from scipy import stats

from analysis.places import results_folder
from analysis.statistics import SIGNIFICANT, Tested, adjusted, cluster_mean
from analysis.volume.forms import CLOSURES, FORMS
from analysis.volume.simulate import OF_CLUMPS
from labkit.micro import along_deviator, equivalent_stress
from labkit.sff import NEGLECTED

MARGIN = 0.02  # of q
FIRST_STRAIN = {"compression": 0.019, "extension": 0.019, "b": 0.019, "shear": 0.039, "cyclic": 0.0}
LEAST_RATIO = 0.2  # of q to p, in cycles
CELL = ["shape", "grading", "test"]
FIRST_OF_ENGINES, ALIKE = 0.009, 0.005  # least strain of the specimens that both engines shear; of q
FAILS = 0.05  # error of q of `fourth`
STORED = ("other_paths", "lode_angle", "critical_state")
POWERS = (0.0, 0.01)  # true errors for which the power is given
PLANNED = ("spheres", "clumps")


def judged(data: pandas.DataFrame) -> pandas.DataFrame:
    """The snapshots that are judged."""
    late = data["strain"] >= data["test"].map(FIRST_STRAIN)
    return data[late & ((data["test"] != "cyclic") | (data["q/p"] > LEAST_RATIO))]


def by_specimen(data: pandas.DataFrame) -> pandas.DataFrame:
    """Means over the judged snapshots, a row for each cell and seed."""
    return judged(data).groupby([*CELL, "seed"], sort=False).mean(numeric_only=True).reset_index()


def errors(data: pandas.DataFrame) -> pandas.DataFrame:
    """Error of q and p of every equation in every cell, with the outcome of the plan."""
    rows, specimens = [], by_specimen(data)
    for (group, *cell), part in specimens.groupby([groups(specimens), *CELL], sort=False):
        for form in FORMS:
            row = {"group": group} | dict(zip(CELL, cell, strict=True))
            rows.append(row | {"form": form} | _errors_of(part, form))
    return _with_outcomes(pandas.DataFrame(rows))


def groups(table: pandas.DataFrame) -> pandas.Series:
    """What a row belongs to: spheres or clumps, the groups of the plan, or clumps of another ratio."""
    others = "clumps " + table["grading"].str.split().str[0]
    names = np.select([table["shape"] == "spheres", table["grading"] == OF_CLUMPS], ["spheres", "clumps"], others)
    return pandas.Series(names, table.index, name="group")


def by_test(data: pandas.DataFrame) -> pandas.DataFrame:
    """The same over all gradings of spheres, and over all shapes of clumps: the second and third family of the plan."""
    rows, specimens = [], by_specimen(data)
    for (group, test), part in specimens.groupby([groups(specimens), "test"], sort=False):
        cells = part.groupby(CELL[:2])
        for form in FORMS:
            worst = cells[f"{form} q"].mean()
            largest = {"largest_cell": worst.loc[worst.abs().idxmax()], "in": " ".join(worst.abs().idxmax())}
            rows.append({"group": group, "test": test, "form": form} | _errors_of(part, form) | largest)
    return _with_outcomes(pandas.DataFrame(rows))


def _errors_of(part: pandas.DataFrame, form: str) -> dict[str, float]:
    """Mean errors with 95 % intervals, and the p-value of the two one-sided tests at MARGIN."""
    q, p = cluster_mean(part[f"{form} q"]), cluster_mean(part[f"{form} p"])
    error = _standard_error(q)
    below = float(stats.t.sf((MARGIN - abs(q.value)) / error, q.n - 1)) if error > 0.0 else math.nan
    columns = {"specimens": q.n, "q": q.value, "q_within": q.within, "p": p.value, "p_within": p.within}
    return columns | {"scatter": error * math.sqrt(q.n), "p_value": below}


def _standard_error(mean: Tested) -> float:
    """Standard error of a mean from its interval; 0 for fewer than two specimens."""
    return mean.within / float(stats.t.ppf(0.975, mean.n - 1)) if mean.n > 1 else 0.0


def _with_outcomes(table: pandas.DataFrame) -> pandas.DataFrame:
    """Adds the p-value after Holm's correction, the corrected interval, and the outcome.

    The groups of the plan are a family of each equation, and the other ratios another.
    """
    parts = []
    for _, part in table.groupby(["form", table["group"].isin(PLANNED)], sort=False):
        level = 1.0 - 0.5 * SIGNIFICANT / len(part)
        freedom = np.maximum(part["specimens"] - 1, 1)
        corrected = np.where(
            part["specimens"] > 1, part["q_within"] * stats.t.ppf(level, freedom) / stats.t.ppf(0.975, freedom), np.nan
        )
        part = part.assign(corrected=adjusted(part["p_value"].to_numpy()), q_corrected=corrected)
        above = part["q"].abs() - part["q_corrected"] > MARGIN
        outcome = np.where(part["corrected"] < SIGNIFICANT, "below", np.where(above, "above", "not resolved"))
        parts.append(part.assign(outcome=outcome))
    return pandas.concat(parts).sort_index()


def neglected(data: pandas.DataFrame) -> pandas.DataFrame:
    """The terms that the equation by volume neglects, each for itself, in q, a row for each cell."""
    names = [f"neglected {name}" for name in NEGLECTED]
    table = by_specimen(data).groupby(CELL, sort=False)[["c0_volume q", *names]].mean().reset_index()
    sizes = table[names].abs()
    return table.assign(largest=sizes.idxmax(axis=1).str.removeprefix("neglected "))


def variables(data: pandas.DataFrame) -> pandas.DataFrame:
    """Variables by volume against those printed, in compression and extension: what a model of each would be fed."""
    table = judged(data)[lambda rows: rows["test"].isin(["compression", "extension"])]
    table = table.assign(ratio=table["Lambda by volume"] / table["Lambda"])
    names = ["ratio", "F", "F by volume", "Ft", "Ft by volume", "A", "Z", "q/p"]
    means = table.groupby([*CELL, "seed"], sort=False)[names].mean().groupby(CELL, sort=False)
    return means.mean().join(means["ratio"].std().rename("ratio_scatter")).reset_index()


def extremes(data: pandas.DataFrame) -> pandas.DataFrame:
    """The largest errors of single snapshots with q/p above LEAST_RATIO, a row for each equation."""
    table = data[data["q/p"] > LEAST_RATIO]
    rows = []
    for form in FORMS:
        error = table[f"{form} q"].abs()
        worst = table.loc[error.idxmax()]
        at = f"{worst['shape']} {worst['grading']}, {worst['test']}"
        row = {"form": form, "snapshots": len(table), "largest_q": error.max(), "in": at, "missing": error.isna().sum()}
        rows.append(row | {"above_5": int((error > 0.05).sum()), "largest_p": data[f"{form} p"].abs().max()})
    return pandas.DataFrame(rows)


def checks(data: pandas.DataFrame) -> pandas.DataFrame:
    """Inertial number, energy balance, and p by volume, a row for each set, engine, shape and grading."""
    in_rounds = data.index.isin(judged(data[data["set"] == "rounds"]).index)
    table = data.assign(p_exact=data["c0_volume p"].abs(), judged=in_rounds)
    table = table.fillna({"engine": "fused", "grading": "1.5 number"})
    return (
        table.groupby(["set", "engine", "shape", "grading"], sort=False)
        .agg(
            specimens=("seed", "nunique"),
            snapshots=("p", "size"),
            judged=("judged", "sum"),
            grains=("bodies", "max"),
            inertial_number=("inertial_number", "max"),
            energy_balance=("energy_balance", "max"),
            largest_error_of_p=("p_exact", "max"),
        )
        .reset_index()
    )


def missing(data: pandas.DataFrame) -> pandas.DataFrame:
    """Specimens of the rounds that could not be made, or whose tests failed: others of their group have the seed."""
    cells = data.groupby([groups(data), *CELL[:2]], sort=False)["seed"].agg(set)
    everyone = cells.groupby("group").agg(lambda sets: set.union(*sets))
    rows = [
        {"shape": shape, "grading": grading, "seed": seed}
        for (group, shape, grading), seeds in cells.items()
        for seed in sorted(everyone[group] - seeds)
    ]
    return pandas.DataFrame(rows, columns=["shape", "grading", "seed"])


def power(found: pandas.DataFrame, means: pandas.DataFrame) -> pandas.DataFrame:
    """Probability that an equation is called below, by specimens and true error, from the measured scatter."""
    rng, rows = np.random.default_rng(1), []
    tables = {"cell": found[found["group"].isin(PLANNED)], "mean": means}
    for what, table in tables.items():
        part = table[(table["form"] == "c0_volume") & (table["specimens"] > 1)]
        for group, of_group in part.groupby(
            part["group"].where(part["group"].isin(PLANNED), "other ratios"), sort=False
        ):
            n, scatter = int(of_group["specimens"].median()), float(np.sqrt((of_group["scatter"] ** 2).mean()))
            looks = int((part["group"].isin(PLANNED) == (group in PLANNED)).sum())
            for true in POWERS:
                drawn = rng.normal(true, scatter, (20000, n))
                size = drawn.std(axis=1, ddof=1) / math.sqrt(n)
                p_value = stats.t.sf((MARGIN - np.abs(drawn.mean(axis=1))) / size, n - 1)
                row = {"group": group, "of": what, "specimens": n, "looks": looks, "scatter": scatter, "error": true}
                row |= {"strictest": (p_value < SIGNIFICANT / looks).mean(), "last": (p_value < SIGNIFICANT).mean()}
                rows.append(row)
    return pandas.DataFrame(rows)


def engines(data: pandas.DataFrame) -> pandas.DataFrame:
    """Errors of q by volume on both engines, paired by specimen: a row per test, of all specimens and of each kind."""
    late = data[data["strain"] >= FIRST_OF_ENGINES]
    if late.empty:
        return pandas.DataFrame(columns=["test", "shape"])
    means = late.groupby([*CELL, "seed", "engine"], sort=False)["c0_volume q"].mean().unstack("engine").reset_index()
    rows = []
    for test, of_test in means.groupby("test", sort=False):
        kinds = {("all", ""): of_test} | dict(iter(of_test.groupby(["shape", "grading"], sort=False)))
        for (shape, grading), part in kinds.items():
            row = {"test": test, "shape": shape, "grading": grading, "specimens": len(part)}
            columns = {"fused": part["fused"], "yade": part["yade"], "difference": part["yade"] - part["fused"]}
            for name, values in columns.items():
                mean = cluster_mean(values)
                row |= {name: mean.value, f"{name}_within": mean.within}
            rows.append(row | {"alike": abs(row["difference"]) + row["difference_within"] < ALIKE})
    return pandas.DataFrame(rows)


def failing(data: pandas.DataFrame) -> pandas.DataFrame:
    """The snapshots in which `fourth` errs by more than FAILS of q, with the errors of every equation."""
    table = data[(data["q/p"] > LEAST_RATIO) & (data["fourth q"].abs() > FAILS)]
    return table[["shape", "grading", "test", "seed", "strain", *(f"{form} q" for form in FORMS)]]


def goal(found: pandas.DataFrame, terms: pandas.DataFrame) -> pandas.DataFrame:
    """Cells within MARGIN, below and above it, by equation, and the largest term that is neglected in the worst."""
    largest = terms.set_index(CELL)["largest"].map(NEGLECTED)
    tests = np.where(found["test"].isin(["extension", "b"]), "extension, b = 0.5", "compression, shear, cycles")
    rows = []
    for (group, of, form), part in found.groupby(["group", tests, "form"], sort=False):
        worst = part.loc[part["q"].abs().idxmax()]
        row = {"group": group, "tests": of, "form": form, "cells": len(part), "specimens": part["specimens"].max()}
        row |= {"within": (part["q"].abs() < MARGIN).sum()}
        row |= {name: (part["outcome"] == name).sum() for name in ("below", "above")}
        row |= {"largest": worst["q"], "largest_within": worst["q_within"], "in": " ".join(worst[CELL])}
        remains = {"c0_volume": largest[tuple(worst[CELL])], "c0_volume + 2": NEGLECTED["tangential_4"]}
        rows.append(row | {"remains": remains.get(form, "")})
    return pandas.DataFrame(rows)


def closures(found: pandas.DataFrame, means: pandas.DataFrame, wild: pandas.DataFrame) -> pandas.DataFrame:
    """The rule of the plan by which a closure earns a place, a row for each."""
    cells = found[found["group"].isin(PLANNED)].set_index([*CELL, "form"])["outcome"].eq("below").unstack("form")
    of_means = means.set_index(["group", "test", "form"])["outcome"].eq("below").unstack("form")
    rows = []
    for form in CLOSURES:
        missed = pandas.concat([table.loc[~table["c0_volume"], form] for table in (cells, of_means)])
        reached = cells.loc[cells["c0_volume"], form]
        worst = wild[f"{form} q"].abs().max()
        row = {"form": form, "missed": len(missed), "cured": missed.sum(), "reached": len(reached)}
        row |= {"still": reached.sum(), "failing": len(wild), "largest": worst}
        rows.append(row | {"earned": missed.all() and reached.all() and worst <= FAILS})
    return pandas.DataFrame(rows)


def stored() -> pandas.DataFrame:
    """p by volume against Love in the statistics that earlier studies stored in single precision, and of clumps."""
    rows = []
    for study in STORED:
        love, family, _ = _stored_stresses(study)
        p = np.trace(love, axis1=-2, axis2=-1)
        ratio = np.trace(family["c0_volume"], axis1=-2, axis2=-1) / p
        error = np.abs(ratio - 1.0)[np.isfinite(p) & (p > 0.0)]
        rows.append({"study": study, "snapshots": error.size, "largest_error_of_p": error.max()})
    clumps = pandas.read_csv(Path(results_folder("clumps")) / "snapshots.csv.gz")["c0_volume p"].abs()
    rows.append({"study": "clumps", "snapshots": len(clumps), "largest_error_of_p": clumps.max()})
    return pandas.DataFrame(rows)


def large_strain() -> pandas.DataFrame:
    """Errors of q in results/other_paths, 4,000 spheres of +-20 %, from 4 to 40 % accumulated strain, by test."""
    love, family, runs = _stored_stresses("other_paths")
    rows = []
    for test in dict.fromkeys(runs):
        row: dict[str, object] = {"test": test}
        for form in ("c0", "c0_volume", "fourth"):
            at = np.flatnonzero(runs == test)
            late, of_form = love[at, 1:], family[form][at, 1:]
            error = along_deviator(of_form - late, late) / equivalent_stress(late)
            mean = cluster_mean(np.nanmean(error, axis=1))
            row |= {"specimens": mean.n, form: mean.value, f"{form}_within": mean.within}
        rows.append(row)
    return pandas.DataFrame(rows)


def _stored_stresses(study: str) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Love's stress (run, snapshot, 3, 3), that of each equation, and the test of each run, of an earlier study."""
    with xr.open_dataset(Path(results_folder(study)) / "statistics.nc", decode_times=False) as data:
        family = {str(form): data["stress_family"].sel(form=form).values for form in data["form"].values}
        love = family["c0"] - data["error_budget"].sum("part", skipna=False).values
        return love, family, data["test"].values.astype(str)
