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
from analysis.volume.forms import FORMS
from labkit.micro import along_deviator, equivalent_stress
from labkit.sff import NEGLECTED

MARGIN = 0.02  # of q
FIRST_STRAIN = {"compression": 0.019, "extension": 0.019, "b": 0.019, "shear": 0.039, "cyclic": 0.0}
LEAST_RATIO = 0.2  # of q to p, in cycles
CELL = ["shape", "grading", "test"]
STORED = ("other_paths", "lode_angle", "critical_state")
POWERS = (0.0, 0.01)  # true errors for which the power is given


def judged(data: pandas.DataFrame) -> pandas.DataFrame:
    """The snapshots that are judged."""
    late = data["strain"] >= data["test"].map(FIRST_STRAIN)
    return data[late & ((data["test"] != "cyclic") | (data["q/p"] > LEAST_RATIO))]


def by_specimen(data: pandas.DataFrame) -> pandas.DataFrame:
    """Means over the judged snapshots, a row for each cell and seed."""
    return judged(data).groupby([*CELL, "seed"], sort=False).mean(numeric_only=True).reset_index()


def errors(data: pandas.DataFrame) -> pandas.DataFrame:
    """Error of q and p of every equation in every cell, with the outcome of the plan; Holm within an equation."""
    rows = []
    for cell, part in by_specimen(data).groupby(CELL, sort=False):
        for form in FORMS:
            rows.append(dict(zip(CELL, cell, strict=True)) | {"form": form} | _errors_of(part, form))
    return _with_outcomes(pandas.DataFrame(rows))


def by_test(data: pandas.DataFrame) -> pandas.DataFrame:
    """The same over all gradings of spheres, and over all shapes of clumps: the second family of the plan."""
    specimens = by_specimen(data)
    specimens["group"] = np.where(specimens["shape"] == "spheres", "spheres", "clumps")
    rows = []
    for (group, test), part in specimens.groupby(["group", "test"], sort=False):
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
    """Adds the p-value after Holm's correction within each equation, the corrected interval, and the outcome."""
    parts = []
    for _, part in table.groupby("form", sort=False):
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
    """Inertial number, energy balance, and p by volume, a row for each shape and grading."""
    table = data.assign(p_exact=data["c0_volume p"].abs())
    groups = table.groupby(["shape", "grading"], sort=False)
    return groups.agg(
        specimens=("seed", "nunique"),
        snapshots=("p", "size"),
        grains=("bodies", "max"),
        inertial_number=("inertial_number", "max"),
        energy_balance=("energy_balance", "max"),
        largest_error_of_p=("p_exact", "max"),
    ).reset_index()


def pooled(table: pandas.DataFrame) -> pandas.DataFrame:
    """Outcomes of the cells of spheres if all have the same scatter, which is then known well. Not planned."""
    rows = []
    for form, part in table[(table["shape"] == "spheres") & (table["specimens"] > 1)].groupby("form", sort=False):
        freedom = part["specimens"] - 1
        scatter = math.sqrt(float((freedom * part["scatter"] ** 2).sum() / freedom.sum()))
        error = scatter / np.sqrt(part["specimens"])
        corrected = adjusted(stats.t.sf((MARGIN - part["q"].abs()) / error, freedom.sum()))
        row = {"form": form, "cells": len(part), "freedom": freedom.sum(), "scatter": scatter}
        half = float(stats.t.ppf(0.975, freedom.sum()) * error.median())
        rows.append(row | {"half": half, "below": int((corrected < SIGNIFICANT).sum())})
    return pandas.DataFrame(rows, columns=["form", "cells", "freedom", "scatter", "half", "below"])


def power(table: pandas.DataFrame) -> pandas.DataFrame:
    """Probability that an equation is called below, by specimens and true error, from the measured scatter."""
    rng, rows = np.random.default_rng(1), []
    part = table[(table["form"] == "c0_volume") & (table["specimens"] > 1)]
    for group, cells in part.groupby(np.where(part["shape"] == "spheres", "spheres", "clumps")):
        n, scatter = int(cells["specimens"].median()), float(np.sqrt((cells["scatter"] ** 2).mean()))
        for true in POWERS:
            drawn = rng.normal(true, scatter, (20000, n))
            size = drawn.std(axis=1, ddof=1) / math.sqrt(n)
            statistic = (MARGIN - np.abs(drawn.mean(axis=1))) / size
            row = {"group": group, "specimens": n, "scatter": scatter, "error": true}
            for name, looks in (("strictest", len(part)), ("last", 1)):
                row[name] = float((stats.t.sf(statistic, n - 1) < SIGNIFICANT / looks).mean())
            rows.append(row)
    columns = ["group", "specimens", "scatter", "error", "strictest", "last"]
    return pandas.DataFrame(rows, columns=columns)


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
