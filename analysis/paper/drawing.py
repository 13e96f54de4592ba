"""Drawing style of the paper's figures.

The colour denotes the density of the specimen. The simulation is a broad pale line, C0 a dashed line on top of it, the
model a dotted (Table 2) or dash-dotted (calibrated) line. A note above the panels lists missing runs.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from analysis.legends import legend_below
from analysis.paper.ends import Runs
from analysis.paper.model_runs import CALIBRATED, TABLE_2, model_run
from labkit.errors import InputError
from labkit.figures import colors_for, plots
from labkit.model import Model
from labkit.paths import accumulated_strain

Models = Mapping[str, Model]  # name -> model, from analysis.paper.model_runs.models
Color = str | tuple[float, float, float]

WIDTH = 7.2  # inches, the text width of an A4 page
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9,
    "legend.fontsize": 8,
    "axes.grid": True,
    "grid.alpha": 0.25,
}
DENSITIES = ("loose", "medium", "dense")
COLORS = {"loose": "#d55e00", "medium": "#009e73", "dense": "#0072b2"}
MARKERS = {"cv": "o", "cr": "s", "cp": "^"}
PALE = 0.55  # share of white in the broad line of a simulation
MODEL_STYLES: dict[str, dict[str, Any]] = {
    TABLE_2: {"ls": ":", "lw": 1.6},
    CALIBRATED: {"ls": (0, (5, 1.5, 1, 1.5)), "lw": 1.1},
}


Quantity = tuple[str, Callable[[xr.Dataset, str], np.ndarray]]  # label, values from (run, name of a stress)
QUANTITIES: dict[str, Quantity] = {
    "strain": ("axial strain (%)", lambda run, stress: plots.percent(run)),
    "accumulated_strain": ("accumulated axial strain (%)", lambda run, stress: accumulated_strain(plots.percent(run))),
    "p": ("p (MPa)", lambda run, stress: run.lab.mean_stress(stress).values / 1e6),
    "q": ("q (MPa)", lambda run, stress: run.lab.q(stress).values / 1e6),
    "e": ("void ratio e", lambda run, stress: run["void_ratio"].values),
    "e_nominal": ("nominal void ratio e", lambda run, stress: run["void_ratio_nominal"].values),
    "Z": ("Z", lambda run, stress: run["coordination_number"].values),
    "Lambda": ("$\\Lambda$", lambda run, stress: run["mean_normalised_force"].values),
    "A": ("$A_{zz}$", lambda run, stress: run["contact_anisotropy"].values[:, 2, 2]),
    "F": ("$F_{zz}$", lambda run, stress: run["normal_force_anisotropy"].values[:, 2, 2]),
    "Ft": ("$F^t_{zz}$", lambda run, stress: run["mobilisation"].values[:, 2, 2]),
}


def diagram(name: str) -> tuple[str, str, Callable[..., tuple[np.ndarray, np.ndarray]]]:
    """A diagram: label of x, label of y, and a function (run, name of a stress) -> (x, y).

    Its name consists of two of QUANTITIES, e.g. `q-strain` for q against axial strain.
    """
    (y_label, y), (x_label, x) = (QUANTITIES[part] for part in name.split("-"))
    return x_label, y_label, lambda run, stress="stress": (x(run, stress), y(run, stress))


def panels_of(rows: int, names: Sequence[str], height: float = 2.5) -> tuple[Figure, np.ndarray]:
    """A figure and its panels (rows, len(names)), one column per diagram."""
    figure, grid = plt.subplots(
        rows, len(names), figsize=(WIDTH, height * rows + 0.6), layout="constrained", squeeze=False
    )
    for panels in grid:
        for axes, name in zip(panels, names, strict=True):
            axes.set(xlabel=diagram(name)[0], ylabel=diagram(name)[1])
    return figure, grid


def draw(
    panels: Sequence[Axes],
    names: Sequence[str],
    runs: Runs,
    colors: Mapping[str, Color],
    models: Models,
    label_of: Callable[[xr.Dataset], str],
    c0: bool = True,
) -> None:
    """Draws simulation, C0 and models of the available runs; `colors`: name of the run -> colour."""
    for axes, name in zip(panels, names, strict=True):
        axes.set(xlabel=diagram(name)[0], ylabel=diagram(name)[1])
    for run_name in (name for name in colors if name in runs):
        run, color = runs[run_name], colors[run_name]
        by_model = predictions(run, models)
        for axes, name in zip(panels, names, strict=True):
            of = diagram(name)[2]
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
    """Name -> run of the model; empty if the model cannot start from the first record (for example, no contacts)."""
    try:
        return {label: model_run(run, model) for label, model in models.items()}
    except InputError:
        return {}


def finish(
    figure: Figure, models: Models, missing: Sequence[str], handles: Iterable[Line2D] = (), c0: bool = True
) -> Figure:
    """The figure with the common legend and the list of missing runs."""
    legend_below(figure, [*line_handles(models, c0), *handles], 4)
    return say_missing(figure, missing)


def line_handles(models: Models, c0: bool = True) -> list[Line2D]:
    """Legend entries for simulation, C0 and models."""
    lines = [Line2D([], [], color=mixed("k", PALE), lw=2.4, label="simulation")]
    lines += [Line2D([], [], color="k", ls="--", lw=0.9, label="C0")] * c0
    return lines + [Line2D([], [], color="k", label=f"model, {name}", **MODEL_STYLES[name]) for name in models]


def density_handles(densities: Iterable[str]) -> list[Line2D]:
    """Legend entries for the colours of the densities."""
    return [Line2D([], [], color=COLORS[density], lw=2, label=density) for density in dict.fromkeys(densities)]


def path_handles() -> list[Line2D]:
    """Legend entries for the markers of the loading paths."""
    return [
        Line2D([], [], color="0.3", marker=marker, mfc="none", ls="", ms=4.5, label=path.upper())
        for path, marker in MARKERS.items()
    ]


def say_missing(figure: Figure, missing: Sequence[str]) -> Figure:
    """Lists missing runs above the panels and returns the figure."""
    if missing:
        note = textwrap.fill("missing: " + ", ".join(missing), 110)
        figure.suptitle(note, fontsize=7, color="0.4")
    return figure


def set_title(panels: Sequence[Axes], title: str) -> None:
    """Sets the title of a row of panels."""
    panels[0].set_title(title, loc="left")


def letters(panels: Iterable[Axes]) -> None:
    """Labels the panels (a), (b), ..."""
    for letter, axes in zip("abcdefgh", panels, strict=False):
        axes.set_title(f"({letter})", loc="left")


def mixed(color: Color, white: float = 0.0, black: float = 0.0) -> tuple[float, float, float]:
    """The colour mixed with a share of white or black."""
    red, green, blue = ((part * (1.0 - white) + white) * (1.0 - black) for part in to_rgb(color))
    return red, green, blue


def nominal(run: xr.Dataset) -> float:
    """Initial nominal void ratio."""
    return float(run["void_ratio_nominal"][0])


def start_pressure(run: xr.Dataset) -> str:
    """Label with the initial mean stress."""
    return f"$p_0$ = {float(run.lab.mean_stress()[0]) / 1e6:.2f} MPa"


def start_void_ratio(run: xr.Dataset) -> str:
    """Label with the initial void ratio."""
    return f"$e_0$ = {nominal(run):.3f}"


def path_and_start(run: xr.Dataset) -> str:
    """Label with the loading path and the initial void ratio."""
    return f"{run.attrs['path'].upper()}, {start_void_ratio(run)}"


def curves(rows: Mapping[str, Runs], names: Sequence[str]) -> Figure:
    """Runs in the diagrams `names`, one row of panels per group; `rows`: title of the row -> (label -> run)."""
    figure = plots.new_figure(plots.WIDTH, 3.1 * len(rows))
    grid = figure.panels(len(rows), len(names), squeeze=False)
    for panels, (title, runs) in zip(grid, rows.items(), strict=True):
        for color, (label, run) in zip(colors_for(len(runs)), runs.items(), strict=True):
            for axes, name in zip(panels, names, strict=True):
                axes.plot(*diagram(name)[2](run), "-", color=color, lw=1.4, label=label)
        for axes, name in zip(panels, names, strict=True):
            axes.set(xlabel=diagram(name)[0], ylabel=diagram(name)[1])
        panels[0].set_title(title, loc="left", fontsize=10)
        panels[-1].legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8)
    return figure
