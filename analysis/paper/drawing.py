"""How the figures of the paper are drawn: the colour is the density of the specimen; the simulation is a broad pale
line, C0 dashed on it, the model dotted (Table 2) and dash-dotted (calibrated). What is missing is said above them.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from analysis.paper.ends import Runs
from analysis.paper.model_runs import CALIBRATED, TABLE_2, model_run
from labkit.errors import InputError
from labkit.model import Model
from labkit.visuals import plots

Models = Mapping[str, Model]  # name -> model, of analysis.paper.model_runs.models

WIDTH = 7.2  # inches, of a page of A4
STYLE = {"font.size": 9, "axes.titlesize": 9, "legend.fontsize": 8, "axes.grid": True, "grid.alpha": 0.25}
DENSITIES = ("loose", "medium", "dense")
COLORS = {"loose": "#d55e00", "medium": "#009e73", "dense": "#0072b2"}
MARKERS = {"cv": "o", "cr": "s", "cp": "^"}
PALE = 0.55  # of white in the broad line of a simulation
MODEL_STYLES = {TABLE_2: {"ls": ":", "lw": 1.6}, CALIBRATED: {"ls": (0, (5, 1.5, 1, 1.5)), "lw": 1.1}}


def panels_of(rows: int, names: Sequence[str], height: float = 2.5) -> tuple[Figure, np.ndarray]:
    """A figure and its panels (rows, len(names)), a column for each diagram of labkit.visuals.plots."""
    figure, grid = plt.subplots(
        rows, len(names), figsize=(WIDTH, height * rows + 0.6), layout="constrained", squeeze=False
    )
    for panels in grid:
        for axes, name in zip(panels, names, strict=True):
            axes.set(xlabel=plots.diagram(name)[0], ylabel=plots.diagram(name)[1])
    return figure, grid


def draw(
    panels: Sequence[Axes],
    names: Sequence[str],
    runs: Runs,
    colors: Mapping[str, object],
    models: Models,
    label_of: Callable[[xr.Dataset], str],
    c0: bool = True,
) -> None:
    """Draws the runs that are there: simulation, C0 and models; `colors`: name of the run -> colour."""
    for axes, name in zip(panels, names, strict=True):
        axes.set(xlabel=plots.diagram(name)[0], ylabel=plots.diagram(name)[1])
    for run_name in (name for name in colors if name in runs):
        run, color = runs[run_name], colors[run_name]
        by_model = predictions(run, models)
        for axes, name in zip(panels, names, strict=True):
            of = plots.diagram(name)[2]
            axes.plot(*of(run), "-", color=mixed(color, PALE), lw=2.4)
            axes.plot([], [], "-", color=color, lw=1.6, label=label_of(run))
            if c0:
                axes.plot(*of(run, "stress_sff"), "--", color=color, lw=0.9)
            for label, model in by_model.items():
                axes.plot(*of(model), color=color, **MODEL_STYLES[label])
    handles, labels = panels[-1].get_legend_handles_labels()
    if any(labels):
        panels[-1].legend(handles, labels, frameon=False, loc="best", handlelength=1.2)


def predictions(run: xr.Dataset, models: Models) -> dict[str, xr.Dataset]:
    """name -> the model's run; of a run whose start the model cannot take (no contacts, e.g.) there is none."""
    try:
        return {label: model_run(run, model) for label, model in models.items()}
    except InputError:
        return {}


def finish(
    figure: Figure, models: Models, missing: Sequence[str], handles: Iterable[Line2D] = (), c0: bool = True
) -> Figure:
    """The figure with the common legend, and with what is missing."""
    figure.legend(handles=[*line_handles(models, c0), *handles], loc="outside lower center", ncols=4, frameon=False)
    return say_missing(figure, missing)


def line_handles(models: Models, c0: bool = True) -> list[Line2D]:
    """For the legend: simulation, C0 and models."""
    lines = [Line2D([], [], color=mixed("k", PALE), lw=2.4, label="simulation")]
    lines += [Line2D([], [], color="k", ls="--", lw=0.9, label="C0")] * c0
    return lines + [Line2D([], [], color="k", label=f"model, {name}", **MODEL_STYLES[name]) for name in models]


def density_handles(densities: Iterable[str]) -> list[Line2D]:
    """For the legend: the colours of the densities."""
    return [Line2D([], [], color=COLORS[density], lw=2, label=density) for density in dict.fromkeys(densities)]


def path_handles() -> list[Line2D]:
    """For the legend: the markers of the paths."""
    return [
        Line2D([], [], color="0.3", marker=marker, mfc="none", ls="", ms=4.5, label=path.upper())
        for path, marker in MARKERS.items()
    ]


def say_missing(figure: Figure, missing: Sequence[str]) -> Figure:
    """Names what is missing above the panels; the figure."""
    if missing:
        words = textwrap.fill("not there: " + ", ".join(missing), 110)
        figure.suptitle(words, fontsize=7, color="0.4")
    return figure


def set_title(panels: Sequence[Axes], words: str) -> None:
    """The title of a row of panels."""
    panels[0].set_title(words, loc="left")


def letters(panels: Iterable[Axes]) -> None:
    """(a), (b), ... above the panels."""
    for letter, axes in zip("abcdefgh", panels, strict=False):
        axes.set_title(f"({letter})", loc="left")


def mixed(color: object, white: float = 0.0, black: float = 0.0) -> tuple[float, ...]:
    """The colour with a share of white, or of black, in it."""
    rgb = np.array(to_rgb(color))
    return tuple((rgb * (1.0 - white) + white) * (1.0 - black))


def nominal(run: xr.Dataset) -> float:
    """The nominal void ratio at the start."""
    return float(run["void_ratio_nominal"][0])


def start_pressure(run: xr.Dataset) -> str:
    """A label."""
    return f"$p_0$ = {float(run.lab.mean_stress()[0]) / 1e6:.2f} MPa"


def start_void_ratio(run: xr.Dataset) -> str:
    """A label."""
    return f"$e_0$ = {nominal(run):.3f}"


def path_and_start(run: xr.Dataset) -> str:
    """A label."""
    return f"{run.attrs['path'].upper()}, {start_void_ratio(run)}"
