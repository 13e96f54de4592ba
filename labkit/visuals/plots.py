"""Figures. Love (or DEM) is solid, C0 dashed; stress in MPa, strain in %."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas
import xarray
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from labkit.dem.paths import PATHS, travelled
from labkit.errors import InputError
from labkit.io.files import whole_file
from labkit.io.provenance import provenance, write_provenance

Runs = Mapping[str, xarray.Dataset]

WIDTH = 10.0  # inches
DPI = 150
FORMATS = (".png", ".pdf", ".svg", ".webp")
STYLES = {"Love": ("stress", "-"), "C0": ("stress_sff", "--")}


def sff_against_love(runs: Runs) -> Figure:
    """q and p against axial strain, and q against p, of runs opened with labkit.open_run; a Figure.

    `runs`: label -> run. A colour is a run, solid is Love, dashed is C0.
    """
    figure, panels = plt.subplots(1, 3, figsize=(WIDTH, 3.6 + 0.22 * (len(runs) // 4)), layout="constrained")
    for color, (label, run) in zip(_colors(len(runs)), runs.items(), strict=True):
        strain = run["axial_strain"].values * 100
        for name, style in STYLES.values():
            p, q = run.lab.mean_stress(name).values / 1e6, run.lab.deviatoric_stress(name).values / 1e6
            for axes, x, y in zip(panels, (strain, strain, p), (q, p, q), strict=True):
                axes.plot(x, y, style, color=color, label=label if style == "-" else None)
    for axes in panels:
        axes.set(xlabel="axial strain (%)", ylim=(min(0, axes.get_ylim()[0]), None))
        axes.grid(alpha=0.25)
    panels[0].set(ylabel="deviatoric stress q (MPa)")
    panels[1].set(ylabel="mean stress p (MPa)")
    panels[2].set(xlabel="mean stress p (MPa)", ylabel="deviatoric stress q (MPa)")
    lines = [Line2D([], [], color="0.3", linestyle=style, label=who) for who, (_, style) in STYLES.items()]
    runs_and_styles = panels[0].get_legend_handles_labels()[0] + lines
    columns = max(1, min(5, 110 // max(len(label) for label in runs)))
    figure.legend(handles=runs_and_styles, loc="outside lower center", ncols=columns, frameon=False, fontsize=8)
    return figure


def test(run: xarray.Dataset, groups: int = 5, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """q, p and the path of stress of one run, Love's stress and C0 (`sff_against_love`), and its table."""
    columns = {"axial_strain": run["axial_strain"].values}
    for who, (name, _) in STYLES.items():
        columns[f"p_{who}_Pa"] = run.lab.mean_stress(name).values
        columns[f"q_{who}_Pa"] = run.lab.deviatoric_stress(name).values
    return sff_against_love({run.attrs["path"]: run}), pandas.DataFrame(columns)


def records(
    run: xarray.Dataset, groups: int = 5, snapshot: int = -1, variable: str | None = None
) -> tuple[Figure, pandas.DataFrame]:
    """Any recorded variable over the axial strain, one of your own too: of a tensor its components. Raises InputError
    for a variable that the run does not hold.
    """
    names = [name for name, values in run.data_vars.items() if values.dims[:1] == ("time",)]
    if variable not in names:
        raise InputError(
            "is not recorded" if variable else "is missing",
            field="variable",
            value=variable,
            allowed=f"one of {', '.join(map(str, names))}",
        )
    values = run[variable]
    columns = {"axial_strain": run["axial_strain"].values}
    if values.ndim == 3:
        columns |= {f"{variable}_{'xyz'[i]}{'xyz'[j]}": values.values[:, i, j] for i in range(3) for j in range(i, 3)}
    else:
        flat = values.values.reshape(len(values), -1).T
        columns |= {variable + (f"_{'xyz'[k]}" if len(flat) > 1 else ""): row for k, row in enumerate(flat)}
    figure, axes = plt.subplots(figsize=(0.6 * WIDTH, 4.0), layout="constrained")
    for color, (label, column) in zip(_colors(len(columns) - 1), list(columns.items())[1:], strict=True):
        axes.plot(percent(run), column, color=color, label=label)
    units = values.attrs.get("units", "1")
    label = f"{values.attrs.get('long_name', variable)}" + f" ({units})" * (units != "1")
    axes.set(xlabel="axial strain (%)", ylabel=label)
    axes.grid(alpha=0.25)
    if len(columns) > 2:
        axes.legend(frameon=False, fontsize=8)
    return figure, pandas.DataFrame(columns)


