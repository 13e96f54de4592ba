"""Figures that pyplot does not keep open: panels, legend, heading that names the run, colours and limits of axes."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
import xarray
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

WIDTH = 10.0  # inches
DPI = 150
Runs = Mapping[str, xarray.Dataset]


class Drawing(Figure):
    """A Figure that pyplot does not manage: it needs no closing, and a notebook displays it once."""

    def _repr_png_(self) -> bytes:
        """PNG for IPython, used if the notebook has no formatter for matplotlib figures."""
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()

    def panels(self, rows: int, columns: int, **options: Any) -> Any:
        """Axes with a faint grid: one, or an array of them; `options`: of Figure.subplots."""
        panels = self.subplots(rows, columns, **options)
        for axes in np.ravel(panels):
            axes.grid(alpha=0.25)
        return panels

    def key(self, columns: int, handles: Sequence[Artist] | None = None, title: str | None = None) -> None:
        """Add a legend below the panels; its entries are those of the first panel by default."""
        handles = self.axes[0].get_legend_handles_labels()[0] if handles is None else handles
        self.legend(handles=handles, title=title, loc="outside lower center", ncols=columns, frameon=False, fontsize=8)


def new_figure(width: float, height: float, layout: Literal["constrained"] | None = "constrained") -> Drawing:
    """An empty figure, size in inches."""
    return Drawing(figsize=(width, height), layout=layout)


def name_of(run: xarray.Dataset) -> str:
    """Name of the run file without `.run.nc`, or the name of the loading path for a run in memory."""
    source = run.encoding.get("source")
    return Path(source).name.removesuffix(".run.nc") if source else str(run.attrs.get("path", "run"))


def describe_run(run: xarray.Dataset) -> str:
    """Name, loading path, number of grains and engine of a run, in one line."""
    engine, grains = run.attrs.get("engine"), run.sizes.get("grain", 0)
    parts = [f"path {run.attrs.get('path', 'unknown')}"]
    if engine == "model":
        parts.append("constitutive model")
    else:
        parts += [f"{grains} grains"] if grains else []
        parts += [f"{engine} engine"] if engine else []
    return f"{name_of(run)}: {', '.join(parts)}"


def add_heading(figure: Figure, run: xarray.Dataset, detail: str = "") -> None:
    """Writes the description of the run above a figure, followed below by the existing heading and `detail`."""
    lines = [describe_run(run), figure.get_suptitle(), detail]
    figure.suptitle("\n".join(line for line in lines if line), fontsize=10)


def name_run(figure: Figure, run: xarray.Dataset) -> None:
    """Adds the heading unless the figure has it already, e.g. to a user's figure."""
    if describe_run(run) not in figure.get_suptitle():
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


def gray_lines(styles: Mapping[str, Any], color: str = "0.3") -> list[Line2D]:
    """Lines for a legend that explains line styles, name -> style."""
    return [Line2D([], [], color=color, linestyle=style, label=name) for name, style in styles.items()]


def columns_of(labels: Runs, most: int) -> int:
    """Number of legend columns that fit the width of the page."""
    return max(1, min(most, 110 // max(len(label) for label in labels)))


def include_zero(axes: Axes, which: Literal["x", "y"]) -> None:
    """Extends an axis to zero, with a margin at the other end so that no curve lies under the frame."""
    low, high = axes.dataLim.intervalx if which == "x" else axes.dataLim.intervaly
    low, high = min(low, 0.0), max(high, 0.0)
    if not np.isfinite([low, high]).all() or low == high:  # no finite values, or zero everywhere
        return
    margin = 0.06 * (high - low) or 1.0
    limits = low - margin * (low < 0.0), high + margin * (high > 0.0)
    axes.set(**{f"{which}lim": limits})
