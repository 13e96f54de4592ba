"""The figures of the paper from results/paper, and those that the paper lacks.

The colour is the density of the specimen. The simulation is a broad pale line, C0 dashed on it, the model dotted
(Table 2) and dash-dotted (calibrated). `runs` is of labkit.paper.runs, `models` of labkit.paper.model_runs.models; what
is not among the runs is left out and said in the figure.
"""

from __future__ import annotations

import textwrap

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D

from labkit.visuals import micro_figures
from labkit.visuals import plots
from labkit.runs.critical import SHEAR, critical_states
from labkit.errors import InputError
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.model.parameters import ROOT_3_2, Model
from labkit.paper import sources
from labkit.paper.ends import ends, sheared
from labkit.paper.lines import LINES, both_lines, critical_Lambda, critical_stress, critical_Z
from labkit.paper.model_runs import CALIBRATED, TABLE_2, model_run

WIDTH = 7.2  # inches, of a page of A4
DPI = 200
STYLE = {"font.size": 9, "axes.titlesize": 9, "legend.fontsize": 8, "axes.grid": True, "grid.alpha": 0.25}
DENSITIES = ("loose", "medium", "dense")
COLORS = {"loose": "#d55e00", "medium": "#009e73", "dense": "#0072b2"}
MARKERS = {"cv": "o", "cr": "s", "cp": "^"}
PALE = 0.55  # of white in the broad line of a simulation
MODEL_STYLES = {TABLE_2: {"ls": ":", "lw": 1.6}, CALIBRATED: {"ls": (0, (5, 1.5, 1, 1.5)), "lw": 1.1}}
LOWEST_PRESSURE = 1e3  # Pa, below which stress ratios are noise


def save(figure, file, runs=None):
    """Writes a figure with the run files behind it in its provenance; the name of the file."""
    plots.save(figure, file, sources(runs or {}), "labkit notebooks", DPI)
    return str(file)


def fig_1(runs, models):
    """e against p of the monotonic shear tests, and q against p, with the critical state lines."""
    tests = monotonic(runs)
    lines = {f"critical state, {name}": critical_line(model) for name, model in models.items()}
    with plt.rc_context(STYLE):
        if not tests:
            return _say_missing(_panels(1, ("e-p", "q-p"))[0], ["cv-*", "cr_*", "cp_*"])
        figure = plots.e_p_paths(tests, lines, WIDTH)
        _letters(figure.axes[:2])
        return figure


def fig_2(groups):
    """sigma^N(k) and sigma^V(k) of five grain size groups in the dense CV test.

    `groups`: of size_groups.read_size_groups.
    """
    with plt.rc_context(STYLE | {"axes.titlesize": 8}):
        if groups is None:
            return _say_missing(plt.figure(figsize=(WIDTH, 0.5)), ["the stresses of size groups of cv-dense"])
        return micro_figures.group_stresses(groups, groups["love"], WIDTH)[0]


def fig_4(runs, models):
    """CV tests: q against p, and q against axial strain; a row per void ratio."""
    rows = {density: (f"cv-{density}", *(f"cv_other-{density}_{p}" for p in ("low", "high"))) for density in DENSITIES}
    rows = {density: [name for name in names if name in CV_RUNS] for density, names in rows.items()}
    with plt.rc_context(STYLE):
        figure, grid = _panels(3, ("q-p", "q-strain"))
        for panels, (density, names) in zip(grid, rows.items()):
            shades = {name: _mix(COLORS[density], 0.0, 0.5 * k) for k, name in enumerate(names)}
            _draw(panels, ("q-p", "q-strain"), runs, shades, models, _start_pressure)
            first = next((runs[name] for name in names if name in runs), None)
            _title(panels, f"CV, {density}" + ("" if first is None else f", e = {_nominal(first):.3f}"))
        return _finish(figure, grid, models, [name for names in rows.values() for name in names if name not in runs])


CV_RUNS = ("cv-loose", "cv_other-loose_low", "cv-medium", "cv_other-medium_high", "cv-dense", "cv_other-dense_high")


def fig_5(runs, models):
    """CR tests at 0.5 and 1 MPa: q and e against axial strain."""
    return _drained(runs, models, "cr", r"CR, $\sigma_r$")


