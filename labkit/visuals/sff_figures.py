"""Figures of stress-force-fabric relationships in a run: what the terms of C0 add, how well each form does, and why."""

from __future__ import annotations

import time

import matplotlib.pyplot as plt
import numpy as np
import pandas
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, ScalarFormatter

from labkit.micro.stress import deviatoric_stress, mean_stress, relative_error
from labkit.sff import family as sff_family
from labkit.sff.budget import PARTS, standard_errors
from labkit.sff.c0 import TERMS
from labkit.visuals.plots import WIDTH

TERM_NAMES = {"A": "A", "F": "F", "Ft": "F$^t$", "coupled": "A and F coupled"}


def shares(run: xarray.Dataset, number: int = 5, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """What A, F, F^t and their product add to q/p of C0 over strain, stacked, with q/p of Love."""
    found = run.lab.strength_shares()
    strain = found["axial_strain"].values * 100
    love = run.lab.stress_ratio().values
    figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 4.2), layout="constrained")
    colors = stack_shares(left, run)
    left.set(xlabel="axial strain (%)", ylabel="q/p", title="stacked: they add up to C0")
    total = found.values.sum(axis=0)
    grown = np.abs(total) > 0.1 * np.nanmax(np.abs(total))
    for _term, color, values in zip(TERMS, colors, found.values, strict=False):
        right.plot(strain[grown], 100 * values[grown] / total[grown], color=color)
    right.set(xlabel="axial strain (%)", ylabel="share of the strength (%)", ylim=(0, None))
    for axes in (left, right):
        axes.grid(alpha=0.25)
    figure.legend(loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    table = {"axial_strain": strain / 100, "q_over_p_love": love, **dict(zip(TERMS, found.values, strict=True))}
    return figure, pandas.DataFrame(table)


shares.of_records = True  # type: ignore[attr-defined]  # it needs no snapshots


def stack_shares(axes: Axes, run: xarray.Dataset) -> tuple:
    """Stacks what the terms of C0 add to q/p of a run, with q/p of Love over them; returns the colours of the terms."""
    found, colors = run.lab.strength_shares(), plt.get_cmap("tab10").colors[: len(TERMS)]
    strain, love = found["axial_strain"].values * 100, run.lab.stress_ratio()
    axes.stackplot(strain, *found.values, colors=colors, alpha=0.75, labels=[TERM_NAMES[t] for t in TERMS])
    axes.plot(strain, love.values, "k-", lw=1.2, label="Love")
    return colors


def family(
    run: xarray.Dataset, number: int = 5, snapshot: int = -1, rounds: int = 25
) -> tuple[Figure, pandas.DataFrame]:
    """Error of every stress-force-fabric relationship against Love over strain, and its cost.

    `rounds`: how often each form is computed for its cost on one snapshot.
    """
    found, love = run.lab.sff_family(), run.lab.love_stress().values
    error = {form: relative_error(found.sel(form=form).values, love) for form in sff_family.FORMS}
    cost = _costs(run, snapshot, rounds)
    strain = found["axial_strain"].values * 100
    figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 4.6), layout="constrained")
    colors = dict(zip(sff_family.FORMS, plt.get_cmap("tab10").colors, strict=False))
    rows = []
    for form, values in error.items():
        left.semilogy(strain, 100 * values, color=colors[form], label=form)
        mean = float(np.nanmean(values[1:])) if len(values) > 1 else float(values[0])
        right.loglog(cost[form] * 1e3, 100 * mean, "o", color=colors[form])
        rows.append(
            {
                "form": form,
                "mean_error": mean,
                "worst_error": float(np.nanmax(values)),
                "first_error": float(values[0]),
                "milliseconds": cost[form] * 1e3,
                "cost_over_c0": cost[form] / cost["c0"],
            }
        )
    left.set(xlabel="axial strain (%)", ylabel="error against Love (%)")
    number_of_contacts = int(run["row_size"].values[snapshot])
    right.set(xlabel=f"time for {number_of_contacts} contacts (ms)", ylabel="mean error after the start (%)")
    right.xaxis.set_major_formatter(ScalarFormatter())
    right.xaxis.set_minor_formatter(NullFormatter())
    low, high = 0.7e3 * min(cost.values()), 1.5e3 * max(cost.values())
    right.set_xticks([x for x in (0.5, 1, 2, 5, 10, 20, 50) if low < x < high])
    for axes in (left, right):
        axes.grid(alpha=0.25, which="both")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    return figure, pandas.DataFrame(rows)


def _costs(run, snapshot, rounds):
    """Median seconds of each form on one snapshot, measured in turn."""
    of = run.lab.snapshot(snapshot)
    taken = {form: [] for form in sff_family.FORMS}
    for _ in range(rounds):
        for form, times in taken.items():
            begin = time.perf_counter()
            sff_family.stress(form, of)
            times.append(time.perf_counter() - begin)
    return {form: float(np.median(times)) for form, times in taken.items()}


def budget(run: xarray.Dataset, number: int = 5, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """The parts of C0 - Love in p and q over the p of Love, over strain, with standard errors at one snapshot."""
    parts, love = run.lab.error_budget(), run.lab.love_stress().values
    strain, p = parts["axial_strain"].values * 100, mean_stress(love)
    shown = [name for name in PARTS if np.abs(parts.sel(part=name).values).max() > 0.0]
    figure, axes = plt.subplots(1, 2, figsize=(WIDTH, 4.6), layout="constrained")
    for panel, of, name in zip(axes, (mean_stress, deviatoric_stress), "pq", strict=True):
        for color, part in zip(plt.get_cmap("tab10").colors, shown, strict=False):
            panel.plot(strain, 100 * of(parts.sel(part=part).values) / p, color=color, label=PARTS[part])
        panel.plot(strain, 100 * of(parts.sum("part").values) / p, "k-", lw=2, label="C0 - Love")
        panel.axhline(0.0, color="0.5", lw=0.8)
        panel.set(xlabel="axial strain (%)", ylabel=f"error in {name} over p (%)")
        panel.grid(alpha=0.25)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False, fontsize=8)
    of = run.lab.snapshot(snapshot)
    scatter = standard_errors(of) if len(of.contacts) else {}
    rows = [
        {
            "axial_strain": strain[k] / 100,
            "part": part,
            "p_error": mean_stress(parts.values[k, i]) / p[k],
            "q_error": deviatoric_stress(parts.values[k, i]) / p[k],
            "norm": np.linalg.norm(parts.values[k, i]) / np.linalg.norm(love[k]),
        }
        for k in range(len(strain))
        for i, part in enumerate(PARTS)
    ]
    table = pandas.DataFrame(rows)
    last = {part: np.linalg.norm(error) / np.linalg.norm(love[snapshot]) for part, error in scatter.items()}
    table["norm_standard_error"] = np.where(
        table["axial_strain"] == strain[snapshot] / 100, table["part"].map(last), np.nan
    )
    return figure, table
