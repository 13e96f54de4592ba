"""Registry of the figures of a run, for `labkit figure` and Run.plot; they are drawn in labkit.visuals.

A figure is a function of a run opened with labkit.open_run, the number of size groups and the number of a snapshot; it
returns a matplotlib Figure and the pandas.DataFrame of the plotted values. `labkit.register_figure` adds a figure. A
figure with `of_probes = True` is drawn from the data of Probes instead.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from labkit.extensions import Registry

FIGURES: Registry = Registry(
    "figure",
    {
        "test": "labkit.visuals.plots:test",
        "records": "labkit.visuals.plots:records",
        "groups": "labkit.visuals.micro_figures:groups",
        "densities": "labkit.visuals.micro_figures:densities",
        "directions": "labkit.visuals.direction_figure:directions",
        "planes": "labkit.visuals.plane_figure:planes",
        "shares": "labkit.visuals.sff_figures:shares",
        "family": "labkit.visuals.sff_figures:family",
        "budget": "labkit.visuals.sff_figures:budget",
        "contacts": "labkit.visuals.micro_figures:contacts",
        "stress_path": "labkit.visuals.path_figures:stress_path",
        "pi_plane": "labkit.visuals.path_figures:pi_plane",
        "shear": "labkit.visuals.path_figures:shear",
        "cycles": "labkit.visuals.path_figures:cycles",
        "envelope": "labkit.visuals.envelope_figure:envelope",
    },
)


def register_figure(name: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator that registers a function as a figure under `name`."""

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        function.name = name  # type: ignore[attr-defined]
        return FIGURES.register(function)

    return register
