"""Parts shared by figures: panels, legend, heading that names the run, colours, and coordinates of diagrams of runs."""

from __future__ import annotations

import dataclasses
import io
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal

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

from labkit.errors import printable
from labkit.io.files import stem
from labkit.micro.stress import equivalent_stress
from labkit.micro.tensors import symmetric
from labkit.runs.read.of_records import EQUATIONS, LABORATORY

WIDTH = 10.0  # inches
DPI = 150
# matplotlib's tab10, with olive and cyan darkened, and the dark part of plasma: both are easy to see on white
COLORS = (*matplotlib.color_sequences["tab10"][:8], "#8c8c1a", "#1097a6")
ORDERED = LinearSegmentedColormap.from_list("ordered", matplotlib.colormaps["plasma"](np.linspace(0.0, 0.68, 256)))
BEYOND = 0.25  # of Love's largest stress: where C0 lies further outside, it does not set the scale
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

    def panels(self, rows: int, columns: int, **options: Any) -> Any:
        """Add one or an array of Axes with a faint grid; `options` are passed to Figure.subplots."""
        panels = self.subplots(rows, columns, **options)
        for axes in np.ravel(panels):
            axes.grid(alpha=0.25)
        return panels

    def key(self, columns: int, handles: Sequence[Artist] | None = None, title: str | None = None) -> None:
        """Add a legend below the panels; by default, it lists the labelled lines of the first panel."""
        handles = self.axes[0].get_legend_handles_labels()[0] if handles is None else handles
        self.legend(handles=handles, title=title, loc="outside lower center", ncols=columns, frameon=False, fontsize=8)


def new_panels(rows: int, columns: int, height: float, width: float = WIDTH, **options: Any) -> tuple[Drawing, Any]:
    """Return a figure and its Axes with a faint grid; sizes are in inches, `options` are passed to Figure.subplots."""
    figure = new_figure(width, height)
    return figure, figure.panels(rows, columns, **options)


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
    parts = [f"path {run.attrs.get('path', 'unknown')}"]
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
    figure.suptitle("\n".join(line for line in lines if line), fontsize=10)


def name_run(figure: Figure, run: xarray.Dataset) -> None:
    """Add the heading that names the run, unless the figure, e.g. of a user, already has it."""
    if describe_run(run) not in figure.get_suptitle():
        add_heading(figure, run)


def strain_axis(run: xarray.Dataset, at_snapshots: bool = False) -> tuple[str, np.ndarray]:
    """Return label and values of the abscissa that suits the path (`run.lab.abscissa`): a strain in %, or cycles.

    The values are at every record or, if `at_snapshots`, at the snapshots.
    """
    return as_axis(run.lab.abscissa(), run["record"].values if at_snapshots else slice(None))


def where(run: xarray.Dataset, snapshot: int) -> str:
    """Describe a snapshot by the strain of the path or the number of cycles."""
    value, name = run.lab.abscissa()[run["record"].values[snapshot]], run.lab.abscissa().attrs["long_name"]
    return f"{float(value):.2f} cycles" if value.name == "cycles" else f"{100 * float(value):.1f} % {name}"


def as_axis(values: xarray.DataArray, chosen: Any = slice(None)) -> tuple[str, np.ndarray]:
    """Return label and chosen values of a quantity of `run.lab`, which is a strain (in %) or a number of cycles."""
    if values.name == "cycles":
        return str(values.attrs["long_name"]), values.values[chosen]
    label = values.attrs["long_name"].replace("gamma_xz", "$\\gamma_{xz}$").replace("|eps|", "$|\\varepsilon|$")
    return f"{label} (%)", 100 * values.values[chosen]


def colors_for(number: int) -> Any:
    """Return a sequence of this number of distinct colours."""
    return COLORS[:number] if number <= len(COLORS) else ordered_colors(number)


def ordered_colors(number: int) -> Any:
    """Return a sequence of this number of colours for ordered values, such as sizes, (number, 4)."""
    return ORDERED(np.linspace(0.0, 1.0, number))


def gray_lines(styles: Mapping[str, Any], color: str = "0.3") -> list[Line2D]:
    """Return gray lines for a legend that explains line `styles`, name -> style."""
    lines = {
        name: {"marker": "o", "ls": "", "ms": 3} if style == "o" else {"ls": style} for name, style in styles.items()
    }
    return [Line2D([], [], color=color, label=name, **line) for name, line in lines.items()]


