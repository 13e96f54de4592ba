"""Figure, table and page of the boundary value problem."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas
from matplotlib.figure import Figure

from analysis.boundary_value.biaxial import HEIGHT, LOOSER, PRESSURE, RADIUS, VOID_RATIO, WIDTH, Biaxial, History
from analysis.markdown import frame_table
from labkit.visuals import plots

FIELDS = {"e": "void ratio, e", "Z": "coordination, Z", "|A|": "anisotropy, |A|"}


def figure(problem: Biaxial, strain: float, histories: Mapping[int, History]) -> Figure:
    """e, Z and |A| in the quarter of the finest mesh, and the axial stress of every mesh."""
    drawn = plots.new_figure(10.5, 3.8)
    axes = drawn.subplots(1, 4, width_ratios=[1, 1, 1, 1.3])
    corners = problem.mesh.p[:, problem.mesh.t] * 1e3
    for axis, (name, label) in zip(axes, FIELDS.items(), strict=False):
        values = problem.field(name).mean(axis=1)
        shape = np.lexsort((corners[0].mean(axis=0), corners[1].mean(axis=0)))
        columns = len(np.unique(problem.mesh.p[0])) - 1
        image = axis.imshow(
            values[shape].reshape(-1, columns), origin="lower", extent=(0, WIDTH * 1e3, 0, HEIGHT * 1e3), cmap="viridis"
        )
        drawn.colorbar(image, ax=axis, label=label, fraction=0.09)
        axis.set(xlabel="x (mm)", ylabel="y (mm)" if name == "e" else "")
    for columns, history in histories.items():
        axes[3].plot(np.array(history.strain) * 100, np.array(history.stress) / 1e6, label=f"{columns} x {2 * columns}")
    axes[3].set(xlabel="axial strain (%)", ylabel="mean axial stress (MPa)")
    axes[3].legend(title="elements")
    drawn.suptitle(f"Quarter of the specimen at {strain:.1%} axial strain (left); axial stress of every mesh (right)")
    return drawn


def table(problems: Mapping[int, Biaxial], histories: Mapping[int, History]) -> pandas.DataFrame:
    """One row per mesh: size, axial stress at the end and its difference from the finest, iterations, times."""
    finest = histories[max(histories)].stress[-1]
    rows = []
    for columns, history in histories.items():
        problem = problems[columns]
        rows.append(
            {
                "elements": problem.mesh.nelements,
                "unknowns": len(problem.free),
                "axial stress (MPa)": history.stress[-1] / 1e6,
                "difference (%)": 100.0 * (history.stress[-1] / finest - 1.0),
                "smallest Z": float(problem.field("Z").min()),
                "largest |A|": float(problem.field("|A|").max()),
                "increments": len(history.residuals),
                "halved": history.cuts,
                "iterations, mean": float(history.iterations.mean()),
                "iterations, most": int(history.iterations.max()),
                "time in the law (s)": history.law_time,
                "wall time (s)": history.wall_time,
            }
        )
    return pandas.DataFrame(rows)


def page(rows: pandas.DataFrame, history: History, law: str, strain: float, command: str) -> str:
    """README.md of the study."""
    longest = max(history.residuals, key=len)
    second = history.residuals[len(history.residuals) // 2]
    return (
        "\n\n".join(
            [
                "# A boundary value problem",
                f"Plane-strain biaxial test in [scikit-fem](https://scikit-fem.readthedocs.io) with labkit's model "
                f"(Table 2, {law}): one quarter, {WIDTH * 1e3:g} mm x {HEIGHT * 1e3:g} mm, smooth platens, constant "
                f"lateral stress {PRESSURE / 1e6:g} MPa, e = {VOID_RATIO} + {LOOSER} exp(-(r/{RADIUS * 1e3:g} mm)^2), "
                f"r from the centre of the specimen (the lower left corner). Axial strain {strain:.1%}, before "
                "localisation. Nine-node elements with nine integration points; Newton's method with the consistent "
                "tangent until the residual is below 1e-9 of the external forces.",
                f"Written by `{command}`. The computer also ran other jobs, so wall times are upper bounds.",
                "![fields](biaxial.png)",
                frame_table(rows),
                "Residuals of the iterations on the finest mesh, relative to the external forces: "
                f"{_residuals(longest)} in the increment with most iterations; {_residuals(second)} in the middle of "
                "the test. " + _convergence(history),
            ]
        )
        + "\n"
    )


def _convergence(history: History) -> str:
    """A sentence on the order of convergence, from the last three residuals of every increment."""
    last = [np.log(found[-3:]) for found in history.residuals if len(found) > 2]
    order = float(np.median([(c - b) / (b - a) for a, b, c in last]))
    return "The convergence is quadratic." if order > 1.8 else f"The median order of convergence is {order:.1f}."


def _residuals(values: list[float]) -> str:
    return ", ".join(f"{value:.0e}" for value in values)
