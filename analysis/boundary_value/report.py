"""Figure, table and page of the boundary value problem."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
import pandas
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from analysis.boundary_value.problem import (
    FIELDS,
    HEIGHT,
    LOOSER,
    PRESSURE,
    RADIUS,
    VOID_RATIO,
    WIDTH,
    Biaxial,
    History,
)
from analysis.markdown import frame_table
from labkit.figures import plots
from labkit.umat import TOLERANCE

ROUNDING = 1e-13  # residual below which rounding errors matter
LABELS = {"e": "void ratio, e", "Z": "coordination number, Z", "|A|": "contact anisotropy, |A|"}


@dataclasses.dataclass(frozen=True)
class Solution:
    """A mesh in one program, and its history."""

    problem: Biaxial
    history: History


def finest(solutions: Sequence[Solution]) -> dict[str, Solution]:
    """The solution with most elements of every program, by the program's name."""
    return {found.problem.program: found for found in sorted(solutions, key=lambda found: found.problem.elements)}


def figure(solutions: Sequence[Solution], strain: float) -> Figure:
    """e, Z and |A| in the quarter, the axial stress, and the residuals of every increment on the finest mesh."""
    drawn = plots.new_figure(13.0, 3.9)
    axes = list(drawn.subplot_mosaic("abc.de", width_ratios=[1, 1, 1, 0.1, 1.4, 1.4]).values())  # a gap for colours
    last = finest(solutions)
    shown = list(last.values())[-1]
    for axis, name in zip(axes, FIELDS, strict=False):
        values = shown.problem.field(name).mean(axis=2)
        image = axis.imshow(values, origin="lower", extent=(0, WIDTH * 1e3, 0, HEIGHT * 1e3), cmap="viridis")
        drawn.colorbar(image, cax=axis.inset_axes((1.06, 0.0, 0.07, 1.0)))
        axis.set_title(LABELS[name], fontsize="small")
        axis.set(xlabel="x (mm)", ylabel="y (mm)" if name == "e" else "")
    for style, (name, found) in zip(("-", "--"), last.items(), strict=False):
        history = found.history
        label = f"{name}, {found.problem.elements}"
        axes[3].plot(np.array(history.strain) * 100, np.array(history.stress) / 1e6, style, label=label)
    axes[3].set(xlabel="axial strain (%)", ylabel="mean axial stress (MPa)")
    axes[3].legend(title="program, elements")
    for k, residuals in enumerate(shown.history.residuals):
        color = "tab:blue" if k else "tab:red"
        name = {0: "first increment", 1: "each later one"}.get(k, "_")  # no entry in the legend
        axes[4].semilogy(residuals, "o-", alpha=0.5, markersize=3, color=color, label=name)
    axes[4].set_ylim(bottom=1e-17)  # room for the legend
    axes[4].legend(loc="lower left")
    axes[4].set(xlabel="Newton iteration", ylabel="residual / external forces")
    axes[4].xaxis.set_major_locator(MaxNLocator(integer=True))
    drawn.suptitle(f"Quarter of the specimen at {strain:.1%} axial strain ({shown.problem.program}), and convergence")
    return drawn


def table(solutions: Sequence[Solution]) -> pandas.DataFrame:
    """One row per mesh: axial stress at the end and its difference from the program's finest mesh, iterations, time."""
    last = finest(solutions)
    rows = []
    for found in solutions:
        problem, history = found.problem, found.history
        reference = last[problem.program].history.stress[-1]
        rows.append(
            {
                "program": problem.program,
                "elements": problem.elements,
                "unknowns": problem.unknowns,
                "axial stress (MPa)": history.stress[-1] / 1e6,
                "difference (%)": 100.0 * (history.stress[-1] / reference - 1.0),
                "smallest Z": float(problem.field("Z").min()),
                "largest |A|": float(problem.field("|A|").max()),
                "increments": len(history.residuals),
                "halved": history.cuts,
                "iterations, mean": float(history.iterations.mean()),
                "iterations, most": int(history.iterations.max()),
                "wall time (s)": history.wall_time,
            }
        )
    return pandas.DataFrame(rows)


def page(rows: pandas.DataFrame, solutions: Sequence[Solution], law: str, strain: float, command: str) -> str:
    """README.md of the study."""
    last = finest(solutions)
    elements = "; ".join(f"{name}: {found.problem.element}" for name, found in last.items())
    parts = [
        "# A boundary value problem",
        f"Plane-strain biaxial test with labkit's model (Table 2, {law}): one quarter, {WIDTH * 1e3:g} mm x "
        f"{HEIGHT * 1e3:g} mm, smooth platens, constant lateral stress {PRESSURE / 1e6:g} MPa, e = {VOID_RATIO} + "
        f"{LOOSER} exp(-(r/{RADIUS * 1e3:g} mm)^2), r from the centre of the specimen (the lower left corner). Axial "
        f"strain {strain:.1%}, before localisation. Newton's method with the consistent tangent until the residual is "
        "below 1e-9 of the external forces.",
        f"Elements: {elements}. Kratos (GeoMechanicsApplication) loads `liblabkit_umat.so` and calls UMAT at every "
        "point; scikit-fem calls the same library for all points at once.",
        f"Written by `{command}`. The computer also ran other jobs, so wall times are upper bounds.",
        "![fields and convergence](biaxial.png)",
        frame_table(rows),
        *(_residuals(name, found.history) for name, found in last.items()),
    ]
    if len(last) == 2:
        one, other = (found.history.stress[-1] for found in last.values())
        parts.append(
            f"On the finest meshes the axial stresses of the two programs differ by {abs(one / other - 1.0):.1e}."
        )
    return "\n\n".join(parts) + "\n"


def _residuals(name: str, history: History) -> str:
    """A paragraph on the residuals r of one program; their bound has the error of the tangent as its linear term."""
    longest, middle = max(history.residuals, key=len), history.residuals[len(history.residuals) // 2]
    pairs = [pair for found in history.residuals for pair in itertools.pairwise(found) if pair[1] > ROUNDING]
    largest = max(after / (before**2 + TOLERANCE * before) for before, after in pairs)
    return (
        f"{name}, finest mesh: the residuals r, relative to the external forces, are {_text(longest)} in the increment "
        f"with most iterations and {_text(middle)} in the middle of the test. Every iteration leaves at most "
        f"{largest:.1f} (r^2 + {TOLERANCE:g} r): the convergence is quadratic until r is near {TOLERANCE:g}, the "
        "tolerance of the substeps, whose sizes the tangent takes as constant."
    )


def _text(values: list[float]) -> str:
    return ", ".join(f"{value:.0e}" for value in values)