test.of_records = records.of_records = True  # type: ignore[attr-defined]  # they need no snapshots


def e_p_paths(
    runs: Runs, critical: Mapping[str, tuple[np.ndarray, np.ndarray]] | None = None, width: float = WIDTH
) -> Figure:
    """e against p of shear tests in one diagram (Fig. 1), and q against p beside it; a Figure.

    `runs`: label -> run. The colour is the specimen's void ratio at the start, the line style the path. `critical`:
    label -> (p, e) of critical state lines, Pa.
    """
    figure, (left, right) = plt.subplots(1, 2, figsize=(width, 0.52 * width), layout="constrained")
    styles = {name: PATHS[name].line_style for name in dict.fromkeys(run.attrs["path"] for run in runs.values())}
    start = np.array([float(run["void_ratio"][0]) for run in runs.values()])
    scale = plt.Normalize(start.min(), start.max() + 1e-9)
    for e, run in zip(start, runs.values(), strict=True):
        color, style = plt.get_cmap("viridis")(0.9 * scale(e)), styles[run.attrs["path"]]
        p, q = run.lab.mean_stress().values / 1e6, run.lab.deviatoric_stress().values / 1e6
        left.plot(p, run["void_ratio"].values, linestyle=style, color=color, lw=1.2)
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
    bar = figure.colorbar(plt.cm.ScalarMappable(scale, plt.get_cmap("viridis")), ax=right, pad=0.02)
    bar.set_label("void ratio at the start")
    return figure


QUANTITIES = {
    "strain": ("axial strain (%)", lambda run, stress: percent(run)),
    "travelled": ("axial strain travelled (%)", lambda run, stress: travelled(percent(run))),
    "p": ("p (MPa)", lambda run, stress: run.lab.mean_stress(stress).values / 1e6),
    "q": ("q (MPa)", lambda run, stress: run.lab.deviatoric_stress(stress).values / 1e6),
    "e": ("void ratio e", lambda run, stress: run["void_ratio"].values),
    "e_nominal": ("nominal void ratio e", lambda run, stress: run["void_ratio_nominal"].values),
    "Z": ("Z", lambda run, stress: run["coordination_number"].values),
    "Lambda": ("$\\Lambda$", lambda run, stress: run["mean_normalised_force"].values),
    "A": ("$A_{zz}$", lambda run, stress: run["contact_anisotropy"].values[:, 2, 2]),
    "F": ("$F_{zz}$", lambda run, stress: run["normal_force_anisotropy"].values[:, 2, 2]),
    "Ft": ("$F^t_{zz}$", lambda run, stress: run["mobilisation"].values[:, 2, 2]),
}


def diagram(name: str) -> tuple[str, str, Callable[..., tuple[np.ndarray, np.ndarray]]]:
    """(label of x, label of y, function of a run and the name of a stress that gives x and y) of a diagram.

    `name`: two of QUANTITIES, e.g. `q-strain` for q over the axial strain.
    """
    (y_label, y), (x_label, x) = (QUANTITIES[part] for part in name.split("-"))
    return x_label, y_label, lambda run, stress="stress": (x(run, stress), y(run, stress))


def percent(run: xarray.Dataset) -> np.ndarray:
    """Axial strain of the records, %."""
    return run["axial_strain"].values * 100


def curves(rows: Mapping[str, Runs], names: Sequence[str]) -> Figure:
    """Runs of simulations and of the model in the diagrams `names`, a row of panels for each group; a Figure.

    `rows`: title of the row -> (label -> run). Where a figure has both kinds, the model is dotted.
    """
    figure, grid = plt.subplots(
        len(rows), len(names), figsize=(WIDTH, 3.1 * len(rows)), layout="constrained", squeeze=False
    )
    both = len({run.attrs.get("engine") == "model" for runs in rows.values() for run in runs.values()}) > 1
    for panels, (title, runs) in zip(grid, rows.items(), strict=True):
        for color, (label, run) in zip(_colors(len(runs)), runs.items(), strict=True):
            style = ":" if both and run.attrs.get("engine") == "model" else "-"
            for axes, name in zip(panels, names, strict=True):
                axes.plot(*diagram(name)[2](run), style, color=color, lw=1.4, label=label)
        for axes, name in zip(panels, names, strict=True):
            axes.set(xlabel=diagram(name)[0], ylabel=diagram(name)[1])
            axes.grid(alpha=0.25)
        panels[0].set_title(title, loc="left", fontsize=10)
        panels[-1].legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8)
    return figure


