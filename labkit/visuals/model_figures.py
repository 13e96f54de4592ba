"""Figures of the constitutive model: calibration, and time against error of its integrators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from labkit.visuals.frame import WIDTH, colors_for, new_figure

STATISTICS = ("Z", "Lambda", "A_zz", "F_zz", "F^t_zz")


def calibration(observations: Sequence[Any], predicted: Mapping[str, np.ndarray]) -> Figure:
    """The five statistics of runs and of the fitted model against the accumulated strain; a Figure.

    `observations`: from labkit.model.observation; `predicted`: name of the run -> (n, 5). Runs are solid, the model is
    dotted.
    """
    figure = new_figure(WIDTH, 6.0)
    panels = figure.subplots(2, 3).ravel()
    for color, o in zip(colors_for(len(observations)), observations, strict=True):
        steps = np.linalg.norm(o.strain_step, axis=1)
        accumulated = 100 * np.concatenate([[0.0], np.cumsum(steps)])
        for k, axes in enumerate(panels[:5]):
            axes.plot(accumulated, o.values[:, k], "-", color=color, lw=1.0, label=o.name)
            axes.plot(accumulated, predicted[o.name][:, k], ":", color=color, lw=1.8)
    for label, axes in zip(STATISTICS, panels[:5], strict=True):
        axes.set(xlabel="accumulated strain |eps| (%)", ylabel=label)
        axes.grid(alpha=0.25)
    panels[5].axis("off")
    styles: dict[str, Literal["-", ":"]] = {"run": "-", "model": ":"}
    lines = [Line2D([], [], color="0.3", linestyle=style, label=who) for who, style in styles.items()]
    handles = panels[0].get_legend_handles_labels()[0] + lines
    panels[5].legend(handles=handles, loc="center", frameon=False, fontsize=8, ncols=1 + len(handles) // 14)
    return figure


def work_precision(panels: Mapping[str, Mapping[str, Sequence[tuple[float, float, float | None]]]]) -> Figure:
    """Computing time against error of integrators; a Figure.

    `panels`: title -> (label -> list of (setting, seconds, error)). Settings at which an integrator failed have no
    error and are not drawn.
    """
    figure = new_figure(WIDTH * 1.3, 4.6)
    grid = figure.subplots(1, len(panels), squeeze=False)
    colors = matplotlib.color_sequences["tab20"]
    for axes, (title, results) in zip(grid[0], panels.items(), strict=True):
        for number, (label, points) in enumerate(results.items()):
            kept = np.array([(error, 1e3 * seconds) for _, seconds, error in points if error])
            color, marker = colors[number % 20], "osD^v<>*PXhp"[number % 12]
            if len(kept):
                axes.loglog(*kept.T, marker=marker, ms=4, lw=1.2, color=color, label=label)
        axes.set(xlabel="relative error of the stress", ylabel="time (ms)", title=title)
        axes.title.set_fontsize(10)
        axes.invert_xaxis()
        axes.grid(alpha=0.25)
    handles = {h.get_label(): h for axes in grid[0] for h in axes.get_legend_handles_labels()[0]}
    figure.legend(handles=list(handles.values()), loc="outside lower center", ncols=6, frameon=False, fontsize=8)
    return figure
