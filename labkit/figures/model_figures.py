"""Figure of a calibration of the constitutive model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from labkit.figures.frame import WIDTH, colors_for, gray_lines, new_figure

STATISTICS = ("Z", "Lambda", "A_zz", "F_zz", "F^t_zz")


def calibration(observations: Sequence[Any], predicted: Mapping[str, np.ndarray]) -> Figure:
    """Draw the five statistics of runs (solid) and of the fitted model (dotted) against the accumulated strain.

    Args:
        observations: Observations of the runs (labkit.model.observation).
        predicted: Predictions, name of the run -> (n, 5).
    """
    figure = new_figure(WIDTH, 6.0)
    panels = figure.panels(2, 3).ravel()
    for color, o in zip(colors_for(len(observations)), observations, strict=True):
        steps = np.linalg.norm(o.strain_step, axis=1)
        accumulated = 100 * np.concatenate([[0.0], np.cumsum(steps)])
        for k, axes in enumerate(panels[:5]):
            axes.plot(accumulated, o.values[:, k], "-", color=color, lw=1.0, label=o.name)
            axes.plot(accumulated, predicted[o.name][:, k], ":", color=color, lw=1.8)
    for label, axes in zip(STATISTICS, panels[:5], strict=True):
        axes.set(xlabel="accumulated strain |eps| (%)", ylabel=label)
    panels[5].axis("off")
    handles = panels[0].get_legend_handles_labels()[0] + gray_lines({"run": "-", "model": ":"})
    panels[5].legend(handles=handles, loc="center", frameon=False, fontsize=8, ncols=1 + len(handles) // 14)
    return figure