STATISTICS = ("Z", "Lambda", "A_zz", "F_zz", "F^t_zz")


def calibration(observations: Sequence[Any], predicted: Mapping[str, np.ndarray]) -> Figure:
    """The five statistics of runs against the model with fitted parameters, over the travelled strain; a Figure.

    `observations`: of labkit.model.observation; `predicted`: name of the run -> (n, 5). Solid is the run, dotted
    the model.
    """
    figure, grid = plt.subplots(2, 3, figsize=(WIDTH, 6.0), layout="constrained")
    panels = grid.ravel()
    for color, o in zip(_colors(len(observations)), observations, strict=True):
        steps = np.linalg.norm(o.strain_step, axis=1)
        way = 100 * np.concatenate([[0.0], np.cumsum(steps)])
        for k, axes in enumerate(panels[:5]):
            axes.plot(way, o.values[:, k], "-", color=color, lw=1.0, label=o.name)
            axes.plot(way, predicted[o.name][:, k], ":", color=color, lw=1.8)
    for label, axes in zip(STATISTICS, panels, strict=False):
        axes.set(xlabel="travelled strain |eps| (%)", ylabel=label)
        axes.grid(alpha=0.25)
    panels[5].axis("off")
    lines = [Line2D([], [], color="0.3", linestyle=style, label=who) for who, style in (("run", "-"), ("model", ":"))]
    handles = panels[0].get_legend_handles_labels()[0] + lines
    panels[5].legend(handles=handles, loc="center", frameon=False, fontsize=8, ncols=1 + len(handles) // 14)
    return figure


def work_precision(panels: Mapping[str, Mapping[str, Sequence[tuple[float, float, float | None]]]]) -> Figure:
    """Time against error of integrators; a Figure. `panels`: title -> (label -> list of (setting, seconds, error)).

    Settings at which an integrator gave up have no error and no point.
    """
    figure, grid = plt.subplots(1, len(panels), figsize=(WIDTH * 1.3, 4.6), layout="constrained", squeeze=False)
    for axes, (title, curves_) in zip(grid[0], panels.items(), strict=True):
        for number, (label, points) in enumerate(curves_.items()):
            kept = [(error, 1e3 * seconds) for _, seconds, error in points if error]
            color, marker = plt.get_cmap("tab20").colors[number % 20], "osD^v<>*PXhp"[number % 12]
            axes.loglog(
                *zip(*kept, strict=True), marker=marker, ms=4, lw=1.2, color=color, label=label
            ) if kept else None
        axes.set(xlabel="relative error of the stress", ylabel="time (ms)", title=title)
        axes.title.set_fontsize(10)
        axes.invert_xaxis()
        axes.grid(alpha=0.25)
    handles = {h.get_label(): h for axes in grid[0] for h in axes.get_legend_handles_labels()[0]}
    figure.legend(handles=list(handles.values()), loc="outside lower center", ncols=6, frameon=False, fontsize=8)
    return figure


def _colors(number: int) -> Any:
    return plt.get_cmap("tab10").colors[:number] if number <= 10 else plt.get_cmap("viridis")(np.linspace(0, 1, number))


def save(
    figure: Figure, path: str | Path, inputs: Sequence[str | Path] = (), command: str | None = None, dpi: int = DPI
) -> None:
    """Writes a figure, whole or not at all, in the format of the name's ending, and closes it. A PNG file holds its
    provenance, beside another lies a file with it; `inputs`: the files that it shows, `command`: what made it
    (default: this process).
    """
    ending = Path(path).suffix[1:].lower()
    metadata = {"provenance": provenance(command, inputs, path)} if ending == "png" else None
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=dpi, format=ending, metadata=metadata)
    if ending != "png":
        write_provenance(path, inputs, command)
    plt.close(figure)