def fig_6(runs, models):
    """CP tests at 0.5 and 1 MPa: q and e against axial strain."""
    return _drained(runs, models, "cp", "CP, p")


def _drained(runs, models, path, title):
    names, missing = ("q-strain", "e_nominal-strain"), []
    with plt.rc_context(STYLE):
        figure, grid = _panels(2, names)
        for panels, (key, pressure) in zip(grid, {"500kPa": "0.5 MPa", "1MPa": "1 MPa"}.items()):
            colors = {f"{path}_{key}-{density}": COLORS[density] for density in DENSITIES}
            _draw(panels, names, runs, colors, models, _start_void_ratio)
            _title(panels, f"{title} = {pressure}")
            missing += [name for name in colors if name not in runs]
        return _finish(figure, grid, models, missing)


def fig_7(runs, models):
    """ISOC and ISOD: e against p, from the loose and from the dense specimens."""
    names, missing = ("e_nominal-p",), []
    with plt.rc_context(STYLE):
        figure, grid = _panels(1, names * 2, 3.2)
        for axes, (density, other) in zip(grid[0], (("loose", "loose"), ("dense", "dense_high"))):
            dark = _mix(COLORS[density], 0.0, 0.5)
            colors = {f"isoc-{density}": COLORS[density], f"isod-{other}": dark}
            _draw([axes], names, runs, colors, models, _path_and_start)
            _title([axes], density)
            missing += [name for name in colors if name not in runs]
        return _finish(figure, grid, models, missing)


def fig_8(runs, models):
    """Cyclic CP, loose and dense: q against axial strain, and e of both; left the simulation, right the model over it.

    The thin black line is the monotonic test.
    """
    missing = []
    with plt.rc_context(STYLE):
        figure, grid = plt.subplots(3, 2, figsize=(WIDTH, 8.0), sharex=True, sharey="row", layout="constrained")
        for density, panels in (("loose", grid[0]), ("dense", grid[1])):
            name, start, color = f"cyclic-cyclic_{density}", f"cp_start-cyclic_{density}", COLORS[density]
            missing += [n for n in (name, start) if n not in runs]
            for row, diagram in ((panels, "q-strain"), (grid[2], "e_nominal-strain")):
                _cyclic(row, diagram, runs.get(name), runs.get(start), color, models)
            shown = runs.get(name)
            words = f"{density}" + ("" if shown is None else f", {_start_void_ratio(shown)}")
            _title([panels[0]], f"simulation: {words}")
            _title([panels[1]], "model over it")
        _title(grid[2], "void ratio of both")
        extra = [Line2D([], [], color="k", lw=0.8, label="monotonic simulation")]
        return _finish(figure, grid, models, missing, extra + _density_handles(("loose", "dense")))


def _cyclic(row, diagram, run, start, color, models):
    """q or e of a cyclic test: simulation, C0 and the monotonic test in the left panel, the models in the right one."""
    x_label, y_label, of = plots.diagram(diagram)
    row[0].set(ylabel=y_label)
    if run is not None:
        row[0].plot(*of(run), "-", color=_mix(color, PALE), lw=2.2)
        row[1].plot(*of(run), "-", color=_mix(color, PALE), lw=1.2)
        if diagram.startswith("q"):
            row[0].plot(*of(run, "stress_sff"), "--", color=color, lw=0.9)
        for label, model in _predicted(run, models).items():
            row[1].plot(*of(model), color=color, **MODEL_STYLES[label])
    if start is not None:
        within = start.isel(time=plots.percent(start) <= 100 * _furthest(run))
        row[0].plot(*of(within), "-", color="k", lw=0.8)
    for axes in row:
        axes.set(xlabel=x_label if diagram.startswith("e") else None)


def _furthest(run):
    return 0.05 if run is None else 1.05 * float(np.abs(run["axial_strain"]).max())


