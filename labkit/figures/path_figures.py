"""Figures that suit a path: stress path, deviatoric plane, simple shear, cycles. Each draws one run or several.

A figure takes a run opened with labkit.open_run, or a mapping label -> run of simulations and model predictions, and
returns (Figure, pandas.DataFrame). Love's stress is solid and C0 dashed; a prediction has only C0, dash-dotted.
"""

from __future__ import annotations

import contextlib
import dataclasses

import numpy as np
import xarray
from matplotlib.axes import Axes

from labkit.errors import InputError
from labkit.figures import coordinates, frame
from labkit.figures.coordinates import ABSCISSA, STRAIN, Coordinate, P, draw_runs, finish_axes, q_column, same_q
from labkit.figures.frame import WIDTH, Runs, new_panels
from labkit.micro.stress import deviatoric_stress, equivalent_stress, lode_angle, mean_stress
from labkit.micro.tensors import symmetric
from labkit.model.parameters import Model
from labkit.model.run_file import model_of
from labkit.model.strength import SECTIONS, critical_section, matsuoka_nakai, model_section
from labkit.paths.path import is_coaxial
from labkit.results.compression import compression_numbers
from labkit.results.critical import critical_states, is_shear
from labkit.results.figures import register_figure

Given = xarray.Dataset | Runs

SECTION_STYLES = ("-", "--", ":")
SMALLEST_P = 1e-3  # fraction of the largest p: q/p is not drawn below it
# F has no meaning with few contacts or without forces, and is not drawn there.
SMALLEST_Z = 1.0
SMALLEST_DEVIATOR = 0.02  # of p: sigma_1 has no direction below it
SMALLEST_LAMBDA = 0.01  # fraction of the largest Lambda

# Columns of the tables, in SI units.
STRAINS = {"strain": lambda run: run.lab.strain()}
P_PA = {"p_Pa": lambda run: run.lab.mean_stress()}
Q_INVARIANT = {"q_Pa": lambda run: equivalent_stress(run["stress"].values)}
SIGMA_XZ = {"sigma_xz_Pa": lambda run: run["stress"].values[:, 0, 2]}
VOLUME = {"volumetric_strain": lambda run: run.lab.volumetric_strain()}


@register_figure("stress_path", needs="records", several=True)
def stress_path(run: Given, strength: float | None = None, equation: bool = True) -> frame.Drawn:
    """Draw q against p, with the strength in compression and extension (Matsuoka-Nakai), and void ratio against p.

    `strength` is q/p in compression. The default is the q/p at the end of the compression tests drawn or, for the
    paper's soil, M of Table 2; for any other soil no strength is drawn. With `equation=False` only Love's stress is
    drawn.
    """
    runs = frame.name_runs(run)
    figure, (left, right) = new_panels(1, 2, 4.6)
    draw_runs((left, right), runs, [(P, same_q(runs)[0]), (P, coordinates.VOID_RATIO)], equation, lw=1.2)
    M, source = _strength(runs, strength)
    frame.include_zero(left, "x")
    low, high = left.get_ylim()
    top = np.array([0.0, left.get_xlim()[1]])
    if M is not None:
        left.plot(top, M * top, color="0.5", lw=0.8, label=f"q = {M:.3g} p, {source}")
    if M is not None and low < -0.02 * high:
        extension = float(matsuoka_nakai(M, np.array(60.0)))
        left.plot(top, -extension * top, "--", color="0.5", lw=0.8, label=f"q = -{extension:.3g} p, Matsuoka-Nakai")
    left.set(ylim=(1.05 * low, 1.05 * high), xlim=(0.0, top[1]))
    frame.include_zero(right, "x")
    right.ticklabel_format(axis="y", useOffset=False)
    columns = {**STRAINS, **P_PA, "q_Pa": q_column(runs), "void_ratio": lambda run: run["void_ratio"]}
    return finish_axes(figure, runs, columns, equation)


