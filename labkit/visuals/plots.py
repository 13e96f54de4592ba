"""Figures of runs: stresses, records, critical states. Stress in MPa, strain in %."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pandas
import xarray
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from labkit.dem.paths import PATHS, travelled
from labkit.errors import InputError, instead_of
from labkit.io.atomic import whole_file
from labkit.io.provenance import provenance, write_provenance
from labkit.visuals.frame import (
    DPI,
    WIDTH,
    add_heading,
    as_axis,
    colors_for,
    common_label,
    include_zero,
    name_of,
    name_run,
    new_figure,
    strain_axis,
)

__all__ = [
    "DPI",
    "FORMATS",
    "WIDTH",
    "columns_of",
    "curves",
    "diagram",
    "e_p_paths",
    "name_run",
    "percent",
    "records",
    "require_format",
    "save",
    "sff_against_love",
    "styles_of",
    "test",
]

Runs = Mapping[str, xarray.Dataset]

FORMATS = (".png", ".pdf", ".svg", ".webp")
STYLES: dict[str, tuple[str, Literal["-", "--"]]] = {"Love": ("stress", "-"), "C0": ("stress_sff", "--")}
MODEL_STYLES: dict[str, tuple[str, Literal["-", "--"]]] = {"C0 (model)": ("stress", "-")}


def sff_against_love(runs: Runs) -> Figure:
    """q and p against the strain of the path, and q against p, of runs opened with labkit.open_run; a Figure.

    `runs`: label -> run. Each run has its own colour; Love's stress is solid, C0 dashed. If p is constant in all runs,
    the third panel shows the error of C0 instead of q against p.
    A prediction of the constitutive model has only C0.
    """
    figure = new_figure(WIDTH, 3.6 + 0.22 * (len(runs) // 4))
    panels = figure.subplots(1, 3)
    labels, constant = [], all(map(_keeps_p, runs.values()))
    for color, (label, run) in zip(colors_for(len(runs)), runs.items(), strict=True):
        strain_label, strain = as_axis(run.lab.strain())
        labels.append(strain_label)
        for name, style in styles_of(run).values():
            p, q = run.lab.mean_stress(name).values / 1e6, run.lab.q(name).values / 1e6
            panels[0].plot(strain, q, style, color=color, label=label if style == "-" else None)
            panels[1].plot(strain, p, style, color=color)
            if not constant:
                panels[2].plot(p, q, style, color=color)
        if constant:
            panels[2].plot(strain, 100.0 * run.lab.sff_error().values, color=color)
    for axes in panels:
        axes.set_xlabel(common_label(labels))
        axes.grid(alpha=0.25)
    panels[0].set(ylabel="deviatoric stress q (MPa)")
    panels[1].set(ylabel="mean stress p (MPa)")
    include_zero(panels[0], "y")
    include_zero(panels[2], "y")
    if constant:
        low, high = panels[1].get_ylim()
        panels[1].set_ylim(0.9 * low, 1.1 * high)  # wider than the noise of the servo
        panels[2].set(ylabel="error of C0, Frobenius norm (%)")
    else:
        include_zero(panels[1], "y")
        panels[2].set(xlabel="mean stress p (MPa)", ylabel="deviatoric stress q (MPa)")
        include_zero(panels[2], "x")
    styles = STYLES if any(map(_has_grains, runs.values())) else MODEL_STYLES
    gray = "0.3" if len(runs) > 1 else colors_for(1)[0]
    lines = [Line2D([], [], color=gray, linestyle=style, label=who) for who, (_, style) in styles.items()]
    runs_and_styles = panels[0].get_legend_handles_labels()[0] * (len(runs) > 1) + lines
    columns = columns_of(runs, 5)
    figure.legend(handles=runs_and_styles, loc="outside lower center", ncols=columns, frameon=False, fontsize=8)
    return figure


def _keeps_p(run: xarray.Dataset) -> bool:
    """True for a run with grains whose mean stress is constant."""
    p = run.lab.mean_stress().values
    return _has_grains(run) and bool(np.ptp(p) < 0.02 * abs(p.mean()))


def _has_grains(run: xarray.Dataset) -> bool:
    """False for a prediction of the constitutive model, whose stress is C0."""
    return run.attrs.get("engine") != "model"


def styles_of(run: xarray.Dataset) -> dict[str, tuple[str, Literal["-", "--"]]]:
    """Name of each stress of a run -> its variable and line style."""
    return STYLES if _has_grains(run) else MODEL_STYLES


def test(run: xarray.Dataset | Runs, groups: int = 5, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """q, p and the stress path of a run or several, from Love's stress and C0 (`sff_against_love`), and the table."""
    runs = {name_of(run): run} if isinstance(run, xarray.Dataset) else run
    tables = []
    for label, one in runs.items():
        columns = {"run": label, "axial_strain": one["axial_strain"].values, "strain": one.lab.strain().values}
        for who, (name, _) in STYLES.items():
            columns[f"p_{who}_Pa"] = one.lab.mean_stress(name).values
            columns[f"q_{who}_Pa"] = one.lab.q(name).values
        tables.append(pandas.DataFrame(columns))
    figure = sff_against_love(runs)
    if len(runs) > 1:
        return figure, pandas.concat(tables, ignore_index=True)
    add_heading(figure, next(iter(runs.values())))
    return figure, tables[0].drop(columns="run")


