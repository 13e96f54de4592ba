"""Figures of runs: stresses, records, critical states. Stress in kPa or MPa, strain in %."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas
import xarray
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from labkit.errors import InputError
from labkit.figures import coordinates, frame
from labkit.figures.coordinates import STRAIN, P, draw_runs, finish_axes, q_column, same_q
from labkit.figures.frame import DPI, WIDTH, Runs, Style, name_run, new_figure, new_panels
from labkit.files.atomic import whole_file
from labkit.files.provenance import provenance_json, write_provenance
from labkit.paths.registry import PATHS
from labkit.results.figures import register_figure

__all__ = ["DPI", "WIDTH", "name_run", "new_figure", "percent"]

SUFFIXES = (".png", ".pdf", ".svg", ".webp")
LINES: dict[str, Style] = {  # path -> line style in the e-p plane; a user's path class may define `line_style`
    **{"cr": "--", "cp": ":", "c1": (0, (1, 3)), "true_triaxial": (0, (4, 1)), "plane_strain": (0, (5, 1, 1, 1))},
    **{"simple_shear": (0, (2, 1)), "simple_shear_cv": (0, (2, 1, 1, 1)), "stress_rotation": (0, (1, 1))},
    **{"shear_cycles": (0, (2, 1, 1, 1, 1, 1)), "cyclic_cp": "-."},
    **dict.fromkeys(("undrained_cycles", "drained_cycles", "strain_cycles"), "-."),
}


def percent(run: xarray.Dataset) -> np.ndarray:
    """Return the axial strain of the records, %."""
    return run["axial_strain"].values * 100


def sff_against_love(runs: Runs) -> Figure:
    """Draw q and p against the strain of the path, and q against p, for runs, label -> run; returns a Figure.

    Each run has its own colour; Love's stress is solid, the equation dashed. If p is constant in all runs, the third
    panel shows the error of the equation instead of q against p. A prediction of the constitutive model has only C0.
    """
    figure, panels = new_panels(1, 3, 3.6 + 0.22 * (len(runs) // 4))
    left, middle, right = panels
    constant = all(map(_keeps_p, runs.values()))
    q = same_q(runs)[0]
    draw_runs(panels, runs, [(STRAIN, q), (STRAIN, P), (STRAIN, coordinates.ERROR) if constant else (P, q)])
    frame.include_zero(left, "y")
    frame.include_zero(right, "y")
    if constant:
        low, high = middle.get_ylim()
        middle.set_ylim(0.9 * low, 1.1 * high)  # a range wider than the noise of the servo
    else:
        frame.include_zero(middle, "y")
        frame.include_zero(right, "x")
    return finish_axes(figure, runs, {"strain": lambda run: run.lab.strain()})[0]


def _keeps_p(run: xarray.Dataset) -> bool:
    """Return True for a run with grains in which the mean stress stays constant."""
    p = run.lab.mean_stress().values
    return coordinates.has_grains(run) and bool(np.ptp(p) < 0.02 * abs(p.mean()))


@register_figure("test", needs="records", several=True)
def test(run: xarray.Dataset | Runs, equation: bool = True) -> tuple[Figure, pandas.DataFrame]:
    """Draw tests: q, p, q/p and volumetric strain (undrained: u) against the strain, q against p, and e against log p.

    Stresses are drawn from Love's formula and, unless `equation=False`, from the equation by volume, or C0 if the file
    is older.
    """
    runs = frame.name_runs(run)
    columns: dict[str, Callable[[xarray.Dataset], object]] = {
        "axial_strain": lambda run: run["axial_strain"],
        "strain": lambda run: run.lab.strain(),
    }
    by_volume = all("stress_sff_by_volume" in run for run in runs.values())
    equations = coordinates.STYLES | (coordinates.BY_VOLUME if by_volume else {})
    for who, (stress, _) in (equations if equation else coordinates.LOVE).items():
        columns |= {f"p_{who}_Pa": _mean_stress(stress), f"q_{who}_Pa": q_column(runs, stress)}
    columns |= {
        "volumetric_strain": lambda run: run.lab.volumetric_strain(),
        "void_ratio": lambda run: run["void_ratio"],
    }
    figure, panels = new_panels(2, 3, 6.2 + 0.22 * (len(runs) // 4))
    q, ratio = same_q(runs)
    pairs = [(STRAIN, q), (STRAIN, P), (P, q), (STRAIN, ratio)]
    last = coordinates.VOLUMETRIC
    if all(run.lab.is_undrained for run in runs.values()):
        last = coordinates.same_u(runs)
        columns["pore_pressure_Pa"] = lambda run: 1e6 * last.values(run, "stress")
    pairs += [(STRAIN, last), (coordinates.LOG_P, coordinates.VOID_RATIO)]
    draw_runs(panels.ravel(), runs, pairs, equation)
    for axes in panels.flat[:4]:
        frame.include_zero(axes, "y")
    frame.include_zero(panels[0, 2], "x")
    return finish_axes(figure, runs, columns, equation)


def _mean_stress(stress: str) -> Callable[[xarray.Dataset], object]:
    return lambda run: run.lab.mean_stress(stress)


@register_figure("records", needs="records")
def records(
    run: xarray.Dataset, variable: str | None = None, ax: Axes | None = None
) -> tuple[Figure, pandas.DataFrame]:
    """Draw any recorded variable, including user-defined ones, against strain or cycles; for a tensor, its components.

    A symmetric tensor is drawn with its six independent components (`xy = yx`), any other tensor with all nine. Short
    names (`Z`, `A_zz`) and derived quantities (`q`, `friction_angle`) are as in conditions. `ax` is the Axes to draw
    in, by default those of a new figure. Raises InputError if the run does not contain the variable.
    """
    values = run.lab.variable(variable)
    variable = str(values.name)
    components = _components(values.values)
    figure, axes = frame.panel_in(ax, 4.2, 0.75 * WIDTH)
    strain_label, strain = frame.strain_axis(run)
    units = values.attrs.get("units", "1")
    stress = (1e-3, "kPa") if np.nanmax(np.abs(values.values)) < 1e6 else (1e-6, "MPa")
    factor, shown = stress if units == "Pa" else (1.0, units)
    for color, (label, column) in zip(frame.colors_for(len(components)), components.items(), strict=True):
        axes.plot(strain, factor * column, color=color, label=label)
    label = str(values.attrs.get("long_name", variable)) + (f" ({shown})" if shown != "1" else "")
    axes.set(xlabel=strain_label, ylabel=textwrap.fill(frame.plain(label), 44))
    if len(components) > 1:
        key = {"title": "component", "frameon": False, "fontsize": "small"}
        axes.legend(**key) if ax else figure.legend(loc="outside right center", **key)
    if ax is None:
        frame.add_heading(figure, run)
    columns = {"axial_strain": run["axial_strain"].values}
    columns |= {f"{variable}_{label.split(' ')[0]}" if label else variable: c for label, c in components.items()}
    return figure, pandas.DataFrame(columns)


SYMMETRY_TOLERANCE = 1e-3  # relative to the largest component: smaller differences are invisible in a figure


def _components(values: np.ndarray) -> dict[str, np.ndarray]:
    """Return label -> series for each distinct component of `values` (time, ...); the label of a scalar is empty."""
    if values.ndim != 3:
        flat = values.reshape(len(values), -1).T
        return {"xyz"[k] if len(flat) > 1 else "": row for k, row in enumerate(flat)}
    finite = np.nan_to_num(values)
    asymmetry = np.abs(finite - finite.swapaxes(1, 2)).max(initial=0.0)
    if asymmetry > SYMMETRY_TOLERANCE * np.abs(finite).max(initial=0.0):
        return {"xyz"[i] + "xyz"[j]: values[:, i, j] for i in range(3) for j in range(3)}
    both = {
        f"{a}{b}" + f" = {b}{a}" * (a != b): (i, j) for i, a in enumerate("xyz") for j, b in enumerate("xyz") if i <= j
    }
    return {name: values[:, i, j] for name, (i, j) in both.items()}


def e_p_paths(
    runs: Runs, critical: Mapping[str, tuple[np.ndarray, np.ndarray]] | None = None, width: float = WIDTH
) -> Figure:
    """Draw shear tests in the e-p plane (Fig. 1) and, next to it, in the q-p plane; returns a Figure.

    The colour denotes the initial void ratio of the specimen, the line style the path.

    Args:
        runs: Runs, label -> run.
        critical: Critical state lines, label -> (p, e), p in Pa.
        width: Width of the figure, inches.
    """
    figure, (left, right) = new_panels(1, 2, 0.52 * width, width)
    names = dict.fromkeys(run.attrs["path"] for run in runs.values())
    styles = {name: LINES.get(name) or getattr(PATHS[name], "line_style", "-") for name in names}
    start = np.array([float(run["void_ratio"][0]) for run in runs.values()])
    scale, colors = Normalize(start.min(), start.max() + 1e-9), frame.ORDERED
    deviator = same_q(runs)[0]
    for e, run in zip(start, runs.values(), strict=True):
        color, style = colors(scale(e)), styles[run.attrs["path"]]
        p, q = P.values(run, "stress"), deviator.values(run, "stress")
        for axes, y in ((left, run["void_ratio"].values), (right, q)):
            axes.plot(p, y, linestyle=style, color=color, lw=1.2)
            axes.plot(p[-1], y[-1], "o", color=color, ms=5)
    left.set(xlabel=P.common_label(runs.values()), ylabel=coordinates.VOID_RATIO.label, xlim=(0, None))
    right.set(xlabel=P.common_label(runs.values()), ylabel=deviator.common_label(runs.values()), xlim=(0, None))
    lines = frame.gray_lines({name.upper(): styles[name] for name in PATHS if name in styles})
    lines += [Line2D([], [], color="0.3", marker="o", ls="", ms=5, label="end of the test")]
    if all(run.lab.scene.of_the_paper for run in runs.values()):
        top = np.array([0.0, right.get_xlim()[1]])
        lines += right.plot(top, 0.92 * top, color="0.5", lw=0.8, label="q = 0.92 p, paper")
    for (label, (p, e)), style in zip((critical or {}).items(), ("-", "--", ":"), strict=False):
        lines += left.plot(p / 1e6, e, style, color="k", lw=1.2, zorder=3, label=frame.plain(label))
    figure.key(8 if width >= WIDTH else 4, lines)
    bar = figure.colorbar(plt.cm.ScalarMappable(scale, colors), ax=right, pad=0.02)
    bar.set_label("void ratio at the start")
    return figure


def require_format(figure: str, *other: str) -> None:
    """Raise InputError unless a figure's file name ends with a format that can be written, or with one of `other`."""
    formats = (*SUFFIXES, *other)
    if Path(figure).suffix.lower() not in formats:
        raise InputError(f"{figure} is not the name of a figure: give one that ends with {', '.join(formats)}")


def save(
    figure: Figure, path: str | Path, inputs: Sequence[str | Path] = (), command: str | None = None, dpi: int = DPI
) -> None:
    """Write a figure atomically, in the format given by the file extension, and close it.

    A PNG file contains its provenance. For other formats, the provenance is written to a separate file next to the
    figure.

    Args:
        figure: The figure.
        path: File to write.
        inputs: Files from which the figure was drawn.
        command: Command that made the figure (default: the command line of this process).
        dpi: Resolution, dots per inch.
    """
    extension = Path(path).suffix[1:].lower()
    metadata = {"provenance": provenance_json(command, inputs, path)} if extension == "png" else None
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=dpi, format=extension, metadata=metadata)
    if extension != "png":
        write_provenance(path, inputs, command)
    plt.close(figure)
