"""Registry of the figures of a run, for `labkit figure` and Run.plot; they are drawn in labkit.figures.

A figure is a function of a run opened with labkit.open_run; it returns a matplotlib Figure and the pandas.DataFrame of
the plotted values. The other arguments are options of the figure, such as `groups`, the number of size groups.
`labkit.register_figure` adds a figure.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, Literal, ParamSpec

from labkit.errors import InputError
from labkit.extensions import Registry, require_function

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from labkit.paths.path import Path

Arguments = ParamSpec("Arguments")


class RunFigure(Generic[Arguments]):
    """A figure of runs; calling it draws the figure.

    `needs` says what the data must contain; `several` is True if the figure can show several runs. Every figure of runs
    has the option `step`, which draws a step of a path file, `2`, or several, `"4-18"` (`run.lab.step`).
    """

    def __init__(
        self,
        name: str,
        function: Callable[Arguments, tuple[Figure, pandas.DataFrame]],
        needs: Literal["snapshots", "records", "probes"] = "snapshots",
        several: bool = False,
    ) -> None:
        """Copy the signature and the docstring of the function that draws the figure."""
        functools.update_wrapper(self, function)
        self.name, self.function, self.needs, self.several = name, function, needs, several
        options = list(inspect.signature(function).parameters.values())[1:]
        self.options = tuple(option.name for option in options)
        self.takes_any = any(option.kind is option.VAR_KEYWORD for option in options)

    def __call__(self, *arguments: Arguments.args, **named: Arguments.kwargs) -> tuple[Figure, pandas.DataFrame]:
        """Draw the figure; returns (figure, table of the plotted values).

        Raises InputError for an unknown option, and for a run without the snapshots or the steps that the figure draws.
        """
        if not arguments:
            raise InputError(f"the figure {self.name} has no run: give it first, as in FIGURES[{self.name!r}](run)")
        options: dict[str, Any] = dict(named)
        data: Any = arguments[0]
        if self.needs != "probes" and (step := options.pop("step", None)) is not None:
            of_one = hasattr(data, "lab")
            data = data.lab.step(step) if of_one else {name: run.lab.step(step) for name, run in data.items()}
        for option, value in options.items():
            if option not in self.options and not self.takes_any:
                having = ", ".join(name for name in FIGURES if option in FIGURES[name].options)
                others = "figures of runs" if option == "step" else "none"
                allowed = " or ".join(self.options) or "no option"
                problem = f"does not apply to the figure {self.name}, only to {having or others}: give {allowed}"
                raise InputError(problem, field=option, value=value)
        if self.needs == "snapshots":
            for run in data.values() if isinstance(data, dict) else [data]:
                run.lab.require_snapshots([options.get("snapshot", -1)], ", or draw the figure shares")
        draw: Any = self.function
        return draw(data, *arguments[1:], **options)


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
        "rotation": "labkit.figures.path_figures:rotation_response",
        "compression": "labkit.figures.path_figures:compression",
        "cycles": "labkit.figures.path_figures:cycles",
        "liquefaction": "labkit.figures.liquefaction_figure:cyclic_resistance",
    },
)


OF_PATHS = {
    **dict.fromkeys(("simple_shear", "simple_shear_cv"), "shear"),
    **dict.fromkeys(("oedometer", "oedometer_reloading"), "compression"),
    "stress_rotation": "rotation",
}


def figure_for(path: Path | None) -> str:
    """Return the name of the figure that suits a path; a user's path may name one in its attribute `figure`."""
    if path is None:
        return "test"
    name: str | None = getattr(path, "figure", None)
    return name or OF_PATHS.get(path.name, "cycles" if path.cyclic else "test")


def register_figure(
    name: str, *, needs: Literal["snapshots", "records", "probes"] = "snapshots", several: bool = False
) -> Callable[[Callable[Arguments, tuple[Figure, pandas.DataFrame]]], RunFigure[Arguments]]:
    """Return a decorator that registers a function as a figure under `name`.

    Args:
        name: Name by which users choose the figure.
        needs: What the data must contain: snapshots, records alone, or the data of Probes.
        several: True if the figure can also show several runs, given as name -> run.
    """

    def register(function: Callable[Arguments, tuple[Figure, pandas.DataFrame]]) -> RunFigure[Arguments]:
        require_function(function)
        figure = RunFigure(name, function, needs, several)
        FIGURES.register(figure)
        return figure

    return register
