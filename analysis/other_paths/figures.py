"""Figures of the study: strength in the deviatoric plane and against b, and the error of C0 on each path."""

from __future__ import annotations

import numpy as np
import pandas
import xarray as xr
from matplotlib.figure import Figure

from analysis.legends import legend_below
from analysis.other_paths.errors import COMPONENTS, REFERENCE
from analysis.other_paths.strength import matsuoka_nakai
from analysis.places import texts
from labkit.figures import WIDTH, colors_for, new_figure

TESTS: dict[str, str] = texts(__file__)["tests"]  # test -> label
ON_B = ("compression", "triaxial_b0", "triaxial_b025", "triaxial_b05", "triaxial_b075", "triaxial_b1", "extension")


def lode_angle(b: np.ndarray) -> np.ndarray:
    """Lode angle, radians, from b: tan(theta) = sqrt(3) b/(2 - b)."""
    return np.arctan2(np.sqrt(3.0) * np.asarray(b), 2.0 - np.asarray(b))


def strength_figure(ends: pandas.DataFrame, means: pandas.DataFrame, model: pandas.DataFrame) -> Figure:
    """M against b (left) and the deviatoric plane (right), with Matsuoka and Nakai and the model.

    `model`: `b` and `M` of the constitutive model.
    """
    figure = new_figure(WIDTH, 4.4)
    left, right = figure.subplots(1, 2)
    compression = float(means.set_index("test").loc[REFERENCE, "M"])
    b = np.linspace(0.0, 1.0, 61)
    lines = {"Matsuoka-Nakai through compression": (b, matsuoka_nakai(b, compression), "-", "0.35")}
    lines["constant M"] = (b, np.full(b.size, compression), ":", "0.6")
    lines["model, Table 2"] = (model["b"].to_numpy(), model["M"].to_numpy(), "--", "tab:red")
    for label, (x, M, style, color) in lines.items():
        left.plot(x, M, style, color=color, label=label)
        angle = lode_angle(x)
        sector = np.concatenate([angle, (2 * np.pi / 3 - angle)[::-1]])
        whole = np.concatenate([sector + k * 2 * np.pi / 3 for k in range(3)])
        radius = np.tile(np.concatenate([M, M[::-1]]), 3)
        right.plot(radius * np.sin(whole), radius * np.cos(whole), style, color=color)
    kept = ends[ends["test"].isin(ON_B)]
    left.plot(kept["b"], kept["M"], ".", color="tab:blue", alpha=0.5, label="one specimen")
    shown = means[means["test"].isin(ON_B)]
    left.errorbar(
        shown["b"], shown["M"], shown["within"], fmt="o", ms=4, color="tab:blue", capsize=3, label="mean, 95 %"
    )
    angle = lode_angle(shown["b"].to_numpy(dtype=float))
    right.plot(shown["M"] * np.sin(angle), shown["M"] * np.cos(angle), "o", ms=4, color="tab:blue")
    for k, name in enumerate(("$\\sigma_z$", "$\\sigma_y$", "$\\sigma_x$")):
        x, y = np.sin(k * 2 * np.pi / 3), np.cos(k * 2 * np.pi / 3)
        right.plot([0.0, 1.15 * x], [0.0, 1.15 * y], color="0.8", lw=0.8, zorder=0)
        right.text(1.22 * x, 1.22 * y, name, ha="center", va="center")
    left.set(xlabel="b = ($\\sigma_2 - \\sigma_3$)/($\\sigma_1 - \\sigma_3$)", ylabel="M = q/p at the end of the test")
    left.grid(alpha=0.25)
    right.set_aspect("equal")
    right.set_axis_off()
    right.set_title("deviatoric plane, radius M", fontsize=10)
    legend_below(figure, left, 5, fontsize=8)
    return figure


def error_figure(errors: pandas.DataFrame) -> Figure:
    """Signed errors of C0 in p and q, and the error of each component, for every test; dots are specimens."""
    figure = new_figure(WIDTH, 4.8)
    axes = figure.subplots(1, 3, sharey=True, width_ratios=(1, 1, 1.3))
    tests = [test for test in TESTS if (errors["test"] == test).any()]
    for row, test in enumerate(tests):
        group = errors[errors["test"] == test]
        for panel, quantity in zip(axes, ("p", "q"), strict=False):
            values = 100 * group[quantity].to_numpy(dtype=float)
            panel.plot(values, np.full(values.size, row), ".", color="tab:blue", alpha=0.6)
            panel.plot(np.nanmean(values), row, "|", color="k", ms=12)
        for color, component in zip(colors_for(6), COMPONENTS, strict=True):
            label = component if row == 0 else None
            axes[2].plot(100 * group[component].mean(), row, "s", ms=4, color=color, label=label)
    for panel, label in zip(
        axes, ("error of p (%)", "error of q (%)", "RMS error of a component (% of p)"), strict=True
    ):
        panel.axvline(0.0, color="0.6", lw=0.8)
        panel.set_xlabel(label)
        panel.grid(alpha=0.25)
    axes[0].set_yticks(range(len(tests)), [TESTS[test] for test in tests])
    axes[0].invert_yaxis()
    legend_below(figure, axes[2], 6, fontsize=8)
    return figure


def rotation_figure(data: xr.Dataset) -> Figure:
    """Shear and normal stresses of Love and of C0 in simple shear and stress rotation, first specimen."""
    figure = new_figure(WIDTH, 3.6)
    panels = figure.subplots(1, 3)
    for panel, test in zip(panels, ("shear", "shear_cv", "rotation"), strict=True):
        names = data["run"].values[data["test"].values == test]
        if not len(names):
            continue
        run = data.sel(run=names[0])
        strain = 100 * run["accumulated_strain"].values
        for color, component in zip(colors_for(4), ("xx", "yy", "zz", "xz"), strict=True):
            i, j = COMPONENTS[component]
            for name, style in (("stress", "-"), ("stress_sff", "--")):
                label = component if style == "-" else None
                panel.plot(strain, run[name].values[:, i, j] / 1e6, style, color=color, label=label)
        panel.set(xlabel="accumulated strain (%)", ylabel="stress (MPa)", title=TESTS[test])
        panel.title.set_fontsize(10)
        panel.grid(alpha=0.25)
    panels[0].plot([], [], "-", color="0.3", label="Love")
    panels[0].plot([], [], "--", color="0.3", label="C0")
    legend_below(figure, panels[0], 6, fontsize=8)
    return figure
