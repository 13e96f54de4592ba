"""Figures of a study: cost against error, and what each factor changes."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pandas
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter, NullLocator, ScalarFormatter

from analysis.speed_error.design import BASELINE, PRESET
from analysis.speed_error.errors import front
from labkit.visuals import plots

FACTORS = {  # those with numbers: label of the axis, level of the baseline
    "time step": ("time step over sqrt(m/kn)", 0.2),
    "rate": ("axial strain rate (1/s)", 10.0),
    "local damping": ("local damping", 0.2),
    "servo interval": ("steps between corrections", 5),
    "servo gain": ("gain of the servo", 2.0),
    "Young's modulus": ("E (Pa)", 0.15e9),
}
SHOWN = ("ratio_1", "ratio_peak", "ratio_critical", "void_ratio_critical", "Z_critical", "Lambda_critical")
COSTS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
STARS = {"quick": "tab:green", "standard": "tab:blue", "reference": "k", "the paper's": "tab:red"}


def pareto(table: pandas.DataFrame, path: str = "cp") -> Figure:
    """Cost against the error of one test for every observable, with the front and the sets of settings; a Figure.

    `table`: of analysis.speed_error.errors.errors. Cost is over that of the standard settings.
    """
    table = table[(table["path"] == path) & np.isfinite(table["one_run"]) & (table["one_run"] > 0)]
    names = [name for name in table["observable"].unique() if not _constant(table, name)]
    rows = -(-len(names) // 4)
    figure, grid = plt.subplots(rows, 4, figsize=(1.35 * plots.WIDTH, 3.1 * rows), layout="constrained", squeeze=False)
    factors = [f for f in table["factor"].unique() if f != PRESET]
    colors = dict(zip(factors, plt.get_cmap("tab20").colors + plt.get_cmap("Dark2").colors, strict=False))
    for axes, name in zip(grid.ravel(), names, strict=False):
        some = table[table["observable"] == name]
        for factor, points in some[some["factor"] != PRESET].groupby("factor"):
            axes.loglog(points["over_standard"], 100 * points["one_run"], "o", ms=3.5, color=colors[factor])
        rivals = some[some["level"] != "reference"]
        best = rivals.iloc[front(rivals["over_standard"].values, rivals["one_run"].values)]
        axes.loglog(best["over_standard"], 100 * best["one_run"], "-", color="0.6", lw=1, zorder=0)
        for level, color in STARS.items():
            star = some[(some["factor"] == PRESET) & (some["level"] == level)]
            axes.loglog(star["over_standard"], 100 * star["one_run"], "*", ms=13, color=color, mec="w", mew=0.5)
        relative = "(%)" if name != "sff_error" else "(% of Love)"
        axes.xaxis.set_minor_formatter(NullFormatter())
        if np.ptp(np.log10(some["over_standard"])) < 2.0:  # a single decade would be named, or none
            axes.set_xticks(COSTS, [f"{cost:g}" for cost in COSTS])
            axes.set_xlim(0.8 * some["over_standard"].min(), 1.25 * some["over_standard"].max())
        axes.set(title=some["label"].iloc[0], xlabel="cost over standard", ylabel=f"error of one test {relative}")
        axes.title.set_fontsize(10)
        axes.grid(alpha=0.25)
    for axes in grid.ravel()[len(names) :]:
        axes.axis("off")
    handles = [Line2D([], [], ls="", marker="o", ms=4, color=colors[f], label=f) for f in factors]
    there = {level: c for level, c in STARS.items() if (table["level"] == level).any()}
    handles += [Line2D([], [], ls="", marker="*", ms=12, color=c, label=level) for level, c in there.items()]
    handles.append(Line2D([], [], color="0.6", lw=1, label="front"))
    figure.legend(handles=handles, loc="outside lower center", ncols=7, frameon=False, fontsize=8)
    return figure


def _constant(table, name):
    """Whether an observable is held by the path."""
    values = table.loc[(table["observable"] == name) & (table["factor"] == BASELINE)]
    return (values["scatter"] < 1e-3).all() and name != "sff_error"


def changes(table: pandas.DataFrame, path: str = "cp") -> Figure:
    """What the levels of a factor change against the baseline with the same specimens; a Figure.

    A row per observable of SHOWN, a column per factor of FACTORS; bars are 95 % intervals, a hollow point's reaches
    zero. Cases that are so far off that nothing else could be seen lie on the frame.
    """
    table = table[table["path"] == path]
    figure, grid = plt.subplots(
        len(SHOWN),
        len(FACTORS),
        figsize=(1.35 * plots.WIDTH, 1.75 * len(SHOWN)),
        layout="constrained",
        sharex="col",
        sharey="row",
    )
    for row, name in zip(grid, SHOWN, strict=True):
        some = table[(table["observable"] == name) & np.isfinite(table["change"])]
        numeric = some[some["factor"].isin(FACTORS)]
        top = 300 * np.nanquantile(np.abs(numeric["change"]), 0.7) if len(numeric) else 1.0
        for axes, (factor, (label, base)) in zip(row, FACTORS.items(), strict=True):
            points = numeric[numeric["factor"] == factor]
            x = points["level"].astype(float).values
            y, within = 100 * points["change"].values, 100 * points["change_within"].values
            axes.axhline(0.0, color="0.5", lw=0.8)
            axes.axvline(base, color="0.5", lw=0.8, ls=":")
            clear = np.abs(y) > within
            shown = np.clip(y, -0.97 * top, 0.97 * top)
            axes.errorbar(x, shown, yerr=within, fmt="none", ecolor="0.6", lw=1)
            axes.plot(x[clear], shown[clear], "o", ms=5, color="tab:blue")
            axes.plot(x[~clear], shown[~clear], "o", ms=5, mfc="w", color="tab:blue")
            axes.set(xscale="log", ylim=(-top, top))
            axes.xaxis.set_minor_locator(NullLocator())
            axes.set_xticks([*x, base], [f"{v:.3g}" for v in [*x, base]], rotation=75, fontsize=8)
            axes.grid(alpha=0.25)
        row[0].set_ylabel(f"{some['label'].iloc[0]}\nchange (%)" if len(some) else name)
    for axes, (label, _) in zip(grid[-1], FACTORS.values(), strict=True):
        axes.set_xlabel(label)
    handles = [
        Line2D([], [], ls="", marker="o", color="tab:blue", label="outside its 95 % interval"),
        Line2D([], [], ls="", marker="o", mfc="w", color="tab:blue", label="inside: not told from zero"),
        Line2D([], [], ls=":", color="0.5", label="baseline"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return figure


def sizes(table: pandas.DataFrame) -> Figure:
    """Scatter between seeds and mean error against the number of grains; a Figure."""
    table = table[(table["path"] == "cp") & (table["factor"].isin(["grains", BASELINE, PRESET]))]
    table = table[table["factor"].ne(PRESET) | table["level"].eq("standard")]
    figure, panels = plt.subplots(1, 2, figsize=(plots.WIDTH, 4.2), layout="constrained")
    for k, name in enumerate(SHOWN):
        some = table[table["observable"] == name].sort_values("number_of_grains")
        x = some["number_of_grains"].values
        beside = x * 1.04 ** (k - 0.5 * (len(SHOWN) - 1))  # so that no interval hides another
        panels[0].loglog(x, 100 * some["scatter"].values, "o-", ms=4, label=some["label"].iloc[0])
        panels[1].errorbar(
            beside,
            100 * some["error"].values,
            yerr=100 * some["error_within"].values,
            fmt="o-",
            ms=4,
            capsize=2,
            label=some["label"].iloc[0],
        )
    x = np.array(sorted(table["number_of_grains"].unique()))
    panels[0].loglog(x, 5 * np.sqrt(x[0] / x), "k:", lw=1, label="1/sqrt(grains)")
    panels[0].set(xlabel="grains", ylabel="scatter between specimens (%)")
    panels[1].set(xlabel="grains", ylabel="error against the reference (%)", xscale="log")
    for axes in panels:
        axes.xaxis.set_major_formatter(ScalarFormatter())
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xticks(x)
        axes.tick_params(axis="x", labelsize=8)
        axes.grid(alpha=0.25)
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    return figure
