"""The figure of six hard cases on all engines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import labkit as lk
from analysis.hard_cases.cases.cycles import cycle_ends
from analysis.legends import legend_below
from labkit.figures import plots
from labkit.records import OVERLAP_LIMIT, pressure_limit

Style = dict[str, Any]

STYLES: dict[str, Style] = {
    "yade": {"color": "tab:blue", "ls": "-"},
    "fused": {"color": "tab:orange", "ls": "--"},
    "mixed": {"color": "tab:green", "ls": ":"},
}
REFERENCE: Style = {"color": "0.6", "ls": "-", "lw": 0.9, "zorder": 0, "label": "fused, half the time step"}


def draw(folder: Path, engines: Sequence[str], names: Sequence[str]) -> Figure | None:
    """Figure with those of the six panels whose cases are in `names`; None if there are none."""
    wanted = [(name, panel) for name, panel in PANELS.items() if name in names]
    columns = min(3, len(wanted))
    if not wanted:
        return None
    rows = -(-len(wanted) // columns)
    figure, grid = plt.subplots(
        rows, columns, figsize=(plots.WIDTH * 1.2 * columns / 3, 3.5 * rows + 0.3), layout="constrained", squeeze=False
    )
    for axes in grid.ravel()[len(wanted) :]:
        axes.axis("off")
    handles: dict[str, Artist] = {}
    for axes, (name, panel) in zip(grid.ravel(), wanted, strict=False):
        references = folder.glob(f"shared/{name}_n*.run.nc")
        curves = [(file, REFERENCE) for file in references]
        curves += [(folder / e / name / "run.run.nc", {**STYLES[e], "lw": 1.3, "label": e}) for e in engines]
        for file, style in curves:
            if file.exists():
                panel(axes, lk.open_run(file), style)
        axes.set_title(name, fontsize=10)
        axes.grid(alpha=0.25)
        handles |= {str(h.get_label()): h for h in axes.get_legend_handles_labels()[0]}
    legend_below(figure, list(handles.values()), 6, fontsize=8)
    return figure


def _loose(axes: Axes, run: xr.Dataset, style: Style) -> None:
    axes.semilogy(plots.percent(run), run.lab.mean_stress().values / 1e3, **style)
    axes.set(xlabel="axial strain (%)", ylabel="mean stress p (kPa)")


def _nothing(axes: Axes, run: xr.Dataset, style: Style) -> None:
    axes.plot(-plots.percent(run), run["coordination_number"].values, **style)
    axes.set(xlabel="dilation, strain in each direction (%)", ylabel="coordination number Z")


def _overlap(axes: Axes, run: xr.Dataset, style: Style) -> None:
    axes.plot(run.lab.mean_stress().values / 1e6, 100.0 * run["overlap_ratio"].values, **style)
    axes.axhline(100.0 * OVERLAP_LIMIT, color="tab:red", lw=0.8, ls=":", label="limits")
    axes.axvline(pressure_limit(run.lab.scene) / 1e6, color="tab:red", lw=0.8, ls=":")
    axes.set(xlabel="mean stress p (MPa)", ylabel="mean overlap/D (%)")


def _cycles(axes: Axes, run: xr.Dataset, style: Style) -> None:
    axes.plot(plots.percent(run), run.lab.deviatoric_stress().values / 1e6, **style)
    axes.set(xlabel="axial strain (%)", ylabel="deviatoric stress q (MPa)")


def _ratchet(axes: Axes, run: xr.Dataset, style: Style) -> None:
    e, _ = cycle_ends(run)
    axes.plot(np.arange(len(e)), 1e5 * (e - e[0]), **style)
    axes.set(xlabel="cycle", ylabel=r"change of the void ratio ($10^{-5}$)")


def _long(axes: Axes, run: xr.Dataset, style: Style) -> None:
    axes.plot(plots.percent(run), (run.lab.deviatoric_stress() / run.lab.mean_stress()).values, **style)
    axes.set(xlabel="axial strain (%)", ylabel="q/p")


PANELS = {
    "loose_cv": _loose,
    "isod_to_nothing": _nothing,
    "isoc_beyond": _overlap,
    "growing_cycles": _cycles,
    "many_cycles": _ratchet,
    "strain_100": _long,
}