def critical_lines(runs, models):
    """Where the shear tests end: Z and Lambda over e with the lines of Table 2 and of the fit, q/p, A, F and F^t."""
    tests = monotonic(runs)
    table = critical_states(tests) if tests else None
    fitted = fitted_lines(tests)
    lines = models | ({"fit to these tests": fitted} if fitted else {})
    with plt.rc_context(STYLE):
        figure, grid = plt.subplots(2, 2, figsize=(WIDTH, 6.2), sharex=True, layout="constrained")
        (z_panel, force_panel), (ratio_panel, tensor_panel) = grid
        lowest = 0.6 if table is None else table["e"].min() - 0.01
        styles = MODEL_STYLES | {"fit to these tests": {"ls": "-", "lw": 1.2}}
        for label, model in lines.items():
            c, style = model.parameters, {"color": "k", **styles[label]}
            e = np.linspace(lowest, c.e_cmax, 200)
            z_panel.plot(e, critical_Z(e, c), **style, label=label)
            force_panel.plot(e, critical_Lambda(e, c), **style)
        if table is not None:
            _ends(table, tests, grid)
        terms = zip(("A_c", "F_c", "Ft_c"), (1, 1, 5), ("C0", "C1", "C2"))
        for name, scale, color in terms:
            value = getattr(models[TABLE_2].parameters, name) / ROOT_3_2
            tensor_panel.axhline(scale * value, color=color, ls=":", lw=1.4)
        ratio_panel.axhline(_strength(models[TABLE_2]), color="k", ls=":", lw=1.4)
        for axes, label in zip(grid.ravel(), ("Z", r"$\Lambda$", "q/p", "$A_{zz}$, $F_{zz}$, $5 F^t_{zz}$")):
            axes.set(ylabel=label)
        for axes in grid[1]:
            axes.set(xlabel="void ratio e")
        ratio_panel.set(ylim=(0, None))
        tensor_panel.set(ylim=(0, None))
        _letters(grid.ravel())
        handles = z_panel.get_legend_handles_labels()[0] + _path_handles() + _density_handles(DENSITIES)
        figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
        return _say_missing(figure, [] if tests else ["cv-*", "cr_*", "cp_*"])


def _ends(table, tests, grid):
    """The points of critical_states in the four panels."""
    (z_panel, force_panel), (ratio_panel, tensor_panel) = grid
    for row in table.itertuples():
        point = {"marker": MARKERS[row.path], "ms": 4.5, "ls": "", "mfc": "none", "color": COLORS[density_of(row.run)]}
        z_panel.plot(row.e, row.Z, **point)
        force_panel.plot(row.e, row.Lambda, **point)
        ratio_panel.errorbar(row.e, row.M, row.M_scatter, **point, lw=0.7)
        for value, color in ((row.A_zz, "C0"), (row.F_zz, "C1"), (5 * row.Ft_zz, "C2")):
            tensor_panel.plot(row.e, value, **(point | {"color": color}))
    for name, y, color in (("$A_{zz}$", "A_zz", "C0"), ("$F_{zz}$", "F_zz", "C1"), ("$5 F^t_{zz}$", "Ft_zz", "C2")):
        height = float(table[y].mean()) * (5 if y == "Ft_zz" else 1)
        tensor_panel.annotate(name, (1.01, height), xycoords=("axes fraction", "data"), color=color, va="center")


EVOLUTION = ("Z", "Lambda", "A", "F", "Ft")


def evolution(runs, models, names, over="strain"):
    """Z, Lambda, A, F and F^t of the tests `names` over the axial strain, or over the strain `travelled`."""
    diagrams = [f"{quantity}-{over}" for quantity in EVOLUTION]
    with plt.rc_context(STYLE):
        figure, grid = plt.subplots(2, 3, figsize=(WIDTH, 5.0), layout="constrained")
        panels = grid.ravel()
        colors = {name: COLORS[density_of(name)] for name in names}
        _draw(panels[:5], diagrams, runs, colors, models, lambda run: "", c0=False)
        _letters(panels[:5])
        panels[5].axis("off")
        handles = _density_handles(density_of(name) for name in names) + _line_handles(models, c0=False)
        panels[5].legend(handles=handles, loc="center", frameon=False)
        return _say_missing(figure, [name for name in names if name not in runs])


