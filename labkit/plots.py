"""Figures. Love (or DEM) is solid, C0 dashed; stress in MPa, strain in %."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402

from labkit.files import whole_file  # noqa: E402

WIDTH = 9.0  # inches
BLUE, RED = "#1f5fa8", "#b5382c"


def sff_against_love(runs):
    """q and p against axial strain, and q against p, of runs opened with labkit.open_run; a Figure.

    `runs`: label -> run.
    """
    figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 3.9), layout="constrained")
    for index, (label, run) in enumerate(runs.items()):
        strain = run["axial_strain"].values * 100
        alpha = 1.0 - 0.6 * index / max(1, len(runs))
        for name, style in (("stress", "-"), ("stress_sff", "--")):
            p, q = run.lab.mean_stress(name).values / 1e6, run.lab.deviatoric_stress(name).values / 1e6
            who = ("Love" if style == "-" else "C0") + (f", {label}" if len(runs) > 1 else "")
            left.plot(strain, q, style, color=BLUE, alpha=alpha, label=f"q, {who}")
            left.plot(strain, p, style, color=RED, alpha=alpha, label=f"p, {who}")
            right.plot(p, q, style, color="black", alpha=alpha, label=who)
    left.set(xlabel="axial strain (%)", ylabel="stress (MPa)", xlim=(0, None), ylim=(0, None))
    right.set(xlabel="mean stress p (MPa)", ylabel="deviatoric stress q (MPa)", xlim=(0, None), ylim=(0, None))
    for axes in (left, right):
        axes.legend(frameon=False, fontsize=8)
        axes.grid(alpha=0.25)
    return figure


def save(figure, path):
    """Writes a figure, whole or not at all, in the format of the name's ending, and closes it."""
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=150, format=Path(path).suffix[1:] or "png")
    plt.close(figure)
