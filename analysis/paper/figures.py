"""The paper's figures redrawn from results/paper, and further figures.

`runs` comes from analysis.paper.runs, `models` from analysis.paper.model_runs.models. Missing runs are left out and
listed in the figure. `drawing.py` defines the line styles.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from analysis import pictures
from analysis.legends import legend_below
from analysis.paper import drawing, sources
from analysis.paper.ends import Runs, ends, sheared
from analysis.paper.lines import LINES, both_lines, critical_Lambda, critical_stress, critical_Z
from analysis.paper.model_runs import TABLE_2
from analysis.paper.specimens import density_of
from labkit.figures import micro_figures, plots, sff_figures
from labkit.micro import deviatoric_stress, mean_stress
from labkit.model import ROOT_3_2, Model
from labkit.results import SHEAR, critical_states

DPI = 200
CV_RUNS = ("cv-loose", "cv_other-loose_low", "cv-medium", "cv_other-medium_high", "cv-dense", "cv_other-dense_high")
EVOLUTION = ("Z", "Lambda", "A", "F", "Ft")
TENSORS = {"A": ("$A_{zz}$", 1, "C0"), "F": ("$F_{zz}$", 1, "C1"), "Ft": ("$5 F^t_{zz}$", 5, "C2")}
LOWEST_PRESSURE = 1e3  # Pa; below this, stress ratios are noise


def save(figure: Figure, file: str | Path, runs: Runs | None = None) -> str:
    """Writes a figure, with its run files in the provenance; returns the name of the file."""
    pictures.save(figure, file, sources(runs or {}), "./lab paper", DPI)
    return str(file)


def fig_1(runs: Runs, models: drawing.Models) -> Figure:
    """Void ratio and q against p of the monotonic shear tests, with the critical state lines."""
    tests = monotonic(runs)
    lines = {f"critical state, {name}": critical_line(model) for name, model in models.items()}
    if not tests:
        return drawing.say_missing(drawing.panels_of(1, ("e-p", "q-p"))[0], ["cv-*", "cr_*", "cp_*"])
    figure = plots.e_p_paths(tests, lines, drawing.WIDTH)
    drawing.letters(figure.axes[:2])
    return figure


def fig_2(groups: xr.Dataset | None) -> Figure:
    """Stresses sigma^N(k) and sigma^V(k) of five grain size groups in the dense CV test.

    `groups`: from contacts.read_size_groups.
    """
    with plt.rc_context(drawing.STYLE | {"axes.titlesize": 8, "axes.labelsize": 7.5}):
        if groups is None:
            nothing = plt.figure(figsize=(drawing.WIDTH, 0.5))
            return drawing.say_missing(nothing, ["stresses of the grain size groups of cv-dense"])
        return micro_figures.draw_group_stresses(groups, groups["love"], drawing.WIDTH)[0]


def fig_4(runs: Runs, models: drawing.Models) -> Figure:
    """CV tests: q against p and against axial strain, one row per void ratio."""
    rows = {density: [name for name in CV_RUNS if f"-{density}" in name] for density in drawing.DENSITIES}
    figure, grid = drawing.panels_of(3, ("q-p", "q-strain"))
    for panels, (density, names) in zip(grid, rows.items(), strict=True):
        shades = {name: drawing.mixed(drawing.COLORS[density], 0.0, 0.5 * k) for k, name in enumerate(names)}
        drawing.draw(panels, ("q-p", "q-strain"), runs, shades, models, drawing.start_pressure)
        first = next((runs[name] for name in names if name in runs), None)
        e = "" if first is None else f", e = {drawing.nominal(first):.3f}"
        drawing.set_title(panels, f"CV, {density}{e}")
    return drawing.finish(figure, models, [name for names in rows.values() for name in names if name not in runs])


def fig_5(runs: Runs, models: drawing.Models) -> Figure:
    """CR tests at 0.5 and 1 MPa: q and e against axial strain."""
    return _drained(runs, models, "cr", r"CR, $\sigma_r$")


def fig_6(runs: Runs, models: drawing.Models) -> Figure:
    """CP tests at 0.5 and 1 MPa: q and e against axial strain."""
    return _drained(runs, models, "cp", "CP, p")


def _drained(runs: Runs, models: drawing.Models, path: str, title: str) -> Figure:
    names: tuple[str, ...] = ("q-strain", "e_nominal-strain")
    missing: list[str] = []
    figure, grid = drawing.panels_of(2, names)
    for panels, (key, pressure) in zip(grid, {"500kPa": "0.5 MPa", "1MPa": "1 MPa"}.items(), strict=True):
        colors = {f"{path}_{key}-{density}": drawing.COLORS[density] for density in drawing.DENSITIES}
        drawing.draw(panels, names, runs, colors, models, drawing.start_void_ratio)
        drawing.set_title(panels, f"{title} = {pressure}")
        missing += [name for name in colors if name not in runs]
    return drawing.finish(figure, models, missing)


def fig_7(runs: Runs, models: drawing.Models) -> Figure:
    """ISOC and ISOD: e against p, from the loose and the dense specimens."""
    names: tuple[str, ...] = ("e_nominal-p",)
    missing: list[str] = []
    figure, grid = drawing.panels_of(1, names * 2, 3.2)
    for axes, (density, other) in zip(grid[0], (("loose", "loose"), ("dense", "dense_high")), strict=True):
        dark = drawing.mixed(drawing.COLORS[density], 0.0, 0.5)
        colors: dict[str, drawing.Color] = {f"isoc-{density}": drawing.COLORS[density], f"isod-{other}": dark}
        drawing.draw([axes], names, runs, colors, models, drawing.path_and_start)
        drawing.set_title([axes], density)
        missing += [name for name in colors if name not in runs]
    return drawing.finish(figure, models, missing)


def fig_8(runs: Runs, models: drawing.Models) -> Figure:
    """Cyclic CP, loose and dense: q against axial strain, and e of both tests.

    The left column shows the simulation and, as a thin black line, the monotonic test; the right column adds the model.
    """
    missing: list[str] = []
    figure, grid = plt.subplots(3, 2, figsize=(drawing.WIDTH, 8.0), sharex=True, sharey="row", layout="constrained")
    for density, panels in (("loose", grid[0]), ("dense", grid[1])):
        name, start, color = f"cyclic-cyclic_{density}", f"cp_start-cyclic_{density}", drawing.COLORS[density]
        missing += [n for n in (name, start) if n not in runs]
        for row, diagram in ((panels, "q-strain"), (grid[2], "e_nominal-strain")):
            _cyclic(row, diagram, runs.get(name), runs.get(start), color, models)
        shown = runs.get(name)
        start_state = "" if shown is None else f", {drawing.start_void_ratio(shown)}"
        drawing.set_title([panels[0]], f"simulation: {density}{start_state}")
        drawing.set_title([panels[1]], "simulation and model")
    drawing.set_title(grid[2], "void ratio of both tests")
    extra = [Line2D([], [], color="k", lw=0.8, label="monotonic simulation")]
    return drawing.finish(figure, models, missing, extra + drawing.density_handles(("loose", "dense")))


def _cyclic(
    row: Sequence[Axes],
    diagram: str,
    run: xr.Dataset | None,
    start: xr.Dataset | None,
    color: drawing.Color,
    models: drawing.Models,
) -> None:
    """Draws q or e of a cyclic test: simulation, C0 and monotonic test in the left panel, models in the right one."""
    x_label, y_label, of = drawing.diagram(diagram)
    row[0].set(ylabel=y_label)
    if run is not None:
        row[0].plot(*of(run), "-", color=drawing.mixed(color, drawing.PALE), lw=2.2)
        row[1].plot(*of(run), "-", color=drawing.mixed(color, drawing.PALE), lw=1.2)
        if diagram.startswith("q"):
            row[0].plot(*of(run, "stress_sff"), "--", color=color, lw=0.9)
        for label, model in drawing.predictions(run, models).items():
            row[1].plot(*of(model), color=color, **drawing.MODEL_STYLES[label])
    if start is not None:
        within = start.isel(time=plots.percent(start) <= 100 * _furthest(run))
        row[0].plot(*of(within), "-", color="k", lw=0.8)
    for axes in row:
        axes.set(xlabel=x_label if diagram.startswith("e") else None)


def _furthest(run: xr.Dataset | None) -> float:
    return 0.05 if run is None else 1.05 * float(np.abs(run["axial_strain"]).max())


def critical_lines(runs: Runs, models: drawing.Models) -> Figure:
    """End states of the shear tests against e: Z and Lambda with the lines of Table 2 and the fit; q/p; A, F, F^t."""
    tests = monotonic(runs)
    table = critical_states(tests) if tests else None
    fitted = fitted_lines(tests)
    lines = {**models, **({"fit to these tests": fitted} if fitted else {})}
    figure, grid = plt.subplots(2, 2, figsize=(drawing.WIDTH, 6.2), sharex=True, layout="constrained")
    (z_panel, force_panel), (ratio_panel, tensor_panel) = grid
    lowest = 0.6 if table is None else table["e"].min() - 0.01
    styles = {**drawing.MODEL_STYLES, "fit to these tests": {"ls": "-", "lw": 1.2}}
    for label, model in lines.items():
        c, style = model.parameters, {"color": "k", **styles[label]}
        e = np.linspace(lowest, c.e_cmax, 200)
        z_panel.plot(e, critical_Z(e, c), **style, label=label)
        force_panel.plot(e, critical_Lambda(e, c), **style)
    if table is not None:
        _ends(table, grid)
    for name, (_, scale, color) in TENSORS.items():
        value = getattr(models[TABLE_2].parameters, f"{name}_c") / ROOT_3_2
        tensor_panel.axhline(scale * value, color=color, ls=":", lw=1.4)
    ratio_panel.axhline(_strength(models[TABLE_2]), color="k", ls=":", lw=1.4)
    z_panel.set(ylabel="Z")
    force_panel.set(ylabel=r"$\Lambda$")
    ratio_panel.set(ylabel="q/p", xlabel="void ratio e", ylim=(0, None))
    tensor_panel.set(ylabel="$A_{zz}$, $F_{zz}$, $5 F^t_{zz}$", xlabel="void ratio e", ylim=(0, None))
    drawing.letters(grid.ravel())
    handles = [*z_panel.get_legend_handles_labels()[0], *drawing.path_handles()]
    handles += drawing.density_handles(drawing.DENSITIES)
    legend_below(figure, handles, 4)
    return drawing.say_missing(figure, [] if tests else ["cv-*", "cr_*", "cp_*"])


def _ends(table: pandas.DataFrame, grid: np.ndarray) -> None:
    """Draws the points of critical_states in the four panels."""
    (z_panel, force_panel), (ratio_panel, tensor_panel) = grid
    for row in table.itertuples():
        marker, color = drawing.MARKERS[row.path], drawing.COLORS[density_of(row.run)]
        point = {"marker": marker, "ms": 4.5, "ls": "", "mfc": "none", "color": color}
        z_panel.plot(row.e, row.Z, **point)
        force_panel.plot(row.e, row.Lambda, **point)
        ratio_panel.errorbar(row.e, row.M, row.M_scatter, **point, lw=0.7)
        for name, (_, scale, color) in TENSORS.items():
            tensor_panel.plot(row.e, scale * getattr(row, f"{name}_zz"), **(point | {"color": color}))
    for name, (label, scale, color) in TENSORS.items():
        height = scale * float(table[f"{name}_zz"].mean())
        tensor_panel.annotate(label, (1.01, height), xycoords=("axes fraction", "data"), color=color, va="center")


def evolution(runs: Runs, models: drawing.Models, names: Sequence[str], over: str = "strain") -> Figure:
    """Z, Lambda, A, F and F^t of the tests `names` against strain.

    `over`: `strain`, the axial strain, or `accumulated_strain`, the accumulated strain.
    """
    diagrams = [f"{quantity}-{over}" for quantity in EVOLUTION]
    with plt.rc_context({"axes.labelsize": 8} if over == "accumulated_strain" else {}):  # its label is long
        figure, grid = plt.subplots(2, 3, figsize=(drawing.WIDTH, 5.0), layout="constrained")
        panels = grid.ravel()
        colors = {name: drawing.COLORS[density_of(name)] for name in names}
        drawing.draw(panels[:5], diagrams, runs, colors, models, lambda run: "", c0=False)
        drawing.letters(panels[:5])
        panels[5].axis("off")
        handles = drawing.density_handles(map(density_of, names)) + drawing.line_handles(models, c0=False)
        panels[5].legend(handles=handles, loc="center", frameon=False)
        return drawing.say_missing(figure, [name for name in names if name not in runs])


def isotropic_statistics(runs: Runs, models: drawing.Models) -> Figure:
    """Z and Lambda of ISOC and ISOD against e, with the model (Eqs. 31 and 32)."""
    names, diagrams = ("isoc-loose", "isod-loose", "isoc-dense", "isod-dense_high"), ("Z-e_nominal", "Lambda-e_nominal")
    dark = {name: 0.5 * name.startswith("isod") for name in names}
    colors = {name: drawing.mixed(drawing.COLORS[density_of(name)], 0.0, dark[name]) for name in names}
    figure, grid = drawing.panels_of(1, diagrams, 3.2)
    drawing.draw(grid[0], diagrams, runs, colors, models, drawing.path_and_start, c0=False)
    drawing.letters(grid[0])
    return drawing.finish(figure, models, [name for name in names if name not in runs], c0=False)


def strength_shares(runs: Runs, path: str = "cv-{}") -> Figure:
    """Contributions of A, F, F^t and the product of A and F to q/p of C0, stacked, in tests of three densities."""
    names = [path.format(density) for density in drawing.DENSITIES]
    figure, grid = plt.subplots(1, 3, figsize=(drawing.WIDTH, 3.2), sharey=True, layout="constrained")
    for axes, density, name in zip(grid, drawing.DENSITIES, names, strict=True):
        if (run := runs.get(name)) is not None:
            sff_figures.stack_shares(axes, run.isel(time=run.lab.mean_stress() > LOWEST_PRESSURE))
        axes.set(xlabel="axial strain (%)", title=density)
    grid[0].set(ylabel="q/p")
    handles = max((axes.get_legend_handles_labels()[0] for axes in grid), key=len)
    legend_below(figure, handles, 5)
    return drawing.say_missing(figure, [name for name in names if name not in runs])


ENGINES = {  # label, line, colour
    "yade": ("YADE, rolling-resistance law", "-", "0.6"),
    "fused": ("fused, rolling-resistance law", "--", "C0"),
    "paper": ("fused, spring-dashpot law", ":", "C3"),
}
SHARE = {"cv": "q-p", "cr": "q-strain", "cp": "q-strain", "isoc": "e-p", "isod": "e-p", "cyclic": "q-strain"}


def engines(runs: Runs) -> Figure:
    """The six paths from the same states in YADE, in the fused engine with the same law, and with the paper's law."""
    missing = []
    figure, grid = plt.subplots(2, 3, figsize=(drawing.WIDTH, 5.2), layout="constrained")
    for axes, (path, diagram) in zip(grid.ravel(), SHARE.items(), strict=True):
        x_label, y_label, of = drawing.diagram(diagram)
        for engine, (_, style, color) in ENGINES.items():
            name = f"share_{path}-{engine}"
            if name in runs:
                axes.plot(*of(runs[name]), style, color=color, lw=2.2 if engine == "yade" else 1.2)
            else:
                missing.append(name)
        axes.set(xlabel=x_label, ylabel=y_label, title=path.upper() if path != "cyclic" else "cyclic CP")
    lines = [Line2D([], [], color=color, ls=style, lw=1.6, label=label) for label, style, color in ENGINES.values()]
    legend_below(figure, lines, 3)
    return drawing.say_missing(figure, missing)


