"""Figures that suit a path: stress path, deviatoric plane, simple shear, cycles. Each draws one run or several.

A figure takes a run opened with labkit.open_run, or a mapping label -> run with simulations and predictions of the
model, and returns (Figure, pandas.DataFrame). Love's stress is solid, C0 dashed; a prediction has only C0, solid.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pandas
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from labkit.errors import InputError
from labkit.micro.stress import deviatoric_stress, equivalent_stress, lode_angle, mean_stress
from labkit.micro.tensors import symmetric
from labkit.model.run_file import model_of
from labkit.model.strength import SECTIONS, critical_section, matsuoka_nakai, model_section
from labkit.runs.critical import critical_states, is_shear
from labkit.visuals.frame import (
    WIDTH,
    add_heading,
    as_axis,
    colors_for,
    common_label,
    include_zero,
    name_of,
    new_figure,
)
from labkit.visuals.plots import columns_of, styles_of

Runs = Mapping[str, xarray.Dataset]
Given = xarray.Dataset | Runs
Drawn = tuple[Figure, pandas.DataFrame]

SECTION_STYLES = ("-", "--", ":")
SMALLEST_P = 1e-3  # of the largest p: q/p is not drawn below it
SMALLEST_Z = 1.0  # F is not drawn below it, or below this share of the largest Lambda: it has no meaning for a few
SMALLEST_LAMBDA = 0.01  # contacts or without forces


def stress_path(run: Given, groups: int = 5, snapshot: int = -1, strength: float | None = None) -> Drawn:
    """q against p, with the strength in compression and in extension (Matsuoka-Nakai), and void ratio against p.

    strength: q/p in compression (default: that of the compression tests drawn, else that of Table 2).
    """
    runs, figure = _runs(run), new_figure(WIDTH, 4.6)
    left, right = figure.subplots(1, 2)
    for color, (label, one) in zip(colors_for(len(runs)), runs.items(), strict=True):
        for name, style in styles_of(one).values():
            p, q = one.lab.mean_stress(name).values / 1e6, one.lab.q(name).values / 1e6
            left.plot(p, q, style, color=color, lw=1.2, label=label if style == "-" else None)
        right.plot(one.lab.mean_stress().values / 1e6, one["void_ratio"].values, color=color, lw=1.2)
    M, source = _strength(runs, strength)
    include_zero(left, "x")
    low, high = left.get_ylim()
    top = np.array([0.0, left.get_xlim()[1]])
    left.plot(top, M * top, color="0.5", lw=0.8, label=f"q = {M:.3g} p, {source}")
    if low < -0.02 * high:
        extension = float(matsuoka_nakai(M, np.array(60.0)))
        left.plot(top, -extension * top, "--", color="0.5", lw=0.8, label=f"q = -{extension:.3g} p, Matsuoka-Nakai")
    left.set(ylim=(1.05 * low, 1.05 * high), xlabel="mean stress p (MPa)", ylabel="deviatoric stress q (MPa)")
    left.set_xlim(0.0, top[1])
    right.set(xlabel="mean stress p (MPa)", ylabel="void ratio e")
    include_zero(right, "x")
    right.ticklabel_format(axis="y", useOffset=False)
    columns = {"p_Pa": lambda one: one.lab.mean_stress(), "q_Pa": lambda one: one.lab.q()}
    return _finished(figure, runs, left, {**columns, "void_ratio": lambda one: one["void_ratio"]})


def pi_plane(run: Given, groups: int = 5, snapshot: int = -1, strength: float | None = None) -> Drawn:
    """The deviatoric plane, normalised by p, with sections of strength criteria, and the plane of the shear in x-z.

    Left: the distance from the centre is q/p. A path without shear is drawn by sigma_x, sigma_y and sigma_z, any other
    one by its principal stresses. Right: sigma_xz against (sigma_z - sigma_x)/2, in which a rotation of the principal
    stresses is a circle. strength: q/p in compression of the sections (default: as for `stress_path`).
    """
    runs, figure = _runs(run), new_figure(WIDTH, 5.4)
    left, right = figure.subplots(1, 2)
    M, source = _strength(runs, strength)
    angle = np.linspace(-180.0, 180.0, 721)
    lode = np.abs((angle + 60.0) % 120.0 - 60.0)
    models = [model for one in runs.values() if (model := model_of(one)) is not None]
    for style, (name, section) in zip(SECTION_STYLES, SECTIONS.items(), strict=True):
        ratio = model_section(M, lode, models[0]) if name == "model" and models else section(M, lode)
        x, y = ratio * np.sin(np.radians(angle)), ratio * np.cos(np.radians(angle))
        left.plot(x, y, style, color="0.5", lw=0.9, label=name)
    left.set_title(f"sections: q/p = {M:.3g} in compression ({source})", fontsize=10)
    for axis, at in zip(_axes_of(runs), (0.0, 120.0, -120.0), strict=True):
        x, y = np.sin(np.radians(at)), np.cos(np.radians(at))
        left.plot([0.0, 1.15 * M * x], [0.0, 1.15 * M * y], color="0.8", lw=0.8, zorder=0)
        left.annotate(axis, (1.25 * M * x, 1.25 * M * y), ha="center", va="center", fontsize=9)
        left.plot([1.35 * M * x], [1.35 * M * y], alpha=0.0)  # room for the label
    for color, (label, one) in zip(colors_for(len(runs)), runs.items(), strict=True):
        for name, style in styles_of(one).values():
            x, y, along, shear = _in_planes(one, name)
            left.plot(x, y, style, color=color, lw=1.2, label=label if style == "-" else None)
            right.plot(along, shear, style, color=color, lw=1.2)
    left.set(xlabel="q/p, normal to the vertical axis", ylabel="q/p, along the vertical axis", aspect="equal")
    right.set(xlabel="$(\\sigma_{zz} - \\sigma_{xx})/2p$", ylabel="$\\sigma_{xz}/p$")
    right.set_aspect("equal", adjustable="datalim")
    columns = {
        "p_Pa": lambda one: one.lab.mean_stress(),
        "q_Pa": lambda one: one["time"].copy(data=equivalent_stress(one["stress"].values)),
        "lode_angle": lambda one: one.lab.lode_angle(),
        "sigma_xz_Pa": lambda one: one["stress"].isel(i=0, j=2),
    }
    return _finished(figure, runs, left, columns)


def shear(run: Given, groups: int = 5, snapshot: int = -1) -> Drawn:
    """sigma_xz and q against the shear strain, sigma_xz against sigma_z, and the change of volume, or p if constant."""
    runs, figure = _runs(run), new_figure(WIDTH, 6.4)
    panels = figure.subplots(2, 2)
    undrained = all(one.lab.is_undrained for one in runs.values())
    labels = []
    for color, (label, one) in zip(colors_for(len(runs)), runs.items(), strict=True):
        strain_label, strain = as_axis(one.lab.strain())
        labels.append(strain_label)
        for name, style in styles_of(one).values():
            stress = symmetric(one[name].values) / 1e6
            panels[0, 0].plot(strain, stress[:, 0, 2], style, color=color, label=label if style == "-" else None)
            panels[0, 1].plot(strain, equivalent_stress(stress), style, color=color)
            panels[1, 0].plot(stress[:, 2, 2], stress[:, 0, 2], style, color=color)
        last = one.lab.mean_stress().values / 1e6 if undrained else 100 * _volumetric(one)
        panels[1, 1].plot(strain, last, color=color)
    for axes in panels.flat:
        axes.set_xlabel(common_label(labels))
    panels[0, 0].set_ylabel("shear stress $\\sigma_{xz}$ (MPa)")
    panels[0, 1].set_ylabel("deviatoric stress, invariant q (MPa)")
    panels[1, 0].set(xlabel="normal stress $\\sigma_{zz}$ (MPa)", ylabel="shear stress $\\sigma_{xz}$ (MPa)")
    panels[1, 1].set_ylabel("mean stress p (MPa)" if undrained else "volumetric strain (%)")
    include_zero(panels[1, 0], "x")
    for axes in panels[0]:
        include_zero(axes, "y")
    columns = {
        "sigma_xz_Pa": lambda one: one["stress"].isel(i=0, j=2),
        "sigma_zz_Pa": lambda one: one["stress"].isel(i=2, j=2),
        "q_Pa": lambda one: one["time"].copy(data=equivalent_stress(one["stress"].values)),
        "volumetric_strain": lambda one: one["time"].copy(data=_volumetric(one)),
    }
    return _finished(figure, runs, panels[0, 0], columns)


def cycles(run: Given, groups: int = 5, snapshot: int = -1) -> Drawn:
    """A cyclic test: r_u or the change of volume, strain, Z and F against the number of cycles; loops; stress path.

    F is its component along z, or along the stress deviator if the test is not axisymmetric. A test that does not
    reverse is drawn against its strain.
    """
    runs, figure = _runs(run), new_figure(1.2 * WIDTH, 6.6)
    panels = figure.subplots(2, 3)
    undrained = all(one.lab.is_undrained for one in runs.values())
    labels: list[str] = []
    strains: list[str] = []
    controlled: list[str] = []
    for color, (label, one) in zip(colors_for(len(runs)), runs.items(), strict=True):
        (x_label, x), (strain_label, strain) = as_axis(one.lab.abscissa()), as_axis(one.lab.strain())
        loop_label, loop = _loop(one)
        for names, name in ((labels, x_label), (strains, strain_label), (controlled, loop_label)):
            names.append(name)
        p = one.lab.mean_stress().values
        first = one.lab.pore_pressure_ratio().values if undrained else 100 * _volumetric(one)
        size = one["mean_normalised_force"]
        loaded = (one["coordination_number"] >= SMALLEST_Z) & (size > SMALLEST_LAMBDA * size.max())
        force = one.lab.component("normal_force_anisotropy").where(loaded)
        series = ((x, first), (x, strain), (x, one["coordination_number"]), (strain, loop), (p / 1e6, loop), (x, force))
        for axes, (along, values) in zip(panels.flat, series, strict=True):
            axes.plot(along, values, color=color, lw=1.0, label=label)
    for axes in panels.flat:
        axes.set_xlabel(common_label(labels))
    panels[0, 0].set_ylabel("pore pressure ratio $r_u$" if undrained else "volumetric strain (%)")
    if undrained:
        panels[0, 0].axhline(0.95, color="0.5", lw=0.8, label="initial liquefaction, $r_u$ = 0.95")
    panels[0, 1].set_ylabel(common_label(strains))
    panels[0, 2].set_ylabel("coordination number Z")
    panels[1, 0].set(xlabel=common_label(strains), ylabel=common_label(controlled))
    panels[1, 1].set(xlabel="mean stress p (MPa)", ylabel=common_label(controlled))
    panels[1, 2].set_ylabel("$F_{zz}$" if all(r.lab.axisymmetric for r in runs.values()) else "$F$ along the deviator")
    include_zero(panels[1, 1], "x")
    columns = {
        "cycles": lambda one: one.lab.cycles(),
        "p_Pa": lambda one: one.lab.mean_stress(),
        "q_Pa": lambda one: one.lab.q(),
        "sigma_xz_Pa": lambda one: one["stress"].isel(i=0, j=2),
        "volumetric_strain": lambda one: one["time"].copy(data=_volumetric(one)),
        **({"r_u": lambda one: one.lab.pore_pressure_ratio()} if undrained else {}),
    }
    return _finished(figure, runs, panels[0, 0], columns, both=False)


for _figure in (stress_path, pi_plane, shear, cycles):
    _figure.of_records = _figure.of_runs = True  # type: ignore[attr-defined]  # no snapshots needed; several runs


def _runs(run: Given) -> Runs:
    return {name_of(run): run} if isinstance(run, xarray.Dataset) else run


def _volumetric(run: xarray.Dataset) -> np.ndarray:
    """Volumetric strain of the records, compression positive, (n,)."""
    return np.trace(run["strain"].values, axis1=1, axis2=2)


def _loop(run: xarray.Dataset) -> tuple[str, np.ndarray]:
    """Label and values (MPa) of the stress of a hysteresis loop: sigma_xz if the strain is gamma_xz, else q."""
    if run.lab.path is not None and not run.lab.path.coaxial:
        return "shear stress $\\sigma_{xz}$ (MPa)", symmetric(run["stress"].values)[:, 0, 2] / 1e6
    return "deviatoric stress q (MPa)", run.lab.q().values / 1e6


def _axes_of(runs: Runs) -> tuple[str, str, str]:
    """Labels of the axes of the deviatoric plane: clockwise from the top."""
    kinds = {one.lab.path is None or one.lab.path.coaxial for one in runs.values()}
    names = ["zxy"] * (True in kinds) + ["123"] * (False in kinds)
    top, right, left = (", ".join(f"$\\sigma_{which[k]}$" for which in names) for k in range(3))
    return top, right, left


def _in_planes(run: xarray.Dataset, name: str) -> tuple[np.ndarray, ...]:
    """Coordinates of a recorded stress in both planes of `pi_plane`, (n,) each; NaN where p vanishes."""
    stress = symmetric(run[name].values)
    p = mean_stress(stress)
    p = np.where(p > SMALLEST_P * np.nanmax(p), p, np.nan)
    along, across = 0.5 * (stress[:, 2, 2] - stress[:, 0, 0]) / p, stress[:, 0, 2] / p
    if run.lab.path is None or run.lab.path.coaxial:
        x = np.sqrt(0.75) * (stress[:, 0, 0] - stress[:, 1, 1]) / p
        return x, deviatoric_stress(stress) / p, along, across
    ratio, angle = equivalent_stress(stress) / p, np.radians(lode_angle(stress))
    return ratio * np.sin(angle), ratio * np.cos(angle), along, across


def _strength(runs: Runs, strength: float | None) -> tuple[float, str]:
    """q/p in triaxial compression, and where it comes from."""
    if strength is not None:
        if not 0.0 < strength < 3.0:
            raise InputError(field="strength", value=strength, allowed="q/p in compression, above 0 and below 3")
        return strength, "given"
    tests = {name: run for name, run in runs.items() if is_shear(run) and run.lab.axisymmetric}
    table = critical_states({name: run for name, run in tests.items() if float(run["axial_strain"][-1]) > 0.0})
    if len(table) and 0.0 < table["M"].mean() < 3.0:
        return float(table["M"].mean()), "ends of the compression tests"
    return float(critical_section(np.array(0.0))[0]), "Table 2"


def _finished(
    figure: Figure,
    runs: Runs,
    labelled: Axes,
    columns: Mapping[str, Callable[[xarray.Dataset], xarray.DataArray]],
    both: bool = True,
) -> Drawn:
    """The figure with its legend and heading, and its table: the strain and `columns` of all runs.

    labelled: the panel whose curves have labels; both: True if it shows Love's stress and C0.
    """
    for axes in figure.axes:
        axes.grid(alpha=0.25)
    handles = labelled.get_legend_handles_labels()[0]
    styles = {name: style for one in runs.values() for name, (_, style) in styles_of(one).items()} if both else {}
    handles += [Line2D([], [], color="0.3", linestyle=style, label=name) for name, style in styles.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=columns_of(runs, 4), frameon=False, fontsize=8)
    if len(runs) == 1:
        add_heading(figure, next(iter(runs.values())))
    tables = []
    for label, one in runs.items():
        values = {name: np.asarray(of(one).values) for name, of in columns.items()}
        tables.append(pandas.DataFrame({"run": label, "strain": one.lab.strain().values, **values}))
    table = pandas.concat(tables, ignore_index=True)
    return figure, table if len(runs) > 1 else table.drop(columns="run")
