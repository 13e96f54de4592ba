"""Figures of stress-force-fabric relationships in a run: terms of C0, error and cost of each form, error budget."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import pandas
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from labkit.figures.frame import add_heading, colors_for, new_panels, plain_ticks, snapshot_to_draw, strain_axis
from labkit.micro.snapshot import Snapshot
from labkit.micro.stress import mean_stress, relative_error
from labkit.results.figures import register_figure
from labkit.sff import family as sff_family
from labkit.sff.budget import PARTS, standard_errors

FORM_NAMES = {
    "classical": "classical (Eq. 12)",
    "classical_groups": "classical, by size (Eq. 16)",
    "linear": "without A times F (Eq. 28)",
    "c0": "C0",
    "c0_tangential": "C0, tangential 2nd order",
    "c0_volume": "C0 by volume",
    "c0_groups": "C0, by size (Eq. 17)",
    "c0_fourth": "C0, normal 4th order",
    "fourth": "by volume, 4th order",
}
STRAINS = ("axial_strain", "strain")  # columns of tables; `strain` is that of the path, e.g. gamma_xz
LINES = ("-", "--", ":") * 4
ROUNDS = 25  # number of timed evaluations of each form
TERM_NAMES = {"A": "A", "F": "F", "Ft": "F$^t$", "coupled": "A and F coupled", "M": "M", "-X": "-X"}


@register_figure("shares", needs="records")
def shares(run: xarray.Dataset) -> tuple[Figure, pandas.DataFrame]:
    """Draw stacked contributions of A, F, F^t and the product of A and F to q/p of C0 against strain.

    The figure also shows q/p from Love's stress.
    """
    terms = run.lab.strength_shares()
    strain_label, strain = strain_axis(run)
    love = run.lab.stress_ratio().values
    figure, (left, right) = new_panels(1, 2, 4.4)
    colors = stack_shares(left, run)
    left.set(xlabel=strain_label, ylabel="stress ratio q/p")
    left.set_title("terms of C0; negative terms below zero", fontsize="medium")
    total = terms.values.sum(axis=0)
    large = np.abs(total) > 0.1 * np.nanmax(np.abs(total))
    for color, values in zip(colors, terms.values, strict=True):
        right.plot(strain, 100 * np.divide(values, total, where=large, out=total * np.nan), color=color)
    right.set(xlabel=strain_label, ylabel="share of q/p of C0 (%)")
    figure.key(5)
    table = {name: terms[name].values for name in STRAINS} | {"q_over_p_love": love}
    table |= dict(zip(terms["term"].values, terms.values, strict=True))
    add_heading(figure, run)
    return figure, pandas.DataFrame(table)


def stack_shares(axes: Axes, run: xarray.Dataset) -> Sequence[object]:
    """Stack the contributions of the terms of C0 to q/p of a run, and draw q/p from Love's stress.

    Returns the colours of the terms.
    """
    strain, love = strain_axis(run)[1], run.lab.stress_ratio()
    colors = draw_stack(axes, strain, run.lab.strength_shares())
    axes.plot(strain, love.values, "k-", lw=1.2, label="stress from contacts (Love)")
    return colors


def draw_stack(axes: Axes, strain: np.ndarray, terms: xarray.DataArray) -> Sequence[object]:
    """Stack terms (term, time), the positive ones above zero and the negative ones below; returns their colours."""
    colors = colors_for(len(terms))
    ends = np.zeros((2, len(strain)))  # of the stacks of positive and of negative contributions
    for name, color, values in zip(terms["term"].values, colors, np.nan_to_num(terms.values), strict=True):
        for which, part in enumerate((np.maximum(values, 0.0), np.minimum(values, 0.0))):
            label = None if which else TERM_NAMES[name]
            axes.fill_between(strain, ends[which], ends[which] + part, color=color, alpha=0.75, lw=0.0, label=label)
            ends[which] += part
    axes.plot(strain, terms.values.sum(axis=0), "--", color="0.25", lw=1.2, label="sum of the terms (C0)")
    return colors


@register_figure("family")
def family(run: xarray.Dataset, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """Draw the error of every stress-force-fabric equation relative to Love's stress against strain, and its cost."""
    stresses, love = run.lab.sff_family(), run.lab.love_stress().values
    error = {form: relative_error(stresses.sel(form=form).values, love) for form in sff_family.FORMS}
    contacts = snapshot_to_draw(run, snapshot)
    cost = _costs(contacts)
    strain_label, strain = strain_axis(run, at_snapshots=True)
    figure, (left, right) = new_panels(1, 2, 4.8)
    rows = []
    middle = float(np.sqrt(min(cost.values()) * max(cost.values())))
    for color, ls, (form, values) in zip(
        colors_for(len(error)), LINES, error.items(), strict=False
    ):  # more lines than forms
        left.semilogy(strain, 100 * values, color=color, ls=ls, label=FORM_NAMES[form])
        mean = float(np.nanmean(values[1:])) if len(values) > 1 else float(values[0])
        point = cost[form] * 1e3, 100 * mean
        right.loglog(*point, "o", color=color)
        at, aligned = ((6, 0), "left") if cost[form] < middle else ((-6, 0), "right")  # towards the middle
        right.annotate(
            FORM_NAMES[form], point, at, textcoords="offset points", ha=aligned, va="center", fontsize="small"
        )
        errors = {"mean_error": mean, "worst_error": float(np.nanmax(values)), "first_error": float(values[0])}
        costs = {"milliseconds": cost[form] * 1e3, "cost_over_c0": cost[form] / cost["c0"]}
        rows.append({"form": form, **errors, **costs})
    left.set(xlabel=strain_label, ylabel="error relative to Love's stress (%)")
    number = len(contacts.contacts)
    right.set(xlabel=f"time for {number} contacts (ms)", ylabel="mean error without the first snapshot (%)")
    for axis in (left.yaxis, right.yaxis, right.xaxis):
        plain_ticks(axis)
    add_heading(figure, run)
    figure.key(5)
    return figure, pandas.DataFrame(rows)