@register_figure("pi_plane", needs="records", several=True)
def pi_plane(run: Given, strength: float | None = None, equation: bool = True) -> frame.Drawn:
    """Draw the deviatoric plane, normalised by p, with sections of strength criteria, and the plane of x-z shear.

    On the left, the distance from the centre is q/p. A path without shear is drawn with sigma_x, sigma_y and sigma_z,
    any other path with its principal stresses. On the right, sigma_xz is drawn against (sigma_z - sigma_x)/2, so that
    a rotation of the principal stresses is a circle. `strength` is q/p of the sections in compression, and
    `equation=False` leaves the equation out, as in `stress_path`.
    """
    runs = frame.name_runs(run)
    figure, (left, right) = new_panels(1, 2, 5.4)
    M, source = _strength(runs, strength)
    if M is not None:
        _draw_sections(left, M, [model for run in runs.values() if (model := model_of(run)) is not None])
        left.set_title(f"sections: q/p = {M:.3g} in compression ({source})", fontsize="medium")
    M = M or max(float(np.nanmax(coordinates.INVARIANT_RATIO.values(run, "stress"))) for run in runs.values())
    for axis, at in zip(_axes_of(runs), (0.0, 120.0, -120.0), strict=True):
        x, y = np.sin(np.radians(at)), np.cos(np.radians(at))
        left.plot([0.0, 1.15 * M * x], [0.0, 1.15 * M * y], color="0.8", lw=0.8, zorder=0)
        left.annotate(axis, (1.25 * M * x, 1.25 * M * y), ha="center", va="center", fontsize="small")
        left.plot([1.35 * M * x], [1.35 * M * y], alpha=0.0)  # room for the label
    draw_runs((left, right), runs, [(PI_X, PI_Y), (ALONG, SHEAR)], equation, lw=1.2)
    left.set_aspect("equal")
    right.set_aspect("equal", adjustable="datalim")
    lode = {"lode_angle": lambda run: run.lab.lode_angle()}
    return finish_axes(figure, runs, {**STRAINS, **P_PA, **Q_INVARIANT, **lode, **SIGMA_XZ}, equation)


def _draw_sections(axes: Axes, M: float, models: list[Model]) -> None:
    """Draw sections of the strength criteria through q/p = M in compression, for the first of the models if any."""
    angle = np.linspace(-180.0, 180.0, 721)
    folded = np.abs((angle + 60.0) % 120.0 - 60.0)
    for style, (name, section) in zip(SECTION_STYLES, SECTIONS.items(), strict=True):
        ratio = model_section(M, folded, models[0]) if name == "model" and models else section(M, folded)
        x, y = ratio * np.sin(np.radians(angle)), ratio * np.cos(np.radians(angle))
        axes.plot(x, y, style, color="0.5", lw=0.9, label=name)


@register_figure("rotation", needs="records", several=True)
def rotation_response(run: Given, equation: bool = True) -> frame.Drawn:
    """Draw the response to a rotation of the principal stresses: strains, volume and void ratio against the angle.

    The angle is that of sigma_1 from the vertical in the x-z plane, accumulated over the turns. The last panel shows
    gamma_xz against eps_zz - eps_xx, whose direction is that of the deviatoric strain. With
    `equation=False` the stress path shows only Love's stress.
    """
    runs = frame.name_runs(run)
    figure, panels = new_panels(2, 3, 6.4)
    pairs = [(ANGLE, _strain("$\\varepsilon_{zz}$", 2, 2)), (ANGLE, GAMMA), (ANGLE, coordinates.VOLUMETRIC)]
    pairs += [(ANGLE, _strain("$\\varepsilon_{xx}$", 0, 0)), (DIFFERENCE, GAMMA), (ALONG, SHEAR)]
    draw_runs(panels.ravel(), runs, pairs, equation, lw=1.2)
    panels[1, 2].set_aspect("equal", adjustable="datalim")
    strain = {
        f"strain_{'xyz'[i]}{'xyz'[j]}": lambda run, i=i, j=j: symmetric(run["strain"].values)[:, i, j]
        for i, j in ((0, 0), (1, 1), (2, 2), (0, 2))
    }
    angle = {"angle_degrees": lambda run: ANGLE.values(run, "stress")}
    return finish_axes(figure, runs, {**angle, **strain, **VOLUME, **P_PA, **Q_INVARIANT}, equation)


