"""Overview of a campaign: stress ratio and void ratio of all runs, one column of panels per loading path."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import labkit.runs.dataset  # noqa: F401  # registers the accessor .lab
from labkit.campaigns.items import PlannedRun
from labkit.figures.frame import as_axis
from labkit.runs.dataset import open_records
from labkit.runs.verify import SFF_PRESSURE

ENGINE_STYLES: tuple[Literal["-", "--", ":", "-."], ...] = ("-", "--", ":", "-.")
MOST_LABELS = 12  # specimens listed in the legend
PANEL = 2.8  # inches


def overview(runs: Sequence[tuple[PlannedRun, str | Path]]) -> Figure:
    """Draw q/p (above) and void ratio e (below) against the strain of the path, one column per path; a Figure.

    Colour denotes the specimen, line style the engine. q/p is left out where p is below 50 kPa. The pairs of a run and
    its file are read one at a time.
    """
    paths = list(dict.fromkeys(run.path.name for run, _ in runs))
    specimens = list(dict.fromkeys(run.specimen for run, _ in runs))
    engines = list(dict.fromkeys(run.engine for run, _ in runs))
    colors = dict(zip(specimens, plt.get_cmap("viridis")(np.linspace(0.0, 0.9, len(specimens))), strict=True))
    styles = {engine: ENGINE_STYLES[number % len(ENGINE_STYLES)] for number, engine in enumerate(engines)}
    size = (max(2, len(paths)) * PANEL, 2 * PANEL)
    figure, panels = plt.subplots(
        2, len(paths), figsize=size, layout="constrained", squeeze=False, sharex="col", sharey="row"
    )
    for run, file in runs:
        column = paths.index(run.path.name)
        (label, strain), ratio, void_ratio = _curves(file)
        panels[1, column].set_xlabel(label)
        for axes, values in zip(panels[:, column], (ratio, void_ratio), strict=True):
            axes.plot(strain, values, styles[run.engine], color=colors[run.specimen], lw=1.2)
    for axes, path in zip(panels[0], paths, strict=True):
        axes.set_title(path, fontsize=10)
    panels[0, 0].set_ylabel("stress ratio q/p")
    panels[1, 0].set_ylabel("void ratio e")
    for axes in panels.flat:
        axes.grid(alpha=0.25)
    lines = [Line2D([], [], color=colors[name], label=name) for name in specimens[:MOST_LABELS]]
    lines += [Line2D([], [], color="none", label=f"... {len(specimens)} specimens")] * (len(specimens) > MOST_LABELS)
    lines += [Line2D([], [], color="0.3", linestyle=styles[name], label=name) for name in engines if len(engines) > 1]
    figure.legend(handles=lines, loc="outside lower center", ncols=min(6, 2 * max(2, len(paths))), frameon=False)
    return figure


def _curves(file: str | Path) -> tuple[tuple[str, np.ndarray], np.ndarray, np.ndarray]:
    """Read the abscissa (label, values), q/p and e of the records of a run file."""
    with open_records(file) as records:
        records = records.set_coords("axial_strain")
        p, q = records.lab.mean_stress().values, records.lab.q().values
        ratio = np.divide(q, p, out=np.full_like(q, np.nan), where=p > SFF_PRESSURE)
        return as_axis(records.lab.abscissa()), ratio, records["void_ratio"].values