def isotropic_statistics(runs, models):
    """Z and Lambda of ISOC and ISOD over e, with the model: Eqs. 31 and 32."""
    names, diagrams = ("isoc-loose", "isod-loose", "isoc-dense", "isod-dense_high"), ("Z-e_nominal", "Lambda-e_nominal")
    colors = {name: _mix(COLORS[density_of(name)], 0.0, 0.5 * name.startswith("isod")) for name in names}
    with plt.rc_context(STYLE):
        figure, grid = _panels(1, diagrams, 3.2)
        _draw(grid[0], diagrams, runs, colors, models, _path_and_start, c0=False)
        _letters(grid[0])
        return _finish(figure, grid, models, [name for name in names if name not in runs], c0=False)


def strength_shares(runs, path="cv-{}"):
    """What A, F, F^t and the product of A and F add to q/p of C0, stacked, in the tests `path` of three densities."""
    names = [path.format(density) for density in DENSITIES]
    with plt.rc_context(STYLE):
        figure, grid = plt.subplots(1, 3, figsize=(WIDTH, 3.2), sharey=True, layout="constrained")
        for axes, density, name in zip(grid, DENSITIES, names):
            if name in runs:
                run = runs[name]
                micro_figures.stack_shares(axes, run.isel(time=run.lab.mean_stress() > LOWEST_PRESSURE))
            axes.set(xlabel="axial strain (%)", title=density)
        grid[0].set(ylabel="q/p")
        handles = max((axes.get_legend_handles_labels()[0] for axes in grid), key=len)
        figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False)
        return _say_missing(figure, [name for name in names if name not in runs])


ENGINES = {"yade": ("YADE", "-"), "fused": ("fused, law yade", "--"), "paper": ("fused, law paper", ":")}
SHARE = {"cv": "q-p", "cr": "q-strain", "cp": "q-strain", "isoc": "e-p", "isod": "e-p", "cyclic": "q-strain"}


def engines(runs):
    """The six paths from the same states on YADE, on the engine fused with YADE's law, and with the paper's law."""
    missing = []
    with plt.rc_context(STYLE):
        figure, grid = plt.subplots(2, 3, figsize=(WIDTH, 5.2), layout="constrained")
        for axes, (path, diagram) in zip(grid.ravel(), SHARE.items()):
            x_label, y_label, of = plots.diagram(diagram)
            for (engine, (_, style)), color in zip(ENGINES.items(), ("0.6", "C0", "C3")):
                name = f"share_{path}-{engine}"
                if name in runs:
                    axes.plot(*of(runs[name]), style, color=color, lw=2.2 if engine == "yade" else 1.2)
                else:
                    missing.append(name)
            axes.set(xlabel=x_label, ylabel=y_label, title=path.upper() if path != "cyclic" else "cyclic CP")
        handles = [Line2D([], [], color=color, ls=style, lw=1.6, label=label)
                   for (label, style), color in zip(ENGINES.values(), ("0.6", "C0", "C3"))]  # fmt: skip
        figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
        return _say_missing(figure, missing)


def monotonic(runs):
    """The monotonic shear tests of the paper among the runs: all seeds and pressures, not those of YADE's share."""
    prefixes = ("cv-", "cv_other-", "cr_", "cp_500kPa-", "cp_1MPa-")
    return {name: run for name, run in runs.items() if name.startswith(prefixes) and run.attrs["path"] in SHEAR}


def density_of(name):
    """`dense`, `medium` or `loose` from the name of a run. Raises InputError when it has none of them."""
    for density in DENSITIES:
        if density in name.split("-", 1)[-1]:
            return density
    raise InputError(f"run {name} names no density: give one of a dense, medium or loose specimen")


def fitted_lines(tests):
    """Table 2 with both critical state lines of critical_lines.csv, fitted to the ends of the shear tests over the
    reported e; None where they do not determine them."""
    found = both_lines(ends(sheared(tests)))
    names = LINES["Z(e)"][0]
    return Model().with_parameters(**dict(zip(names, found))) if np.isfinite(found).all() else None


def critical_line(model):
    """(p in Pa, e) of the critical state line: C0 with Z^c(e), Lambda^c(e) and the critical A, F, F^t."""
    e = np.linspace(model.parameters.e_cmax - 0.2, model.parameters.e_cmax, 100)
    pressure = mean_stress(critical_stress(e, model.parameters))
    return pressure[pressure < 3e6], e[pressure < 3e6]