@register_figure("compression", needs="records", several=True)
def compression(run: Given) -> frame.Drawn:
    """Draw oedometer and isotropic compression: void ratio against log sigma_z, and sigma_x/sigma_z and Z against it.

    sigma_x/sigma_z is K0 in an oedometer test (the mean of x and y). The heading gives C_c, C_s and K0 of one run
    (labkit.compression_numbers).
    """
    runs = frame.name_runs(run)
    figure, panels = new_panels(1, 3, 3.8)
    draw_runs(panels, runs, [(coordinates.LOG_NORMAL, y) for y in (coordinates.VOID_RATIO, K0, Z)], both=False, lw=1.2)
    columns = {"sigma_zz_Pa": lambda run: run["stress"].values[:, 2, 2], "K0": lambda run: K0.values(run, "stress")}
    if len(runs) == 1:
        with contextlib.suppress(InputError):  # a test that is too short has no numbers
            figure.suptitle(str(compression_numbers(next(iter(runs.values())))))
    return finish_axes(figure, runs, {**columns, "void_ratio": lambda run: run["void_ratio"]}, both=False)


@register_figure("shear", needs="records", several=True)
def shear(run: Given, equation: bool = True) -> frame.Drawn:
    """Draw sigma_xz and q against shear strain, sigma_xz against sigma_z, and the volume change, or p if constant.

    With `equation=False` only Love's stress is drawn.
    """
    runs = frame.name_runs(run)
    figure, panels = new_panels(2, 2, 6.4)
    undrained = all(run.lab.is_undrained for run in runs.values())
    last = dataclasses.replace(P, of_stress=False) if undrained else coordinates.VOLUMETRIC
    pairs = [
        (STRAIN, coordinates.SHEAR_STRESS),
        (STRAIN, coordinates.INVARIANT),
        (coordinates.NORMAL_STRESS, coordinates.SHEAR_STRESS),
        (STRAIN, last),
    ]
    draw_runs(panels.ravel(), runs, pairs, equation)
    frame.include_zero(panels[1, 0], "x")
    for axes in panels[0]:
        frame.include_zero(axes, "y")
    sigma_zz = {"sigma_zz_Pa": lambda run: run["stress"].values[:, 2, 2]}
    columns = {**STRAINS, **SIGMA_XZ, **sigma_zz, **Q_INVARIANT, **VOLUME}
    return finish_axes(figure, runs, columns, equation)