def _costs(contacts: Snapshot) -> dict[str, float]:
    """Return the median evaluation time of each form on one snapshot, s; the forms are timed in turn."""
    seconds: dict[str, list[float]] = {form: [] for form in sff_family.FORMS}
    for _ in range(ROUNDS):
        for form, times in seconds.items():
            begin = time.perf_counter()
            sff_family.stress(form, contacts)
            times.append(time.perf_counter() - begin)
    return {form: float(np.median(times)) for form, times in seconds.items()}


def _legend(part: str) -> str:
    """Return the legend entry of a part: its name in tables, and its meaning."""
    text = PARTS[part]
    for plain, symbol in (("E_PDF", "E_{PDF}"), ("Lambda_n", r"\Lambda_n"), ("Lambda_t", r"\Lambda_t")):
        text = text.replace(plain, f"${symbol}$")
    return f"{part}: {text}"


@register_figure("budget")
def budget(run: xarray.Dataset, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """Draw contributions to C0 minus Love's stress in p and q against strain, divided by p from Love's stress.

    The figure also shows the error of the equation by volume, and the standard errors at one snapshot.
    """
    parts, love = run.lab.error_budget(), run.lab.love_stress().values
    by_volume = run.lab.sff_stress_by_volume().values - love
    p = mean_stress(love)
    strain_label, strain = strain_axis(run, at_snapshots=True)
    shown = [name for name in PARTS if np.abs(parts.sel(part=name).values).max() > 0.0]
    figure, axes = new_panels(1, 2, 5.0)
    for panel, of, name in zip(axes, (mean_stress, lambda error: run.lab.part_of_q(error, love)), "pq", strict=True):
        panel.axhline(0.0, color="0.5", lw=0.8)
        panel.plot(strain, 100 * of(parts.sum("part").values) / p, color="0.6", lw=5, label="C0 minus Love's stress")
        panel.plot(strain, 100 * of(by_volume) / p, "k-.", lw=1.2, label="equation by volume minus Love's stress")
        for color, ls, part in zip(colors_for(len(shown)), LINES, shown, strict=False):  # more lines
            error = 100 * of(parts.sel(part=part).values) / p
            panel.plot(strain, error, color=color, ls=ls, label=_legend(part))
        panel.set(xlabel=strain_label, ylabel=f"error of C0 in {name}, % of p")
    figure.key(2)
    add_heading(figure, run)
    at = run.lab.snapshot(snapshot)
    scatter = standard_errors(at) if len(at.contacts) else {}
    rows = [
        {
            **{name: parts[name].values[k] for name in STRAINS},
            "part": part,
            "p_error": mean_stress(parts.values[k, i]) / p[k],
            "q_error": run.lab.part_of_q(parts.values[k, i], love[k]) / p[k],
            "norm": np.linalg.norm(parts.values[k, i]) / np.linalg.norm(love[k]),
        }
        for k in range(len(love))
        for i, part in enumerate(PARTS)
    ]
    table = pandas.DataFrame(rows)
    last = {part: np.linalg.norm(error) / np.linalg.norm(love[snapshot]) for part, error in scatter.items()}
    here = np.repeat(np.arange(len(love)) == range(len(love))[snapshot], len(PARTS))
    table["norm_standard_error"] = np.where(here, table["part"].map(last), np.nan)
    return figure, table