def records(
    run: xarray.Dataset, groups: int = 5, snapshot: int = -1, variable: str | None = None
) -> tuple[Figure, pandas.DataFrame]:
    """Any recorded variable, including user-defined ones, against strain or cycles; for a tensor, its components.

    For a symmetric tensor the six independent components are drawn (`xy = yx`), for others all nine. Raises
    InputError if the run does not hold the variable.
    """
    names = [str(name) for name, values in run.data_vars.items() if values.dims[:1] == ("time",)]
    if variable is None or variable not in names:
        raise InputError(
            "is not recorded" if variable else "is missing",
            field="variable",
            value=variable,
            allowed=instead_of(names, variable),
        )
    values = run[variable]
    components = _components(values.values)
    figure = new_figure(0.75 * WIDTH, 4.2)
    axes = figure.subplots()
    strain_label, strain = strain_axis(run)
    units = values.attrs.get("units", "1")
    factor, shown = (1e-6, "MPa") if units == "Pa" else (1.0, units)
    for color, (label, column) in zip(colors_for(len(components)), components.items(), strict=True):
        axes.plot(strain, factor * column, color=color, label=label)
    label = f"{values.attrs.get('long_name', variable)}" + f" ({shown})" * (shown != "1")
    axes.set(xlabel=strain_label, ylabel=textwrap.fill(label, 44))
    axes.grid(alpha=0.25)
    if len(components) > 1:
        figure.legend(loc="outside right center", title="component", frameon=False, fontsize=8)
    add_heading(figure, run)
    columns = {"axial_strain": run["axial_strain"].values}
    columns |= {f"{variable}_{label.split(' ')[0]}" if label else variable: c for label, c in components.items()}
    return figure, pandas.DataFrame(columns)


test.of_records = records.of_records = True  # type: ignore[attr-defined]  # they need no snapshots
test.of_runs = True  # type: ignore[attr-defined]  # it draws several runs, too
SYMMETRY_TOLERANCE = 1e-3  # of the largest component: smaller differences are invisible in a figure


