"""Figures of the study: drift with strain, and scatter and means against the number of grains."""

from __future__ import annotations

import numpy as np
import pandas
from matplotlib.figure import Figure

from analysis.critical_state.figures import LABELS
from analysis.legends import legend_below
from analysis.size_scatter.sizes import HALF, SMALL
from labkit.figures import WIDTH, colors_for, new_figure

SHOWN = ("M", "Lambda", "Z", "A", "F", "Ft")


def drift_figure(curves: pandas.DataFrame, window: tuple[float, float]) -> Figure:
    """Curves of each size against strain, mean and standard deviation over specimens; shaded: the window."""
    figure = new_figure(WIDTH * 1.2, 5.6)
    axes = figure.subplots(2, 3, sharex=True).ravel()
    sizes = list(dict.fromkeys(curves["size"]))
    for color, size in zip(colors_for(len(sizes)), sizes, strict=True):
        tests = curves[curves["size"] == size].assign(at=lambda rows: rows.groupby("run").cumcount())
        strain = 100 * tests.groupby("at")["strain"].mean()
        for panel, quantity in zip(axes, SHOWN, strict=True):
            mean, scatter = (tests.groupby("at")[quantity].agg(how) for how in ("mean", "std"))
            panel.plot(strain, mean, color=color, label=f"{size[1:]} grains ({tests['run'].nunique()})")
            panel.fill_between(strain, mean - scatter, mean + scatter, color=color, alpha=0.2, lw=0)
    for panel, quantity in zip(axes, SHOWN, strict=True):
        settled = curves[curves["strain"] > 0.1][quantity]
        panel.set(ylabel=LABELS[quantity], ylim=(settled.min(), settled.max()))
        panel.axvspan(100 * window[0], 100 * window[1], color="0.92", zorder=0)
    for panel in axes[3:]:
        panel.set_xlabel("axial strain (%)")
    legend_below(figure, axes[0], 5)
    return figure


def sizes_figure(ends: pandas.DataFrame, sizes: pandas.DataFrame, scatter: pandas.DataFrame) -> Figure:
    """Relative scatter against N with N^-1/2 (left), and deviations of the means from the largest size (right)."""
    figure = new_figure(WIDTH * 1.2, 7.4)
    axes = figure.subplots(2, 3, sharex=True).ravel()
    laws = scatter.set_index("quantity")
    for panel, quantity in zip(axes, SHOWN, strict=True):
        rows = sizes[sizes["quantity"] == quantity]
        panel.plot(ends["grains"], ends[quantity], ".", color="0.7", label="one specimen")
        panel.errorbar(
            rows["grains"], rows["mean"], rows["within"], fmt="o", ms=4, capsize=3, color="tab:blue",
            label="mean, 95 % interval",
        )  # fmt: skip
        grains = np.geomspace(0.8 * rows["grains"].min(), 1.2 * rows["grains"].max(), 50)
        largest = float(rows["mean"].iloc[-1])
        law = laws.loc[quantity, "relative"] * abs(largest) * (grains / SMALL) ** -HALF
        for sign in (1.0, -1.0):
            label = "largest size ± scatter $\\propto N^{-1/2}$" if sign > 0 else None
            panel.plot(grains, largest + sign * law, "--", color="tab:orange", lw=1, label=label)
        panel.set_xscale("log")
        law_text = "exponent {exponent:.2f} ({low:.2f} to {high:.2f})".format(**laws.loc[quantity])
        panel.set_title(law_text, fontsize=9)
        panel.set_ylabel(LABELS[quantity])
    for panel in axes[3:]:
        panel.set_xlabel("number of grains")
    legend_below(figure, axes[0], 3)
    return figure
