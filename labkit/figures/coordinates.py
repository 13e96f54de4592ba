"""Coordinates of diagrams of runs, and the lines of runs in them: Love's stress solid, the equation dashed."""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Callable, Iterable, Sequence
from typing import Literal

import numpy as np
import xarray
from matplotlib.axes import Axes

from labkit.figures.frame import (
    Columns,
    Drawing,
    Drawn,
    Runs,
    Style,
    add_heading,
    as_axis,
    colors_for,
    columns_of,
    gray_lines,
    plain,
    plain_ticks,
    table_of,
)
from labkit.micro.tensors import symmetric
from labkit.results.endings import LABORATORY
from labkit.results.of_records import EQUATIONS

BEYOND = 0.25  # of Love's largest stress: where C0 lies further outside, it does not set the scale
Line = Literal["-", "--", "-.", "o"]
LOVE: dict[str, tuple[str, Line]] = {"Love": ("stress", "-")}
STYLES: dict[str, tuple[str, Line]] = {**LOVE, "C0": ("stress_sff", "--")}
BY_VOLUME: dict[str, tuple[str, Line]] = {**LOVE, "by_volume": ("stress_sff_by_volume", "--")}
LEGENDS = {
    "Love": "stress from contacts (Love)",
    "C0": "stress-force-fabric equation (C0)",
    "by_volume": "stress-force-fabric equation by volume",
    "C0 (model)": "constitutive model (C0)",
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
    every = [pair for run in runs.values() for pair in styles_of(run).items()] if both else []
    styles = {LEGENDS.get(name, name): style for name, (_, style) in every}
    lines = gray_lines(styles, "0.3" if len(runs) > 1 else colors_for(1)[0])
    handles = [*figure.axes[0].get_legend_handles_labels()[0], *lines]
    figure.key(columns_of((str(handle.get_label()) for handle in handles), 5), handles)
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


def _of_quantity(name: str, unit: str = "", factor: float = 1.0, least: float = 0.0) -> Coordinate:
    """Return a coordinate with values and label of the table of quantities, and the values times a factor in a unit."""

    def label(run: xarray.Dataset) -> str:
        return BREAK.join(run.lab.quantity(name).attrs["long_name"].rsplit(", ", 1)) + (unit and f" ({unit})")

    return Coordinate(label, lambda run, stress: factor * run.lab.quantity(name, stress).values, True, least)


def _component(label: str, i: int, j: int) -> Coordinate:
    return Coordinate(label, lambda run, stress: symmetric(run[stress].values)[:, i, j] / 1e6, True)


BREAK = ",\n"
STRAIN = _of_path(lambda run: run.lab.strain())
ACCUMULATED = _of_path(lambda run: run.lab.accumulated_strain())
ABSCISSA = _of_path(lambda run: run.lab.abscissa())
P, Q, INVARIANT = (_of_quantity(name, "MPa", 1e-6) for name in ("p", "q", "deviator"))
SHEAR_STRESS = _component("shear stress $\\sigma_{xz}$ (MPa)", 0, 2)
NORMAL_STRESS = _component("normal stress $\\sigma_{zz}$ (MPa)", 2, 2)
LOG_P = dataclasses.replace(P, logarithmic=True)
LOG_NORMAL = dataclasses.replace(NORMAL_STRESS, logarithmic=True)
INVARIANT_RATIO = Coordinate(
    "stress ratio, invariant q/p",
    lambda run, stress: (run.lab.quantity("deviator", stress) / run.lab.quantity("p", stress)).values,
    True,
)
STRESS_RATIO = _of_quantity("stress_ratio")
VOID_RATIO = Coordinate("void ratio e", lambda run, stress: run["void_ratio"].values, least=0.01)
VOLUMETRIC = dataclasses.replace(_of_quantity("volumetric_strain", "%", 100.0, least=0.1), of_stress=False)
ERROR = Coordinate(
    lambda run: f"error of {EQUATIONS[_equation_of(run)]}, norm (%)",
    lambda run, stress: 100.0 * run.lab.sff_error(_equation_of(run)).values,
)


def same_u(runs: Runs) -> Coordinate:
    """Return the coordinate u with one definition for all runs: as measured, else with the same constant total."""
    totals = [run.lab.total for run in runs.values()]
    total = next((each for each in totals if each != "mean"), "mean")

    def quantity(run: xarray.Dataset) -> xarray.DataArray:
        return run.lab.pore_pressure(None if "measured_pore_pressure" in run else total)

    def label(run: xarray.Dataset) -> str:
        how = "measured" if "measured_pore_pressure" in run else f"constant total {total} stress"
        return f"excess pore pressure u (MPa){BREAK}{how}"

    return Coordinate(label, lambda run, _: quantity(run).values / 1e6)


def same_q(runs: Runs) -> tuple[Coordinate, Coordinate]:
    """Return coordinates q and q/p with one definition for all runs: the invariants if only some are axisymmetric."""
    mixed = len({run.lab.axisymmetric for run in runs.values()}) > 1
    return (INVARIANT, INVARIANT_RATIO) if mixed else (Q, STRESS_RATIO)


def q_column(runs: Runs, stress: str = "stress") -> Callable[[xarray.Dataset], np.ndarray]:
    """Return a function of a run that returns q of one of its stresses, Pa, as `same_q` defines it."""
    return lambda run: 1e6 * same_q(runs)[0].values(run, stress)


def draw_runs(
    panels: Sequence[Axes],
    runs: Runs,
    pairs: Sequence[tuple[Coordinate, Coordinate]],
    both: bool = True,
    **style: Style,
) -> None:
    """Draw runs, each in its own colour, in one panel for each pair (x, y); Love's stress solid, the equation dashed.

    Stresses are in kPa if all are below 1 MPa. If `both` is False, only Love's stress is drawn. `style` sets the line
    style.
    """
    every = runs.values()
    in_megapascals = [coordinate for pair in pairs for coordinate in pair if "(MPa)" in coordinate.common_label(every)]
    largest = max(
        (np.nanmax(np.abs(coordinate.values(run, "stress"))) for coordinate in in_megapascals for run in every),
        default=1,
    )
    factors = {
        coordinate: 1e3 if coordinate in in_megapascals and largest < 1.0 else 1.0
        for pair in pairs
        for coordinate in pair
    }
    for axes, (x, y) in zip(panels, pairs, strict=True):
        for color, (label, run) in zip(colors_for(len(runs)), runs.items(), strict=True):
            stresses = list(styles_of(run).values())[: None if both and y.of_stress else 1]
            for stress, line in stresses:
                name = plain(label) if line != "--" and len(runs) > 1 else None
                values = (factors[coordinate] * coordinate.values(run, stress) for coordinate in (x, y))
                whole: dict[str, Style] = (
                    {"clip_on": False, "zorder": 3} if line == "o" else {}
                )  # markers over the frame
                axes.plot(*values, line, color=color, label=name, ms=3, **whole, **style)
        labels = (
            coordinate.common_label(every).replace("(MPa)", "(MPa)" if factors[coordinate] == 1.0 else "(kPa)")
            for coordinate in (x, y)
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
            axes.set_xlim(lowest / 1.5, 1.5 * highest)
            plain_ticks(axes.xaxis)


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
            axes.annotate(
                "the equation leaves the frame",
                (0.98, 0.97),
                xycoords="axes fraction",
                ha="right",
                va="top",
                fontsize="x-small",
            )
