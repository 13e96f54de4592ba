"""Figures of the study: the balance under isotropic stress, and the CR tests by direction and by Z."""

from __future__ import annotations

import numpy as np
import pandas
import xarray as xr
from matplotlib.figure import Figure

from analysis.initial_fabric.loading import ANGLES, STRAIN, specimen_of
from analysis.initial_fabric.response import KINDS, model_curves
from analysis.legends import legend_below
from analysis.places import texts
from labkit.figures import WIDTH, colors_for, new_figure

CURVES: dict[str, str] = texts(__file__)["curves"]


def balance_figure(states: pandas.DataFrame) -> Figure:
    """F against A along the axis of the previous shear, and F against the F that balances A with and without F^t."""
    figure = new_figure(WIDTH, 4.0)
    left, right = figure.subplots(1, 2)
    after = states[states["test"].isin(ANGLES)]
    for color, (test, angle) in zip(colors_for(len(ANGLES)), ANGLES.items(), strict=True):
        rows = after[after["test"] == test]
        label = f"sheared before at {angle:.0f}°"
        left.plot(rows["A"], rows["F"], "o", color=color, mfc="none", label=f"$F$, {label}")
        left.plot(rows["A"], 7.5 * rows["Ft"], "^", color=color, mfc="none", label=f"$15/2\\,F^t$, {label}")
        right.plot(rows["F_paper"], rows["F"], "s", color=color, label=f"section 5.3, {label}")
        right.plot(rows["F_with_Ft"], rows["F"], "o", color=color, mfc="none", label=f"with $F^t$, {label}")
    A = np.linspace(0.0, 1.1 * float(after["A"].max()), 50)
    left.plot(A, -A / (1.0 + 4.0 / 7.0 * A), "-", color="0.4", label="$F = -A\\,[1 + 4/7\\,A]^{-1}$ (section 5.3)")
    left.set(xlabel="$A$ along the axis of the shear", ylabel="$F$, $15/2\\,F^t$ along that axis")
    ends = np.array([1.1 * float(after["F_paper"].min()), 0.0])
    right.plot(ends, ends, "-", color="0.4", label="measured = predicted")
    right.set(xlabel="predicted $F$", ylabel="measured $F$")
    for panel in (left, right):
        panel.axhline(0.0, color="0.8", lw=0.8, zorder=0)
        panel.legend(fontsize=7)
    return figure


def _mean_curves(data: xr.Dataset, names: list[str], model: bool) -> dict[str, np.ndarray]:
    """Means over runs of CURVES at STRAIN, in the grains or in the model; volumetric strain in %."""
    curves = [model_curves(data.sel(run=n)) if model else {k: data[k].sel(run=n).values for k in CURVES} for n in names]
    return {key: (100.0 if key == "volumetric" else 1.0) * np.mean([c[key] for c in curves], axis=0) for key in CURVES}


def _draw(axes: np.ndarray, data: xr.Dataset, names: list[str], color: object, label: str) -> None:
    """Mean curves of some runs: solid lines for the grains, dashed ones for the model."""
    for model, style in ((False, "-"), (True, "--")):
        for panel, (key, values) in zip(axes, _mean_curves(data, names, model).items(), strict=True):
            shown = None if model else f"{label} ({len(names)})"
            panel.plot(100 * STRAIN, values, style, color=color, label=shown)
            panel.set_ylabel(CURVES[key])


def directions_figure(data: xr.Dataset) -> Figure:
    """CR tests after shear at 0, 45 and 90 degrees and without it; grains (solid) and model (dashed)."""
    figure = new_figure(WIDTH * 1.2, 3.9)
    axes = figure.subplots(1, 3)
    runs = [str(name) for name in data["run"].values]
    tests = {**{test: f"sheared before at {angle:.0f}°" for test, angle in ANGLES.items()}, "none": "not sheared"}
    for color, (test, label) in zip(colors_for(len(tests)), tests.items(), strict=True):
        names = [name for name in runs if name.startswith(f"{test}-loose")]
        if names:
            _draw(axes, data, names, color, label)
    for panel in axes:
        panel.set_xlabel("axial strain (%)")
    legend_below(figure, axes[0], 4)
    return figure


def twins_figure(data: xr.Dataset) -> Figure:
    """CR tests of twins, high and low Z at equal e and p; grains (solid) and model (dashed); a row per kind."""
    runs = [str(name) for name in data["run"].values]
    kinds = {kind: [_tests(runs, *one) for one in pair] for kind, pair in KINDS.items()}
    kinds = {kind: pair for kind, pair in kinds.items() if all(pair)}
    figure = new_figure(WIDTH * 1.2, 0.4 + 3.0 * max(len(kinds), 1))
    rows = figure.subplots(max(len(kinds), 1), 3, sharex=True, squeeze=False)
    for axes, (kind, pair) in zip(rows, kinds.items(), strict=False):
        for color, names, label in zip(colors_for(2), pair, ("high Z", "low Z"), strict=True):
            _draw(axes, data, names, color, label)
        axes[0].set_title(kind)
        axes[2].legend(fontsize=8)
    for panel in rows[-1]:
        panel.set_xlabel("axial strain (%)")
    return figure


def _tests(runs: list[str], test: str, group: str) -> list[str]:
    """The runs of a test on a group of specimens."""
    return [n for n in runs if n.partition("-")[0] == test and specimen_of(n).partition("-")[0] == group]