def _components(values: np.ndarray) -> dict[str, np.ndarray]:
    """Label -> series of each component that differs; `values` (time, ...), the label of a scalar is empty."""
    if values.ndim != 3:
        flat = values.reshape(len(values), -1).T
        return {"xyz"[k] if len(flat) > 1 else "": row for k, row in enumerate(flat)}
    finite = np.nan_to_num(values)
    asymmetry = np.abs(finite - finite.swapaxes(1, 2)).max(initial=0.0)
    if asymmetry > SYMMETRY_TOLERANCE * np.abs(finite).max(initial=0.0):
        return {"xyz"[i] + "xyz"[j]: values[:, i, j] for i in range(3) for j in range(3)}
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    names = {(i, j): "xyz"[i] + "xyz"[j] + (f" = {'xyz'[j]}{'xyz'[i]}" if i != j else "") for i, j in pairs}
    return {names[i, j]: values[:, i, j] for i, j in pairs}


def e_p_paths(
    runs: Runs,
    critical: Mapping[str, tuple[np.ndarray, np.ndarray]] | None = None,
    width: float = WIDTH,
    list_runs: bool = False,
) -> Figure:
    """Shear tests in the e-p plane (Fig. 1) and, next to it, in the q-p plane; a Figure.

    `runs`: label -> run. Colour denotes the initial void ratio of the specimen, line style the path. `critical`:
    label -> (p, e) of critical state lines, Pa. `list_runs`: add the labels of the runs to the legend.
    """
    figure = new_figure(width, 0.52 * width + 0.2 * (len(runs) // 5 + 1) * list_runs)
    left, right = figure.subplots(1, 2)
    styles = {name: PATHS[name].line_style for name in dict.fromkeys(run.attrs["path"] for run in runs.values())}
    start = np.array([float(run["void_ratio"][0]) for run in runs.values()])
    scale, colors = Normalize(start.min(), start.max() + 1e-9), matplotlib.colormaps["viridis"]
    tests = []
    for e, (label, run) in zip(start, runs.items(), strict=True):
        color, style = colors(0.9 * scale(e)), styles[run.attrs["path"]]
        p, q = run.lab.mean_stress().values / 1e6, run.lab.q().values / 1e6
        tests += left.plot(p, run["void_ratio"].values, linestyle=style, color=color, lw=1.2, label=label)
        left.plot(p[-1], run["void_ratio"].values[-1], "o", color=color, ms=4)
        right.plot(p, q, linestyle=style, color=color, lw=1.2)
        right.plot(p[-1], q[-1], "o", color=color, ms=4)
    top = np.array([0.0, right.get_xlim()[1]])
    right.plot(top, 0.92 * top, color="0.5", lw=0.8)
    left.set(xlabel="mean stress p (MPa)", ylabel="void ratio e", xlim=(0, None))
    right.set(xlabel="mean stress p (MPa)", ylabel="deviatoric stress q (MPa)", xlim=(0, None))
    order = [name for name in PATHS if name in styles]
    lines = [Line2D([], [], color="0.3", linestyle=styles[name], label=name.upper()) for name in order]
    lines += [Line2D([], [], color="0.3", marker="o", ls="", ms=4, label="end of the test")]
    lines += [Line2D([], [], color="0.5", lw=0.8, label="q = 0.92 p")]
    for (label, (p, e)), style in zip((critical or {}).items(), ("-", "--", ":"), strict=False):
        lines += left.plot(p / 1e6, e, style, color="k", lw=1.2, zorder=3, label=label)
    for axes in (left, right):
        axes.grid(alpha=0.25)
    columns = 8 if width >= WIDTH else 4
    figure.legend(handles=lines, loc="outside lower center", ncols=columns, frameon=False, fontsize=8)
    if list_runs:
        figure.legend(handles=tests, loc="outside upper center", ncols=columns_of(runs, 8), frameon=False, fontsize=8)
    bar = figure.colorbar(plt.cm.ScalarMappable(scale, colors), ax=right, pad=0.02)
    bar.set_label("void ratio at the start")
    return figure


QUANTITIES = {
    "strain": ("axial strain (%)", lambda run, stress: percent(run)),
    "travelled": ("accumulated axial strain (%)", lambda run, stress: travelled(percent(run))),
    "p": ("p (MPa)", lambda run, stress: run.lab.mean_stress(stress).values / 1e6),
    "q": ("q (MPa)", lambda run, stress: run.lab.q(stress).values / 1e6),
    "e": ("void ratio e", lambda run, stress: run["void_ratio"].values),
    "e_nominal": ("nominal void ratio e", lambda run, stress: run["void_ratio_nominal"].values),
    "Z": ("Z", lambda run, stress: run["coordination_number"].values),
    "Lambda": ("$\\Lambda$", lambda run, stress: run["mean_normalised_force"].values),
    "A": ("$A_{zz}$", lambda run, stress: run["contact_anisotropy"].values[:, 2, 2]),
    "F": ("$F_{zz}$", lambda run, stress: run["normal_force_anisotropy"].values[:, 2, 2]),
    "Ft": ("$F^t_{zz}$", lambda run, stress: run["mobilisation"].values[:, 2, 2]),
}


def diagram(name: str) -> tuple[str, str, Callable[..., tuple[np.ndarray, np.ndarray]]]:
    """Definition of a diagram: label of x, label of y, and a function (run, name of a stress) -> (x, y).

    `name`: two of QUANTITIES, e.g. `q-strain` for q against axial strain.
    """
    (y_label, y), (x_label, x) = (QUANTITIES[part] for part in name.split("-"))
    return x_label, y_label, lambda run, stress="stress": (x(run, stress), y(run, stress))


def percent(run: xarray.Dataset) -> np.ndarray:
    """Axial strain of the records, %."""
    return run["axial_strain"].values * 100


def curves(rows: Mapping[str, Runs], names: Sequence[str]) -> Figure:
    """Simulations and model predictions in the diagrams `names`, one row of panels per group; a Figure.

    `rows`: title of the row -> (label -> run). If a figure shows both kinds, the model is dotted.
    """
    figure = new_figure(WIDTH, 3.1 * len(rows))
    grid = figure.subplots(len(rows), len(names), squeeze=False)
    both = len({run.attrs.get("engine") == "model" for runs in rows.values() for run in runs.values()}) > 1
    for panels, (title, runs) in zip(grid, rows.items(), strict=True):
        for color, (label, run) in zip(colors_for(len(runs)), runs.items(), strict=True):
            style = ":" if both and run.attrs.get("engine") == "model" else "-"
            for axes, name in zip(panels, names, strict=True):
                axes.plot(*diagram(name)[2](run), style, color=color, lw=1.4, label=label)
        for axes, name in zip(panels, names, strict=True):
            axes.set(xlabel=diagram(name)[0], ylabel=diagram(name)[1])
            axes.grid(alpha=0.25)
        panels[0].set_title(title, loc="left", fontsize=10)
        panels[-1].legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8)
    return figure


def columns_of(labels: Runs, most: int) -> int:
    """Number of legend columns that fit the width of the page."""
    return max(1, min(most, 110 // max(len(label) for label in labels)))


def require_format(figure: str, *other: str) -> None:
    """Raises InputError unless the name of a figure ends with a format that can be written; other: further formats."""
    known = (*FORMATS, *other)
    if Path(figure).suffix.lower() not in known:
        raise InputError(f"{figure} is not the name of a figure: give one that ends with {', '.join(known)}")


def save(
    figure: Figure, path: str | Path, inputs: Sequence[str | Path] = (), command: str | None = None, dpi: int = DPI
) -> None:
    """Writes a figure atomically, in the format given by the file extension, and closes it.

    A PNG file contains its provenance; for other formats the provenance is written to a separate file next to the
    figure. `inputs`: files that the figure shows; `command`: command that made it (default: that of this process).
    """
    extension = Path(path).suffix[1:].lower()
    metadata = {"provenance": provenance(command, inputs, path)} if extension == "png" else None
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=dpi, format=extension, metadata=metadata)
    if extension != "png":
        write_provenance(path, inputs, command)
    plt.close(figure)
