"""Figures. Love (or DEM) is solid, C0 dashed; stress in MPa, strain in %."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.lines import Line2D  # noqa: E402

from labkit.files import whole_file  # noqa: E402

WIDTH = 10.0  # inches
STYLES = {"Love": ("stress", "-"), "C0": ("stress_sff", "--")}


def sff_against_love(runs):
    """q and p against axial strain, and q against p, of runs opened with labkit.open_run; a Figure.

    `runs`: label -> run. A colour is a run, solid is Love, dashed is C0.
    """
    figure, panels = plt.subplots(1, 3, figsize=(WIDTH, 3.6 + 0.22 * (len(runs) // 4)), layout="constrained")
    for color, (label, run) in zip(_colors(len(runs)), runs.items()):
        strain = run["axial_strain"].values * 100
        for name, style in STYLES.values():
            p, q = run.lab.mean_stress(name).values / 1e6, run.lab.deviatoric_stress(name).values / 1e6
            for axes, x, y in zip(panels, (strain, strain, p), (q, p, q)):
                axes.plot(x, y, style, color=color, label=label if style == "-" else None)
    for axes in panels:
        axes.set(xlabel="axial strain (%)", xlim=(0, None), ylim=(min(0, axes.get_ylim()[0]), None))
        axes.grid(alpha=0.25)
    panels[0].set(ylabel="deviatoric stress q (MPa)")
    panels[1].set(ylabel="mean stress p (MPa)")
    panels[2].set(xlabel="mean stress p (MPa)", ylabel="deviatoric stress q (MPa)")
    lines = [Line2D([], [], color="0.3", linestyle=style, label=who) for who, (_, style) in STYLES.items()]
    runs_and_styles = panels[0].get_legend_handles_labels()[0] + lines
    figure.legend(handles=runs_and_styles, loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    return figure


def _colors(number):
    return plt.get_cmap("tab10").colors[:number] if number <= 10 else plt.get_cmap("viridis")(np.linspace(0, 1, number))


def save(figure, path):
    """Writes a figure, whole or not at all, in the format of the name's ending, and closes it."""
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=150, format=Path(path).suffix[1:] or "png")
    plt.close(figure)
