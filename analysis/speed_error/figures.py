"""Figures of a study: cost against error, the effect of each factor, and the effect of the number of grains."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, ScalarFormatter

from analysis.legends import legend_below
from analysis.places import texts
from analysis.speed_error.design import BASELINE, MIXED, PRESET
from analysis.speed_error.errors import front

WIDTH = 7.2  # inches: the width of a page, so that text keeps its size there
DPI = 160
STYLE: dict[Any, Any] = {"font.size": 8.5, "axes.titlesize": 9.5, "axes.labelsize": 8.5, "legend.fontsize": 8.5}
COLUMNS = 3
FACTORS: dict[str, tuple[str, float, float]] = texts(__file__)["factors"]
SHOWN = ("ratio_1", "ratio_peak", "ratio_critical", "void_ratio_critical", "Z_critical", "Lambda_critical")
PLAIN = FuncFormatter(lambda value, _: f"{value:g}")
WORST = 30.0  # per cent: larger errors are drawn at the top of a panel
STARS = {"quick": "tab:green", "standard": "tab:blue", "reference": "k", "the paper's": "tab:red"}
GROUPS = {  # label in the legend -> colour, marker, factors
    "number of grains": ("#0072b2", "o", (BASELINE, "grains")),
    "time step": ("#e69f00", "s", ("time step",)),
    "rate": ("#cc79a7", "D", ("rate",)),
    "inertial number, precision": ("#f0e442", "X", ("inertial number", "precision", "inertial number x precision")),
    "mixed precision, more grains": ("k", "X", (MIXED,)),
    "servo, records": ("#009e73", "^", ("servo interval", "servo gain", "record interval")),
    "contact law, damping, E": ("#56b4e9", "v", ("law", "rolling", "local damping", "Young's modulus")),
    "engine": ("#d55e00", "P", ("engine",)),
    "two factors at once": ("0.55", ".", ()),  # all others
}


def pareto(table: pandas.DataFrame, path: str = "cp") -> Figure:
    """Cost against the error of one test for every observable, with the Pareto front and the presets.

    `table`: from analysis.speed_error.errors.errors. Costs are relative to the standard settings.
    """
    table = table[(table["path"] == path) & np.isfinite(table["one_run"]) & (table["one_run"] > 0)]
    names = [name for name in table["observable"].unique() if not _constant(table, name)]
    rows = max(1, -(-len(names) // COLUMNS))
    figure, grid = plt.subplots(
        rows, COLUMNS, figsize=(WIDTH, 2.25 * rows), layout="constrained", squeeze=False, sharex=True
    )
    for axes, name in zip(grid.ravel(), names, strict=False):
        _cost_against_error(axes, table[table["observable"] == name])
    for axes in grid.ravel()[len(names) :]:
        axes.axis("off")
    for axes in grid.ravel():
        axes.tick_params(labelbottom=True)
    for axes in grid[-1]:
        axes.set_xlabel("cost relative to standard")
    for axes in grid[:, 0]:
        axes.set_ylabel("error of one test (%)")
    levels = {level: color for level, color in STARS.items() if (table["level"] == level).any()}
    shown = dict.fromkeys(_group(factor) for factor in table["factor"].unique() if factor != PRESET)
    handles = [
        Line2D([], [], ls="", marker=marker, ms=5, color=color, label=label)
        for label, (color, marker, _) in GROUPS.items()
        if label in shown
    ]
    handles += [Line2D([], [], ls="", marker="*", ms=11, color=c, label=level) for level, c in levels.items()]
    handles.append(Line2D([], [], color="0.5", lw=1, label="Pareto front"))
    free = grid.ravel()[len(names) :]
    if len(free):
        free[0].legend(handles=handles, loc="center", frameon=False, labelspacing=0.3)
    else:
        legend_below(figure, handles, 4)
    return figure


def _cost_against_error(axes: Axes, some: pandas.DataFrame) -> None:
    """One panel of pareto(): the cases of one observable."""
    for factor, points in some[some["factor"] != PRESET].groupby("factor"):
        color, marker, _ = GROUPS[_group(str(factor))]
        axes.plot(points["over_standard"], _clipped(points), marker, ms=4, color=color, mec="w", mew=0.3)
    rivals = some[some["level"] != "reference"]
    best = rivals.iloc[front(rivals["over_standard"].to_numpy(), rivals["one_run"].to_numpy())]
    axes.plot(best["over_standard"], _clipped(best), "-", color="0.5", lw=1, zorder=0)
    for level, color in STARS.items():
        star = some[(some["factor"] == PRESET) & (some["level"] == level)]
        axes.plot(star["over_standard"], _clipped(star), "*", ms=11, color=color, mec="w", mew=0.5)
    axes.set(xscale="log", yscale="log", title=some["label"].iloc[0])
    errors = _clipped(some)
    axes.set_ylim(0.7 * errors.min(), 1.4 * errors.max())
    for axis, values in ((axes.xaxis, some["over_standard"].to_numpy()), (axes.yaxis, errors)):
        few_decades = values.max() < 50.0 * values.min()
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few_decades else (1.0,), numticks=12))
        axis.set_major_formatter(PLAIN)
        axis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.25)


def _group(factor: str) -> str:
    return next((label for label, (*_, factors) in GROUPS.items() if factor in factors), list(GROUPS)[-1])


def _clipped(points: pandas.DataFrame) -> np.ndarray:
    """The error of one test, %, at most WORST."""
    return np.minimum(100.0 * points["one_run"].to_numpy(), WORST)


def _constant(table: pandas.DataFrame, name: str) -> bool:
    """True if the path holds the observable constant."""
    values = table.loc[(table["observable"] == name) & (table["factor"] == BASELINE)]
    return bool((values["scatter"] < 1e-3).all()) and name != "sff_error"


def changes(table: pandas.DataFrame, path: str = "cp") -> Figure:
    """Change of the observables with the level of each factor, relative to the baseline with the same specimens.

    A row per observable of SHOWN, a column per factor of FACTORS; bars are 95 % intervals, and a hollow point marks an
    interval that includes zero. Outliers that would compress the other points are drawn at the edge of the
    panel.
    """
    table = table[table["path"] == path]
    rows, columns, size = len(SHOWN), len(FACTORS), (WIDTH, 1.2 * len(SHOWN) + 1.2)
    figure, grid = plt.subplots(rows, columns, figsize=size, layout="constrained", sharex="col", sharey="row")
    for row, name in zip(grid, SHOWN, strict=True):
        some = table[(table["observable"] == name) & np.isfinite(table["change"])]
        numeric = some[some["factor"].isin(FACTORS)]
        top = 300 * np.nanquantile(np.abs(numeric["change"]), 0.7) if len(numeric) else 1.0
        for axes, (factor, (_label, base, unit)) in zip(row, FACTORS.items(), strict=True):
            points = numeric[numeric["factor"] == factor]
            x = points["level"].astype(float).values / unit
            y, within = 100 * points["change"].values, 100 * points["change_within"].values
            axes.axhline(0.0, color="0.5", lw=0.8)
            axes.axvline(base / unit, color="0.5", lw=0.8, ls=":")
            clear = np.abs(y) > within
            shown = np.clip(y, -0.97 * top, 0.97 * top)
            axes.errorbar(x, shown, yerr=within, fmt="none", ecolor="0.6", lw=1)
            axes.plot(x[clear], shown[clear], "o", ms=3.5, color="tab:blue")
            axes.plot(x[~clear], shown[~clear], "o", ms=3.5, mfc="w", color="tab:blue")
            axes.set(xscale="log", ylim=(-top, top))
            axes.xaxis.set_major_locator(LogLocator(numticks=4))
            axes.xaxis.set_major_formatter(PLAIN)
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.grid(alpha=0.25)
        row[0].set_ylabel(f"{some['label'].iloc[0]}\nchange (%)" if len(some) else name)
    for axes, (label, *_) in zip(grid[-1], FACTORS.values(), strict=True):
        axes.set_xlabel(label)
    handles = [
        Line2D([], [], ls="", marker="o", color="tab:blue", label="95 % interval excludes zero"),
        Line2D([], [], ls="", marker="o", mfc="w", color="tab:blue", label="not distinguishable from zero"),
        Line2D([], [], ls=":", color="0.5", label="baseline"),
    ]
    legend_below(figure, handles, 3)
    return figure


def sizes(table: pandas.DataFrame) -> Figure:
    """Scatter between specimens and mean error against the number of grains."""
    table = table[(table["path"] == "cp") & (table["factor"].isin(["grains", BASELINE, PRESET]))]
    table = table[table["factor"].ne(PRESET) | table["level"].eq("standard")]
    figure, panels = plt.subplots(1, 2, figsize=(WIDTH, 3.6), layout="constrained")
    for k, name in enumerate(SHOWN):
        some = table[table["observable"] == name].sort_values("number_of_grains")
        x = some["number_of_grains"].values
        shifted = x * 1.04 ** (k - 0.5 * (len(SHOWN) - 1))  # shifted so that the bars do not overlap
        scatter, error, within = (100 * some[name].values for name in ("scatter", "error", "error_within"))
        panels[0].loglog(x, scatter, "o-", ms=4, label=some["label"].iloc[0])
        panels[1].errorbar(shifted, error, yerr=within, fmt="o-", ms=4, capsize=2)
    x = np.array(sorted(table["number_of_grains"].unique()))
    panels[0].loglog(x, 5 * np.sqrt(x[0] / x), "k:", lw=1, label="1/sqrt(grains)")
    panels[0].set(xlabel="grains", ylabel="scatter between specimens (%)")
    panels[1].set(xlabel="grains", ylabel="error against the reference (%)", xscale="log")
    for axes in panels:
        axes.xaxis.set_major_formatter(ScalarFormatter())
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xticks(x)
        axes.tick_params(axis="x", labelsize=7, rotation=45)
        axes.grid(alpha=0.25)
    legend_below(figure, panels[0], 4, fontsize=8)
    return figure
