"""Figure of a grading: the size distribution that the scene requests, and the size distribution of the grains."""

from __future__ import annotations

import numpy as np
import pandas
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from labkit.figures.frame import WIDTH, colors_for, panel_in, plain_ticks
from labkit.grains.state import State

SHARES = (0.1, 0.3, 0.5, 0.6, 0.9)


def grading_table(state: State) -> pandas.DataFrame:
    """Tabulate diameters of grading and grains, m: extremes, mean by number, and D10 to D90 by mass and by number."""
    sizes, radius = state.scene.sizes, np.sort(state.body_radius)
    rows = [
        ("smallest", sizes.smallest, 2.0 * radius[0]),
        ("largest", sizes.largest, 2.0 * radius[-1]),
        ("mean by number", sizes.mean_diameter, 2.0 * radius.mean()),
    ]
    for by, weight in (("mass", radius**3), ("number", np.ones_like(radius))):
        passing = _passing(weight)
        for share in SHARES:
            diameter = float(np.interp(share, passing, 2.0 * radius))
            rows.append((f"D{100 * share:.0f} by {by}", sizes.percentile(share, by), diameter))
    return pandas.DataFrame(rows, columns=["diameter", "grading, m", "grains, m"])


def grading(state: State, ax: Axes | None = None) -> Figure:
    """Draw the fraction that passes against diameter, by mass and by number; lines: the grading, steps: the grains.

    `ax` is the Axes to draw in, by default those of a new figure.
    """
    sizes, radius = state.scene.sizes, np.sort(state.body_radius)
    figure, axes = panel_in(ax, 0.45 * WIDTH, 0.75 * WIDTH)
    for by, weight, color in zip(("mass", "number"), (radius**3, np.ones_like(radius)), colors_for(2), strict=True):
        asked = sizes.table.by_mass if by == "mass" else sizes.table.by_number
        axes.plot(1e3 * sizes.table.diameter, 100.0 * asked, color=color, label=f"by {by}, grading")
        shares = 100.0 * np.concatenate([[0.0], np.cumsum(weight) / weight.sum()])
        steps = 2e3 * np.concatenate([radius, radius[-1:]])
        axes.step(steps, shares, "--", color=color, where="post", label=f"by {by}, {state.contents}")
    axes.set(xscale="log", xlabel="diameter (mm)", ylabel="passing (%)", ylim=(0, 100))
    plain_ticks(axes.xaxis)
    axes.legend()
    return figure


def _passing(weight: np.ndarray) -> np.ndarray:
    """Return the fraction that passes a sieve of the size of each grain, counting half of the grain itself."""
    return (np.cumsum(weight) - 0.5 * weight) / weight.sum()