@register_figure("cycles", needs="records", several=True)
def cycles(run: Given) -> frame.Drawn:
    """Draw a cyclic test: r_u or the change of volume, strain, Z and F against cycles; loops; and the stress path.

    The last column shows r_u, or the change of volume, and Z against the accumulated strain, because a specimen that
    has liquefied reaches large strains within one cycle; tests without a number of cycles are drawn against the
    accumulated strain alone. F is represented by its component along z or, if the test is not axisymmetric, along the
    stress deviator. The stress path is in q and p, or in sigma_xz and sigma_z if the specimen is sheared. Raises
    InputError if no test reverses.
    """
    runs = frame.name_runs(run)
    if all(_is_monotonic(run) for run in runs.values()):
        raise InputError("draws tests that reverse", field="figure", value="cycles", allowed="the figure test")
    counted = all(run.lab.abscissa().name == "cycles" for run in runs.values())
    figure, panels = new_panels(2, 3 + counted, 6.6, (1.2 + 0.3 * counted) * WIDTH)
    undrained = all(run.lab.is_undrained for run in runs.values())
    first = RATIO if undrained else coordinates.VOLUMETRIC
    upper = [(ABSCISSA, first), (ABSCISSA, SIGNED), (ABSCISSA, Z), (coordinates.ACCUMULATED, first)]
    lower = [(STRAIN, LOOP), (NORMAL, LOOP), (ABSCISSA, FORCE), (coordinates.ACCUMULATED, Z)]
    draw_runs(panels.ravel(), runs, [*upper[: 3 + counted], *lower[: 3 + counted]], both=False, lw=1.0)
    for axes, label in zip(panels[0, ::3], ("initial liquefaction, $r_u$ = 0.95", None), strict=False):
        if undrained:
            axes.axhline(0.95, color="0.5", lw=0.8, label=label)
    frame.include_zero(panels[1, 1], "x")
    ratio = {"r_u": lambda run: run.lab.pore_pressure_ratio()} if undrained else {}
    count = {"cycles": lambda run: run.lab.cycles()} if counted else {}
    columns = {**STRAINS, **count, **P_PA, "q_Pa": q_column(runs), **SIGMA_XZ, **VOLUME, **ratio}
    return finish_axes(figure, runs, columns, both=False)


def _with_sign(label: str) -> str:
    """Add to the label of an axial strain which sign is positive; a shear strain needs none."""
    return label + ",\ncompression positive" if label.startswith("axial") else label


def _force(run: xarray.Dataset, stress: str) -> np.ndarray:
    """Return F along z or along the stress deviator at records where the contacts carry load, NaN elsewhere."""
    size = run["mean_normalised_force"]
    loaded = (run["coordination_number"] >= SMALLEST_Z) & (size > SMALLEST_LAMBDA * size.max())
    return run.lab.component("normal_force_anisotropy").where(loaded).values


def _is_monotonic(run: xarray.Dataset) -> bool:
    """Return True if the strain of the path has a sign and the path has not reversed."""
    return run.lab.strain_measure.signed and run.lab.abscissa().attrs["long_name"] == run.lab.strain_measure.name


def _is_shear(run: xarray.Dataset) -> bool:
    """Return True if the path of the run shears the specimen in x-z."""
    return run.lab.path is not None and not is_coaxial(run.lab.path)


def _either(of_shear: Coordinate, of_others: Coordinate) -> Coordinate:
    """Return a coordinate that differs between paths of simple shear and other paths."""

    def chosen(run: xarray.Dataset) -> Coordinate:
        return of_shear if _is_shear(run) else of_others

    return Coordinate(lambda run: chosen(run).common_label([run]), lambda run, stress: chosen(run).values(run, stress))


def _angle(run: xarray.Dataset, stress: str) -> np.ndarray:
    """Return the angle of sigma_1 from z in the x-z plane, degrees, continuous over turns; NaN without a deviator."""
    tensor = symmetric(run["stress"].values)
    normal, shear = 0.5 * (tensor[:, 2, 2] - tensor[:, 0, 0]), tensor[:, 0, 2]
    sheared = np.hypot(normal, shear) > SMALLEST_DEVIATOR * np.abs(mean_stress(tensor))
    angle = np.full(len(normal), np.nan)
    angle[sheared] = 0.5 * np.degrees(np.unwrap(np.arctan2(shear[sheared], normal[sheared])))
    return angle


def _strain(symbol: str, i: int, j: int) -> Coordinate:
    return Coordinate(f"strain {symbol} (%)", lambda run, _: 100 * symmetric(run["strain"].values)[:, i, j])


