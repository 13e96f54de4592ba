"""Figures that pyplot does not keep open, the heading that names the run, and colours and limits of axes."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from labkit.dem.paths import travelled

WIDTH = 10.0  # inches
DPI = 150
REVERSAL = 1e-6  # smallest decrease of the axial strain between two records that counts as a reversal


class Drawing(Figure):
    """A Figure that pyplot does not manage: it needs no closing, and a notebook displays it once."""

    def _repr_png_(self) -> bytes:
        """PNG for IPython, used if the notebook has no formatter for matplotlib figures."""
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


def new_figure(width: float, height: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """An empty figure, size in inches."""
    return Drawing(figsize=(width, height), layout=layout)


def name_of(run: xarray.Dataset) -> str:
    """Name of the run file without `.run.nc`, or the name of the loading path for a run in memory."""
    source = run.encoding.get("source")
    return Path(source).name.removesuffix(".run.nc") if source else str(run.attrs.get("path", "run"))


def describe(run: xarray.Dataset) -> str:
    """Name, loading path, number of grains and engine of a run, in one line."""
    engine, grains = run.attrs.get("engine"), run.sizes.get("grain", 0)
    parts = [f"path {run.attrs.get('path', 'unknown')}"]
    if engine == "model":
        parts.append("constitutive model")
    else:
        parts += [f"{grains} grains"] * (grains > 0) + [f"{engine} engine"] * bool(engine)
    return f"{name_of(run)}: {', '.join(parts)}"


def add_heading(figure: Figure, run: xarray.Dataset, detail: str = "") -> None:
    """Writes the description of the run above a figure, followed below by the existing heading and `detail`."""
    lines = [describe(run), figure.get_suptitle(), detail]
    figure.suptitle("\n".join(line for line in lines if line), fontsize=10)


def name_run(figure: Figure, run: xarray.Dataset) -> None:
    """Adds the heading unless the figure has it already, e.g. to a user's figure."""
    if describe(run) not in figure.get_suptitle():
        add_heading(figure, run)


def strain_axis(run: xarray.Dataset, at_snapshots: bool = False) -> tuple[str, np.ndarray]:
    """Label and values (%) of the strain axis: axial strain, or accumulated axial strain if the path reverses.

    Values at every record, or at the snapshots.
    """
    label, strain = "axial strain (%)", run["axial_strain"].values
    steps = np.diff(strain)
    if (steps > REVERSAL).any() and (steps < -REVERSAL).any():
        label, strain = "accumulated axial strain (%)", travelled(strain)
    return label, 100 * (strain[run["record"].values] if at_snapshots else strain)


def colors_for(number: int) -> Any:
    """As many distinct colours as needed, a sequence."""
    few = matplotlib.color_sequences["tab10"]
    return few[:number] if number <= len(few) else matplotlib.colormaps["viridis"](np.linspace(0, 1, number))


def include_zero(axes: Axes, which: str) -> None:
    """Extends an axis, `x` or `y`, to zero, with a margin at the other end so that no curve lies under the frame."""
    low, high = axes.dataLim.intervalx if which == "x" else axes.dataLim.intervaly
    if not np.isfinite([low, high]).all():
        return
    low, high = min(low, 0.0), max(high, 0.0)
    margin = 0.06 * (high - low) or 1.0
    limits = low - margin * (low < 0.0), high + margin * (high > 0.0)
    if which == "x":
        axes.set_xlim(*limits)
    else:
        axes.set_ylim(*limits)
