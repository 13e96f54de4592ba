"""Figures that pyplot does not keep open, the heading that names the run, and colours and limits of axes."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure

WIDTH = 10.0  # inches
DPI = 150


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
    """Label and values of the abscissa that suits the path (`run.lab.abscissa`): a strain in %, or cycles.

    Values at every record, or at the snapshots.
    """
    return as_axis(run.lab.abscissa(), run["record"].values if at_snapshots else slice(None))


def where(run: xarray.Dataset, snapshot: int) -> str:
    """Strain of the path, or number of cycles, of a snapshot as text."""
    value, name = run.lab.abscissa()[run["record"].values[snapshot]], run.lab.abscissa().attrs["long_name"]
    return f"{float(value):.2f} cycles" if value.name == "cycles" else f"{100 * float(value):.1f} % {name}"


def as_axis(values: xarray.DataArray, chosen: Any = slice(None)) -> tuple[str, np.ndarray]:
    """Label and chosen values of a quantity of `run.lab` that is a strain, in %, or a number of cycles."""
    if values.name == "cycles":
        return str(values.attrs["long_name"]), values.values[chosen]
    label = values.attrs["long_name"].replace("gamma_xz", "$\\gamma_{xz}$").replace("|eps|", "$|\\varepsilon|$")
    return f"{label} (%)", 100 * values.values[chosen]


def common_label(labels: Sequence[str]) -> str:
    """The label of an axis for several runs, with the alternatives where they differ."""
    different = list(dict.fromkeys(labels))
    return different[0] if len(different) == 1 else textwrap.fill(" or ".join(different), 44)


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
    if low == high:  # zero everywhere
        return
    margin = 0.06 * (high - low) or 1.0
    limits = low - margin * (low < 0.0), high + margin * (high > 0.0)
    if which == "x":
        axes.set_xlim(*limits)
    else:
        axes.set_ylim(*limits)
