"""Figure of a calibration of the constitutive model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from labkit.figures.frame import colors_for, gray_lines, new_panels
from labkit.model.observation import Observation
from labkit.sff.c0 import strength_shares

AXIAL = np.diag([-0.5, -0.5, 1.0])  # deviatoric tensor of a triaxial test, divided by its zz component
STATISTICS = ("Z", "Lambda", "A_zz", "F_zz", "F^t_zz")


def calibration(observations: Sequence[Observation], predicted: Mapping[str, np.ndarray]) -> Figure:
    """Draw the five statistics and q/p from C0 against strain, for runs (solid) and the fitted model (dotted).

    Args:
        observations: Observations of the runs (labkit.model.observation).
        predicted: Predictions, name of the run -> (n, 5).
    """
    figure, grid = new_panels(2, 3, 6.0)
    panels = grid.ravel()
    for color, o in zip(colors_for(len(observations)), observations, strict=True):
        steps = np.linalg.norm(o.strain_step, axis=1)
        accumulated = 100 * np.concatenate([[0.0], np.cumsum(steps)])
        for values, style, width, name in ((o.values, "-", 1.0, o.name), (predicted[o.name], ":", 1.8, None)):
            for axes, column in zip(panels, [*values.T, _stress_ratio(values)], strict=True):
                axes.plot(accumulated, column, style, color=color, lw=width, label=name)
    for label, axes in zip((*STATISTICS, "q/p of C0"), panels, strict=True):
        axes.set(xlabel="accumulated strain |eps| (%)", ylabel=label)
    handles = panels[0].get_legend_handles_labels()[0] + gray_lines({"run": "-", "model": ":"})
    figure.key(6, handles)
    return figure


def _stress_ratio(values: np.ndarray) -> np.ndarray:
    """Return q/p from C0 for the statistics (n, 5) of triaxial tests."""
    A, F, Ft = (values[:, k, None, None] * AXIAL for k in (2, 3, 4))
    return np.sum(list(strength_shares(A, F, Ft).values()), axis=0)