def columns_of(labels: Runs, most: int) -> int:
    """Return the number of legend columns that fit the width of the page."""
    return max(1, min(most, 110 // max(len(label) for label in labels)))


def include_zero(axes: Axes, which: Literal["x", "y"]) -> None:
    """Extend an axis to zero, with a margin at the other end so that no curve lies under the frame."""
    low, high = axes.dataLim.intervalx if which == "x" else axes.dataLim.intervaly
    low, high = min(low, 0.0), max(high, 0.0)
    if not np.isfinite([low, high]).all() or low == high:  # no finite values, or zero everywhere
        return
    margin = 0.06 * (high - low) or 1.0
    limits = low - margin * (low < 0.0), high + margin * (high > 0.0)
    axes.set(**{f"{which}lim": limits})


def plain_ticks(axis: Axis, multiples: Sequence[float] = (1.0, 2.0, 3.0, 5.0, 7.0)) -> None:
    """Label a logarithmic axis at these multiples of the powers of ten with plain numbers."""
    axis.set_major_locator(LogLocator(subs=multiples))
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


# --- coordinates of diagrams ----------------------------------------------------------------------------------------

Line = Literal["-", "--", "-.", "o"]
LOVE: dict[str, tuple[str, Line]] = {"Love": ("stress", "-")}
STYLES: dict[str, tuple[str, Line]] = {**LOVE, "C0": ("stress_sff", "--")}
BY_VOLUME: dict[str, tuple[str, Line]] = {**LOVE, "by_volume": ("stress_sff_by_volume", "--")}
LEGENDS = {
    "Love": "stress from contacts (Love)",
    "C0": "stress-force-fabric equation (C0)",
    "by_volume": "stress-force-fabric equation by volume",
}
MODEL_STYLES: dict[str, tuple[str, Line]] = {"C0 (model)": ("stress", "-.")}
MEASURED_STYLES: dict[str, tuple[str, Line]] = {"measured": ("stress", "o")}


def has_grains(run: xarray.Dataset) -> bool:
    """Return False for a measured test and for a prediction of the constitutive model, which has only the C0 stress."""
    return run.attrs.get("engine") not in ("model", LABORATORY)


def styles_of(run: xarray.Dataset) -> dict[str, tuple[str, Line]]:
    """Return variable and line style of each stress of a run, name -> (variable, line style).

    The equation is that by volume, or C0 as printed if the file is older.
    """
    if run.attrs.get("engine") == LABORATORY:
        return MEASURED_STYLES
    if not has_grains(run):
        return MODEL_STYLES
    return BY_VOLUME if "stress_sff_by_volume" in run else STYLES


def finish_axes(figure: Drawing, runs: Runs, columns: Columns, both: bool = True) -> Drawn:
    """Add the legend, and for one run the heading, to a figure of `draw_runs`; return it with its table.

    `both` is True if the figure shows both Love's stress and an equation.
    """
    every = [pair for one in runs.values() for pair in styles_of(one).items()] if both else []
    styles = {LEGENDS.get(name, name): style for name, (_, style) in every}
    lines = gray_lines(styles, "0.3" if len(runs) > 1 else colors_for(1)[0])
    figure.key(columns_of(runs, 5), [*figure.axes[0].get_legend_handles_labels()[0], *lines])
    if len(runs) == 1:
        add_heading(figure, next(iter(runs.values())))
    return figure, table_of(runs, columns)


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """The label of an axis, and a function of (run, name of a stress) that returns the values of a run's records.

    `of_stress` is True if the values differ between Love's stress and C0; `least` is the smallest range of the axis,
    which keeps rounding errors from being magnified; `logarithmic` is True for a logarithmic axis.
    """

    label: str | Callable[[xarray.Dataset], str]
    values: Callable[[xarray.Dataset, str], np.ndarray]
    of_stress: bool = False
    least: float = 0.0
    logarithmic: bool = False

    def common_label(self, runs: Iterable[xarray.Dataset]) -> str:
        """Return one label for several runs, which lists the alternatives if their labels differ."""
        labels = list(dict.fromkeys(self.label if isinstance(self.label, str) else self.label(run) for run in runs))
        return labels[0] if len(labels) == 1 else textwrap.fill(" or ".join(labels), 44)


def _equation_of(run: xarray.Dataset) -> str:
    """Return the recorded stress by an equation that the figures of a run show."""
    return "stress_sff_by_volume" if "stress_sff_by_volume" in run else "stress_sff"


def _of_path(of: Callable[[xarray.Dataset], xarray.DataArray]) -> Coordinate:
    return Coordinate(lambda run: as_axis(of(run))[0], lambda run, stress: as_axis(of(run))[1])


def _component(label: str, i: int, j: int) -> Coordinate:
    return Coordinate(label, lambda run, stress: symmetric(run[stress].values)[:, i, j] / 1e6, True)


COMPRESSION = ",\ncompression positive"
STRAIN = _of_path(lambda run: run.lab.strain())
ACCUMULATED = _of_path(lambda run: run.lab.accumulated_strain())
ABSCISSA = _of_path(lambda run: run.lab.abscissa())
P = Coordinate("mean stress p (MPa)", lambda run, stress: run.lab.mean_stress(stress).values / 1e6, True)
Q = Coordinate(
    lambda run: f"{run.lab.q().attrs['long_name']} (MPa)", lambda run, stress: run.lab.q(stress).values / 1e6, True
)
INVARIANT = Coordinate(
    "deviatoric stress, invariant q (MPa)", lambda run, stress: equivalent_stress(run[stress].values) / 1e6, True
)
SHEAR_STRESS = _component("shear stress $\\sigma_{xz}$ (MPa)", 0, 2)
NORMAL_STRESS = _component("normal stress $\\sigma_{zz}$ (MPa)", 2, 2)
LOG_P = dataclasses.replace(P, logarithmic=True)
STRESS_RATIO = Coordinate("stress ratio q/p", lambda run, stress: run.lab.stress_ratio(stress).values, True)
VOID_RATIO = Coordinate("void ratio e", lambda run, stress: run["void_ratio"].values, least=0.01)
VOLUMETRIC = Coordinate(
    f"volumetric strain (%){COMPRESSION}", lambda run, _: 100 * run.lab.volumetric_strain().values, least=0.1
)
ERROR = Coordinate(
    lambda run: f"error of {EQUATIONS[_equation_of(run)]}, norm (%)",
    lambda run, stress: 100.0 * run.lab.sff_error(_equation_of(run)).values,
)


def draw_runs(
    panels: Sequence[Axes], runs: Runs, pairs: Sequence[tuple[Coordinate, Coordinate]], both: bool = True, **style: Any
) -> None:
    """Draw runs, each in its own colour, in one panel for each pair (x, y); Love's stress solid, the equation dashed.

    Stresses are in kPa if all are below 1 MPa. If `both` is False, only Love's stress is drawn. `style` sets the line
    style.
    """
    every = runs.values()
    in_megapascals = [one for pair in pairs for one in pair if "(MPa)" in one.common_label(every)]
    largest = max((np.nanmax(np.abs(one.values(run, "stress"))) for one in in_megapascals for run in every), default=1)
    factors = {one: 1e3 if one in in_megapascals and largest < 1.0 else 1.0 for pair in pairs for one in pair}
    for axes, (x, y) in zip(panels, pairs, strict=True):
        for color, (label, run) in zip(colors_for(len(runs)), runs.items(), strict=True):
            stresses = list(styles_of(run).values())[: None if both and y.of_stress else 1]
            for stress, line in stresses:
                name = plain(label) if line != "--" and len(runs) > 1 else None
                values = (factors[one] * one.values(run, stress) for one in (x, y))
                whole: dict[str, Any] = {"clip_on": False, "zorder": 3} if line == "o" else {}  # markers over the frame
                axes.plot(*values, line, color=color, label=name, ms=3, **whole, **style)
        labels = (
            one.common_label(every).replace("(MPa)", "(MPa)" if factors[one] == 1.0 else "(kPa)") for one in (x, y)
        )
        axes.set(**dict(zip(("xlabel", "ylabel"), labels, strict=True)))
        _scale_without_c0(axes)
        low, high = axes.get_ylim()
        missing = 0.5 * (y.least - (high - low))
        if missing > 0.0:  # other limits stay automatic
            axes.set_ylim(low - missing, high + missing)
        lowest, highest = axes.dataLim.minposx, axes.dataLim.x1
        if x.logarithmic and 0.0 < lowest <= highest < np.inf:
            axes.set_xscale("log")
            few = (1.0, 2.0, 5.0) if highest > 5.0 * lowest else (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
            plain_ticks(axes.xaxis, few)
            axes.set_xlim(lowest / 1.5, 1.5 * highest)


def _scale_without_c0(axes: Axes) -> None:
    """Limit the data range of an axis on which the equation, dashed, lies far beyond the other lines, and say so."""
    lines = axes.get_lines()
    others = [line for line in lines if line.get_linestyle() != "--"]
    if len(others) in (0, len(lines)):
        return
    for which in "xy":
        values = np.concatenate([np.asarray(getattr(line, f"get_{which}data")(), dtype=float) for line in others])
        values = values[np.isfinite(values)]
        if not len(values):
            continue
        low, high = values.min(), values.max()
        margin = BEYOND * max(high - low, abs(low), abs(high))
        drawn = getattr(axes.dataLim, f"interval{which}")
        if margin > 0.0 and (drawn[0] < low - margin or drawn[1] > high + margin):
            setattr(axes.dataLim, f"interval{which}", (max(drawn[0], low - margin), min(drawn[1], high + margin)))
            axes.autoscale_view()
            how: dict[str, Any] = {"xycoords": "axes fraction", "ha": "right", "va": "top", "fontsize": 7}
            axes.annotate("the equation leaves the frame", (0.98, 0.97), **how)