SIGNED = dataclasses.replace(STRAIN, label=lambda run: _with_sign(frame.as_axis(run.lab.strain())[0]))
Z = Coordinate("coordination number Z", lambda run, stress: run["coordination_number"].values)
RATIO = Coordinate("pore pressure ratio $r_u$", lambda run, stress: run.lab.pore_pressure_ratio().values)
FORCE = Coordinate(lambda run: "$F_{zz}$" if run.lab.axisymmetric else "$F$ along the deviator", _force)
ANGLE = Coordinate("angle of $\\sigma_1$ from z (degrees)", _angle)
GAMMA = Coordinate("shear strain $\\gamma_{xz}$ (%)", lambda run, _: 200 * symmetric(run["strain"].values)[:, 0, 2])
DIFFERENCE = Coordinate(
    "$\\varepsilon_{zz} - \\varepsilon_{xx}$ (%)",
    lambda run, _: 100 * (run["strain"].values[:, 2, 2] - run["strain"].values[:, 0, 0]),
)
K0 = Coordinate(
    "$\\sigma_x/\\sigma_z$ ($K_0$ in an oedometer)",
    lambda run, _: run["stress"].values[:, [0, 1], [0, 1]].mean(axis=1) / run["stress"].values[:, 2, 2],
)
# the ordinate of a hysteresis loop, and the abscissa of the stress path
LOOP = _either(coordinates.SHEAR_STRESS, coordinates.Q)
NORMAL = _either(coordinates.NORMAL_STRESS, P)


def _axes_of(runs: Runs) -> tuple[str, str, str]:
    """Return the axis labels of the deviatoric plane, clockwise from the top."""
    kinds = {_is_shear(run) for run in runs.values()}
    names = (["zxy"] if False in kinds else []) + (["123"] if True in kinds else [])
    top, right, left = (", ".join(f"$\\sigma_{which[k]}$" for which in names) for k in range(3))
    return top, right, left


def _in_planes(run: xarray.Dataset, name: str) -> tuple[np.ndarray, ...]:
    """Return coordinates of a recorded stress in both planes of `pi_plane`, (n,) each; NaN where p vanishes."""
    stress = symmetric(run[name].values)
    p = mean_stress(stress)
    p = np.where(p > SMALLEST_P * np.nanmax(p), p, np.nan)
    along, across = 0.5 * (stress[:, 2, 2] - stress[:, 0, 0]) / p, stress[:, 0, 2] / p
    if not _is_shear(run):
        x = np.sqrt(0.75) * (stress[:, 0, 0] - stress[:, 1, 1]) / p
        return x, deviatoric_stress(stress) / p, along, across
    ratio, angle = equivalent_stress(stress) / p, np.radians(lode_angle(stress))
    return ratio * np.sin(angle), ratio * np.cos(angle), along, across


def _strength(runs: Runs, strength: float | None) -> tuple[float | None, str]:
    """Return q/p in triaxial compression and a description of its source; None if these runs do not show it."""
    if strength is not None:
        if not 0.0 < strength < 3.0:
            raise InputError(field="strength", value=strength, allowed="q/p in compression, above 0 and below 3")
        return strength, "given"
    tests = {name: run for name, run in runs.items() if is_shear(run) and run.lab.axisymmetric}
    table = critical_states({name: run for name, run in tests.items() if float(run["axial_strain"][-1]) > 0.0})
    if len(table) and 0.0 < table["M"].mean() < 3.0:
        return float(table["M"].mean()), "ends of the compression tests"
    if all(run.lab.scene.of_the_paper for run in runs.values()):
        return float(critical_section(np.array(0.0))[0]), "Table 2"
    return None, ""


def _plane_coordinate(label: str, number: int) -> Coordinate:
    return Coordinate(label, lambda run, stress: _in_planes(run, stress)[number], True)


PI_X, PI_Y = (
    _plane_coordinate("q/p, normal to the vertical axis", 0),
    _plane_coordinate("q/p, along the vertical axis", 1),
)
ALONG = _plane_coordinate("$(\\sigma_{zz} - \\sigma_{xx})/2p$", 2)
SHEAR = _plane_coordinate("$\\sigma_{xz}/p$", 3)