def _strength(model):
    stress = critical_stress(model.parameters.e_cmax - 0.1, model.parameters)  # q/p is the same at any void ratio
    return deviatoric_stress(stress) / mean_stress(stress)


def _panels(rows, names, height=2.5):
    figure, grid = plt.subplots(
        rows, len(names), figsize=(WIDTH, height * rows + 0.6), layout="constrained", squeeze=False
    )
    for panels in grid:
        for axes, name in zip(panels, names):
            axes.set(xlabel=plots.diagram(name)[0], ylabel=plots.diagram(name)[1])
    return figure, grid


def _draw(panels, names, runs, colors, models, label_of, c0=True):
    """Draws the runs that are there: simulation, C0 and models; `colors`: name of the run -> colour."""
    for axes, name in zip(panels, names):
        axes.set(xlabel=plots.diagram(name)[0], ylabel=plots.diagram(name)[1])
    for run_name in (name for name in colors if name in runs):
        run, color = runs[run_name], colors[run_name]
        predicted = _predicted(run, models)
        for axes, name in zip(panels, names):
            of = plots.diagram(name)[2]
            axes.plot(*of(run), "-", color=_mix(color, PALE), lw=2.4)
            axes.plot([], [], "-", color=color, lw=1.6, label=label_of(run))
            if c0:
                axes.plot(*of(run, "stress_sff"), "--", color=color, lw=0.9)
            for label, model in predicted.items():
                axes.plot(*of(model), color=color, **MODEL_STYLES[label])
    handles, labels = panels[-1].get_legend_handles_labels()
    if any(labels):
        panels[-1].legend(handles, labels, frameon=False, loc="best", handlelength=1.2)


def _predicted(run, models):
    """name -> the model's run; of a run whose start the model cannot take (no contacts, e.g.) there is none."""
    try:
        return {label: model_run(run, model) for label, model in models.items()}
    except InputError:
        return {}


def _finish(figure, grid, models, missing, handles=(), c0=True):
    """The common legend, and what is missing."""
    figure.legend(handles=[*_line_handles(models, c0), *handles], loc="outside lower center", ncols=4, frameon=False)
    return _say_missing(figure, missing)


def _line_handles(models, c0=True):
    lines = [Line2D([], [], color=_mix("k", PALE), lw=2.4, label="simulation")]
    lines += [Line2D([], [], color="k", ls="--", lw=0.9, label="C0")] * c0
    return lines + [Line2D([], [], color="k", label=f"model, {name}", **MODEL_STYLES[name]) for name in models]


def _density_handles(densities):
    return [Line2D([], [], color=COLORS[density], lw=2, label=density) for density in dict.fromkeys(densities)]


def _path_handles():
    return [Line2D([], [], color="0.3", marker=marker, mfc="none", ls="", ms=4.5, label=path.upper())
            for path, marker in MARKERS.items()]  # fmt: skip


def _say_missing(figure, missing):
    """Names what is missing above the panels; the figure."""
    if missing:
        words = textwrap.fill("not there: " + ", ".join(missing), 110)
        figure.suptitle(words, fontsize=7, color="0.4")
    return figure


def _title(panels, words):
    panels[0].set_title(words, loc="left")


def _letters(panels):
    for letter, axes in zip("abcdefgh", panels):
        axes.set_title(f"({letter})", loc="left")


def _mix(color, white=0.0, black=0.0):
    """The colour with a share of white, or of black, in it."""
    rgb = np.array(to_rgb(color))
    return tuple((rgb * (1.0 - white) + white) * (1.0 - black))


def _nominal(run):
    return float(run["void_ratio_nominal"][0])


def _start_pressure(run):
    return f"$p_0$ = {float(run.lab.mean_stress()[0]) / 1e6:.2f} MPa"


def _start_void_ratio(run):
    return f"$e_0$ = {_nominal(run):.3f}"


def _path_and_start(run):
    return f"{run.attrs['path'].upper()}, {_start_void_ratio(run)}"
