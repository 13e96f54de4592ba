"""Parts shared by figures: panels, legend, heading that names the run, and colours."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, TypeAlias, cast

import matplotlib
import numpy as np
import pandas
import xarray
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from labkit.errors import InputError, printable
from labkit.files.writable import stem
from labkit.micro.snapshot import Snapshot
from labkit.results.endings import LABORATORY

Panels: TypeAlias = Any  # Axes, or an array of Axes
Style: TypeAlias = Any  # a line style, or keyword arguments of matplotlib
WIDTH = 10.0  # inches
DPI = 150
# Colours of Okabe and Ito (2008), which colour-blind readers can tell apart, the pale ones darkened; then the dark part
# of plasma, for ordered values
COLORS = ("#0072B2", "#D55E00", "#009E73", "#A6548C", "#222222", "#3A8FC4", "#A87400", "#7A7A7A", "#5B3A9E", "#8C2D04")
ORDERED = LinearSegmentedColormap.from_list("ordered", matplotlib.colormaps["plasma"](np.linspace(0.0, 0.68, 256)))
TICKS = ((4.5, ()), (2.2, (1.0,)), (1.5, (1.0, 3.0)), (0.9, (1.0, 2.0, 5.0)), (0.5, (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
FEW_TICKS = (1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
Runs = Mapping[str, xarray.Dataset]
Columns = Mapping[str, Callable[[xarray.Dataset], object]]  # of a table: name -> function of a run
Drawn = tuple[Figure, pandas.DataFrame]


class Drawing(Figure):
    """A Figure that pyplot does not manage: it need not be closed, and a notebook displays it once."""

    def _repr_png_(self) -> bytes:
        """Return a PNG for IPython, which uses it if the notebook has no formatter for matplotlib figures."""
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()

    def panels(self, rows: int, columns: int, **options: Style) -> Panels:
        """Add one or an array of Axes with a faint grid; `options` are passed to Figure.subplots."""
        panels = self.subplots(rows, columns, **options)
        for axes in np.ravel(panels):
            axes.grid(alpha=0.25)
        return panels

    def key(self, columns: int, handles: Sequence[Artist] | None = None, title: str | None = None) -> None:
        """Add a legend below the panels; by default, it lists the labelled lines of the first panel."""
        handles = self.axes[0].get_legend_handles_labels()[0] if handles is None else handles
        self.legend(
            handles=handles, title=title, loc="outside lower center", ncols=columns, frameon=False, fontsize="small"
        )


def new_panels(
    rows: int, columns: int, height: float, width: float = WIDTH, **options: object
) -> tuple[Drawing, Panels]:
    """Return a figure and its Axes with a faint grid; sizes are in inches, `options` are passed to Figure.subplots."""
    figure = new_figure(width, height)
    return figure, figure.panels(rows, columns, **options)


def panel_in(ax: Axes | None, height: float, width: float) -> tuple[Figure, Axes]:
    """Return the Axes `ax` with their figure or, if `ax` is None, the only Axes of a new figure; sizes in inches."""
    return new_panels(1, 1, height, width) if ax is None else (cast(Figure, ax.figure), ax)


def new_figure(width: float, height: float, layout: Literal["constrained"] | None = "constrained") -> Drawing:
    """Return an empty figure; width and height are in inches."""
    return Drawing(figsize=(width, height), layout=layout)


def name_of(run: xarray.Dataset) -> str:
    """Return the name of the run file without its extension, or that of the loading path for a run in memory."""
    source = run.encoding.get("source")
    return stem(source) if source else str(run.attrs.get("test") or run.attrs.get("path"))


def plain(text: str) -> str:
    """Return a text of a file for matplotlib, in which `$` begins no mathematics, and `_` hides no label."""
    return " " * text.startswith("_") + printable(text).replace("$", r"\$")


def describe_run(run: xarray.Dataset) -> str:
    """Return name, loading path, number of grains and engine of a run, in one line."""
    engine = run.attrs.get("engine")
    parts = [f"path {run.attrs.get('path', 'unknown')}", *filter(None, [run.attrs.get("shown_steps")])]
    if engine == "model":
        parts.append("constitutive model")
    else:
        parts += [run.lab.contents] if run.lab.number_of_grains else []
        parts += ["measured" if engine == LABORATORY else f"{engine} engine"] if engine else []
    parts += [] if run.attrs.get("complete", True) else ["incomplete"]
    return plain(f"{name_of(run)}: {', '.join(parts)}")


def add_heading(figure: Figure, run: xarray.Dataset, detail: str = "") -> None:
    """Write the description of the run above a figure, and the existing heading and `detail` below it."""
    lines = [describe_run(run), figure.get_suptitle(), detail]
    figure.suptitle("\n".join(line for line in lines if line), fontsize="medium")


def name_run(figure: Figure, run: xarray.Dataset) -> None:
    """Add the heading that names the run, unless the figure, e.g. of a user, already has it."""
    if describe_run(run) not in figure.get_suptitle():
        add_heading(figure, run)


def strain_axis(run: xarray.Dataset, at_snapshots: bool = False) -> tuple[str, np.ndarray]:
    """Return label and values of the abscissa that suits the path (`run.lab.abscissa`): a strain in %, or cycles.

    The values are at every record or, if `at_snapshots`, at the snapshots.
    """
    return as_axis(run.lab.abscissa(), run.lab.snapshot_records() if at_snapshots else slice(None))


def snapshot_to_draw(run: xarray.Dataset, number: int) -> Snapshot:
    """Return the Snapshot with a number. Raises InputError if it has no contacts."""
    snapshot: Snapshot = run.lab.snapshot(number)
    if not len(snapshot.contacts):
        raise InputError("has no contacts", field="snapshot", value=number, allowed="another")
    return snapshot


def where(run: xarray.Dataset, snapshot: int) -> str:
    """Describe a snapshot by the strain of the path or the number of cycles."""
    abscissa = run.lab.abscissa()
    value, name = float(abscissa[run.lab.snapshot_records()[snapshot]]), abscissa.attrs["long_name"]
    return f"{value:.2f} cycles" if abscissa.name == "cycles" else f"{100 * value:.1f} % {name}"


def as_axis(values: xarray.DataArray, chosen: Any = slice(None)) -> tuple[str, np.ndarray]:
    """Return label and chosen values of a quantity of `run.lab`, which is a strain (in %) or a number of cycles."""
    if values.name == "cycles":
        return str(values.attrs["long_name"]), values.values[chosen]
    label = values.attrs["long_name"].replace("gamma_xz", "$\\gamma_{xz}$").replace("|eps|", "$|\\varepsilon|$")
    return f"{label} (%)", 100 * values.values[chosen]


def colors_for(number: int) -> Any:
    """Return a sequence of this number of distinct colours: those of `axes.prop_cycle` if a user has set it."""
    cycle = matplotlib.rcParams["axes.prop_cycle"]
    is_changed = cycle != matplotlib.rcParamsDefault["axes.prop_cycle"] and "color" in cycle.keys
    colors = tuple(cycle.by_key()["color"]) if is_changed else COLORS
    return colors[:number] if number <= len(colors) else ordered_colors(number)


def ordered_colors(number: int) -> Any:
    """Return a sequence of this number of colours for ordered values, such as sizes, (number, 4)."""
    return ORDERED(np.linspace(0.0, 1.0, number))


def gray_lines(styles: Mapping[str, Style], color: str = "0.3") -> list[Line2D]:
    """Return gray lines for a legend that explains line `styles`, name -> style."""
    lines = {
        name: {"marker": "o", "ls": "", "ms": 3} if style == "o" else {"ls": style} for name, style in styles.items()
    }
    return [Line2D([], [], color=color, label=name, **line) for name, line in lines.items()]


def columns_of(labels: Iterable[str], most: int) -> int:
    """Return the number of legend columns that fit the width of the page."""
    return max(1, min(most, 165 // (6 + max((len(label) for label in labels), default=0))))


def include_zero(axes: Axes, which: Literal["x", "y"]) -> None:
    """Extend an axis to zero, with a margin at the other end so that no curve lies under the frame."""
    low, high = axes.dataLim.intervalx if which == "x" else axes.dataLim.intervaly
    low, high = min(low, 0.0), max(high, 0.0)
    if not np.isfinite([low, high]).all() or low == high:  # no finite values, or zero everywhere
        return
    margin = 0.06 * (high - low) or 1.0
    limits = low - margin * (low < 0.0), high + margin * (high > 0.0)
    axes.set(**{f"{which}lim": limits})


def plain_ticks(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers: about five to ten ticks, over decades or within one."""
    low, high = axis.get_view_interval()
    decades = np.log10(high / low) if 0.0 < low < high < np.inf else 1.0
    multiples = next((ticks for least, ticks in TICKS if decades > least), FEW_TICKS)
    axis.set_major_locator(LogLocator(subs=multiples, numticks=50) if multiples else LogLocator(numticks=8))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def name_runs(run: xarray.Dataset | Runs) -> Runs:
    """Return runs by name, given one run or several."""
    return {name_of(run): run} if isinstance(run, xarray.Dataset) else run


def table_of(runs: Runs, columns: Columns) -> pandas.DataFrame:
    """Tabulate the records of all runs; with several runs, the first column names the run."""
    tables = [
        pandas.DataFrame({"run": label, **{name: np.asarray(of(run)) for name, of in columns.items()}})
        for label, run in runs.items()
    ]
    table = pandas.concat(tables, ignore_index=True)
    return table if len(runs) > 1 else table.drop(columns="run")
