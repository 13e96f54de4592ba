"""Figure, table and page of the boundary value problem."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from analysis.boundary_value import problem
from analysis.boundary_value.problem import FIELDS, HEIGHT, WIDTH, Biaxial, History
from labkit.figures import plots
from labkit.umat import TOLERANCE

DECIMALS = 6  # labels of the fields
ROUNDING = 1e-13  # residual below which rounding errors matter
LABELS = {"e": "void ratio, e", "Z": "coordination number, Z", "|A|": "contact anisotropy, |A|"}


@dataclasses.dataclass(frozen=True)
class Solution:
    """The results kept for one mesh and program: its History, and the element means of its fields at the end."""

    program: str
    element: str
    elements: int
    unknowns: int
    strain: list[float]
    stress: list[float]
    residuals: list[list[float]]
    cuts: int
    wall_time: float
    smallest_Z: float
    largest_A: float
    fields: dict[str, list[list[float]]]

    @classmethod
    def of(cls, solved: Biaxial, history: History) -> Solution:
        """The solution of a problem."""
        of_problem = solved.program, solved.element, solved.elements, solved.unknowns
        fields = {name: solved.field(name) for name in FIELDS}
        ends = float(fields["Z"].min()), float(fields["|A|"].max())
        means = {name: np.round(values.mean(axis=2), DECIMALS).tolist() for name, values in fields.items()}
        return cls(*of_problem, **dataclasses.asdict(history), smallest_Z=ends[0], largest_A=ends[1], fields=means)


def finest(solutions: Sequence[Solution]) -> dict[str, Solution]:
    """The solution with the most elements from each program, by the program's name."""
    return {found.program: found for found in sorted(solutions, key=lambda found: found.elements)}


def figure(solutions: Sequence[Solution], strain: float) -> Figure:
    """e, Z and |A| in the quarter, the axial stress, and the residuals of every increment on the finest mesh."""
    drawn = plots.new_figure(13.0, 3.9)
    axes = list(drawn.subplot_mosaic("abc.de", width_ratios=[1, 1, 1, 0.1, 1.4, 1.4]).values())  # space for colours
    last = finest(solutions)
    shown = list(last.values())[-1]
    for axis, name in zip(axes, FIELDS, strict=False):
        image = axis.imshow(
            shown.fields[name], origin="lower", extent=(0, WIDTH * 1e3, 0, HEIGHT * 1e3), cmap="viridis"
        )
        drawn.colorbar(image, cax=axis.inset_axes((1.06, 0.0, 0.07, 1.0)))
        axis.set_title(LABELS[name], fontsize="small")
        axis.set(xlabel="x (mm)", ylabel="y (mm)" if name == "e" else "")
    for style, (name, found) in zip(("-", "--"), last.items(), strict=False):
        label = f"{name}, {found.elements}"
        axes[3].plot(np.array(found.strain) * 100, np.array(found.stress) / 1e6, style, label=label)
    axes[3].set(xlabel="axial strain (%)", ylabel="mean axial stress (MPa)")
    axes[3].legend(title="program, elements")
    for k, residuals in enumerate(shown.residuals):
        color = "tab:blue" if k else "tab:red"
        name = {0: "first increment", 1: "each later one"}.get(k, "_")  # no entry in the legend
        axes[4].semilogy(residuals, "o-", alpha=0.5, markersize=3, color=color, label=name)
    axes[4].set_ylim(bottom=1e-17)  # room for the legend
    axes[4].legend(loc="lower left")
    axes[4].set(xlabel="Newton iteration", ylabel="residual / external forces")
    axes[4].xaxis.set_major_locator(MaxNLocator(integer=True))
    drawn.suptitle(f"Quarter of the specimen at {strain:.1%} axial strain ({shown.program}), and convergence")
    return drawn


def table(solutions: Sequence[Solution]) -> pandas.DataFrame:
    """One row per mesh: axial stress at the end and its difference from the program's finest mesh, iterations, time."""
    last = finest(solutions)
    rows = []
    for found in solutions:
        iterations = [len(one) - 1 for one in found.residuals]
        rows.append(
            {
                "program": found.program,
                "elements": found.elements,
                "unknowns": found.unknowns,
                "axial stress (MPa)": found.stress[-1] / 1e6,
                "difference (%)": 100.0 * (found.stress[-1] / last[found.program].stress[-1] - 1.0),
                "smallest Z": found.smallest_Z,
                "largest |A|": found.largest_A,
                "increments": len(found.residuals),
                "halved": found.cuts,
                "iterations, mean": float(np.mean(iterations)),
                "iterations, most": max(iterations),
                "wall time (s)": found.wall_time,
            }
        )
    return pandas.DataFrame(rows)


def numbers(solutions: Sequence[Solution], law: str, strain: float) -> dict[str, Any]:
    """Values for the page."""
    last = finest(solutions)
    ends = [found.stress[-1] for found in last.values()]
    return {
        "law": law,
        "strain": strain,
        "problem": problem,
        "tolerance": TOLERANCE,
        "finest": [residuals(name, found) for name, found in last.items()],
        "difference": abs(ends[0] / ends[1] - 1.0) if len(ends) == 2 else None,
    }


def residuals(name: str, found: Solution) -> dict[str, Any]:
    """Residuals r of one program as text, and their bound, which has the error of the tangent as its linear term."""
    every = found.residuals
    pairs = [pair for one in every for pair in itertools.pairwise(one) if pair[1] > ROUNDING]
    return {
        "name": name,
        "element": found.element,
        "longest": [f"{value:.0e}" for value in max(every, key=len)],
        "middle": [f"{value:.0e}" for value in every[len(every) // 2]],
        "largest": max(after / (before**2 + TOLERANCE * before) for before, after in pairs),
    }
