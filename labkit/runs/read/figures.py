"""Registry of the figures of a run, for `labkit figure` and Run.plot; they are drawn in labkit.figures.

A figure is a function of a run opened with labkit.open_run, the number of size groups and the number of a snapshot; it
returns a matplotlib Figure and the pandas.DataFrame of the plotted values. `labkit.register_figure` adds a figure.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Generic, Literal, ParamSpec

from labkit.extensions import Registry

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

Arguments = ParamSpec("Arguments")


class RunFigure(Generic[Arguments]):
    """A figure of runs, which is drawn when called.

    `needs` says what the data must contain; `several` is True if it also draws several runs.
    """

    def __init__(
        self,
        name: str,
        function: Callable[Arguments, tuple[Figure, pandas.DataFrame]],
        needs: Literal["snapshots", "records", "probes"] = "snapshots",
        several: bool = False,
    ) -> None:
        """Take over the signature and the docstring of the function that draws the figure."""
        functools.update_wrapper(self, function)
        self.name, self.function, self.needs, self.several = name, function, needs, several

    def __call__(self, *arguments: Arguments.args, **named: Arguments.kwargs) -> tuple[Figure, pandas.DataFrame]:
        """Draw the figure; returns it and the table of the plotted values."""
        return self.function(*arguments, **named)


FIGURES = Registry[RunFigure[...]](
    "figure",
    {
        "test": "labkit.figures.plots:test",
        "records": "labkit.figures.plots:records",
        "groups": "labkit.figures.micro_figures:groups",
        "densities": "labkit.figures.micro_figures:densities",
        "directions": "labkit.figures.direction_figure:directions",
        "planes": "labkit.figures.micro_figures:planes",
        "shares": "labkit.figures.sff_figures:shares",
        "family": "labkit.figures.sff_figures:family",
        "budget": "labkit.figures.sff_figures:budget",
        "contacts": "labkit.figures.micro_figures:contacts",
        "stress_path": "labkit.figures.path_figures:stress_path",
        "pi_plane": "labkit.figures.path_figures:pi_plane",
        "shear": "labkit.figures.path_figures:shear",
        "cycles": "labkit.figures.path_figures:cycles",
        "envelope": "labkit.figures.envelope_figure:envelope",
    },
)


def register_figure(
    name: str, *, needs: Literal["snapshots", "records", "probes"] = "snapshots", several: bool = False
) -> Callable[[Callable[Arguments, tuple[Figure, pandas.DataFrame]]], RunFigure[Arguments]]:
    """Decorator that registers a function as a figure under `name`.

    Args:
        name: Name by which users choose the figure.
        needs: What the data must contain: snapshots, records alone, or the data of Probes.
        several: True if it also draws several runs, given as name -> run.
    """

    def register(function: Callable[Arguments, tuple[Figure, pandas.DataFrame]]) -> RunFigure[Arguments]:
        figure = RunFigure(name, function, needs, several)
        FIGURES.register(figure)
        return figure

    return register