def monotonic(runs: Runs) -> dict[str, xr.Dataset]:
    """The paper's monotonic shear tests at all seeds and pressures, without those that compare engines."""
    prefixes = ("cv-", "cv_other-", "cr_", "cp_500kPa-", "cp_1MPa-")
    return {name: run for name, run in runs.items() if name.startswith(prefixes) and run.attrs["path"] in SHEAR}


def fitted_lines(tests: Runs) -> Model | None:
    """Table 2 with both critical state lines replaced by the fit to the end states of the shear tests.

    The fit comes from critical_lines.csv. None if the tests do not determine the lines.
    """
    fitted = both_lines(ends(sheared(tests)))
    names = LINES["Z(e)"][0]
    return Model().with_parameters(**dict(zip(names, fitted, strict=True))) if np.isfinite(fitted).all() else None


def critical_line(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """(p in Pa, e) of the critical state line: C0 with Z^c(e), Lambda^c(e) and the critical A, F, F^t."""
    e = np.linspace(model.parameters.e_cmax - 0.2, model.parameters.e_cmax, 100)
    pressure = mean_stress(critical_stress(e, model.parameters))
    return pressure[pressure < 3e6], e[pressure < 3e6]


def _strength(model: Model) -> float:
    stress = critical_stress(model.parameters.e_cmax - 0.1, model.parameters)  # q/p is the same at any void ratio
    return deviatoric_stress(stress) / mean_stress(stress)
