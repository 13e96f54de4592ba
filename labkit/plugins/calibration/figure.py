"""Figure of a calibration of the constitutive model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from labkit.figures.frame import colors_for, gray_lines, new_panels, plain
from labkit.plugins.calibration.fitting import p_and_ratio
from labkit.plugins.calibration.observation import Observation

STATISTICS = ("Z", "$\\Lambda$", "$A_{zz}$", "$F_{zz}$", "$F^t_{zz}$")
FREE = "the fit also chooses the initial values of the model (circles), which differ from those of the run"


def draw_fit(observations: Sequence[Observation], predicted: Mapping[str, np.ndarray]) -> Figure:
    """Draw the five statistics and q/p from C0 against strain, for runs (solid) and the fitted model (dotted).

    A circle marks the initial value of the model, which is fitted, too.

    Args:
        observations: Observations of the runs (labkit.plugins.calibration.observation).
        predicted: Predictions, name of the run -> (n, 5).
    """
    figure, grid = new_panels(2, 3, 6.0)
    panels = grid.ravel()
    for color, o in zip(colors_for(len(observations)), observations, strict=True):
        steps = np.linalg.norm(o.strain_step, axis=1)
        accumulated = 100 * np.concatenate([[0.0], np.cumsum(steps)])
        for values, style, width, name in ((o.values, "-", 1.0, plain(o.name)), (predicted[o.name], ":", 1.8, None)):
            for axes, column in zip(panels, [*values.T, p_and_ratio(o, values)[1]], strict=True):
                axes.plot(accumulated, column, style, color=color, lw=width, label=name)
                if name is None:
                    axes.plot(accumulated[:1], column[:1], "o", color=color, mfc="none", ms=5, clip_on=False)
    for label, axes in zip((*STATISTICS, "q/p of C0"), panels, strict=True):
        axes.set(xlabel="accumulated strain $|\\varepsilon|$ (%)", ylabel=label)
    handles = panels[0].get_legend_handles_labels()[0] + gray_lines({"run": "-", "model": ":"})
    figure.key(6, handles, title=FREE)
    return figure
