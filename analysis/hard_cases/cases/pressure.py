"""Extreme pressures: from no contacts at all to overlaps beyond the limit."""

from __future__ import annotations

import numpy as np
import xarray as xr

import labkit as lk
from analysis.hard_cases.checks import Check, below, between, later_half, pressure_text, ratio_text, true
from analysis.hard_cases.laboratory import Judged, Laboratory, without_ledger
from analysis.hard_cases.measures import FREE_STEPS
from labkit.engines import FusedEngine
from labkit.grains import State
from labkit.paths import ConstantVolume, IsotropicCompression
from labkit.records import OVERLAP_LIMIT, fluctuation_velocity, pressure_limit


def loose_cv(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    state = lab.specimen()
    run, reference = lab.run(state), lab.half_step(state)
    p = run.lab.mean_stress().values
    whole = lab.extent == 1.0
    fraction = 0.1 if whole else 0.9  # fraction of the initial p
    strain, expected = (_strain_of_fall(each, fraction) for each in (run, reference))
    checks = [
        true("p > 0 at all records", p.min() > 0.0),
        below("p at the end over p at the start", p[-1] / p[0], 0.05 if whole else fraction),
        # A vanishing skeleton is chaotic: with time steps of 0.5, 0.6, 0.7, 0.8 and 1 times the usual one, p fell to a
        # tenth at strains from 9.8 to 14.7 %, and q/p was 0.76 to 0.96 afterwards.
        below(
            f"strain at which p falls to {fraction:g} of its start, difference from half the time step",
            abs(strain - expected),
            0.06,
        ),
        between("q/p", later_half(run)["q/p"], 0.5 if whole else 0.0, 1.2),
    ]
    return f"{pressure_text(run)}, minimum {p.min():.3g} Pa; {ratio_text(run)}", checks


def _strain_of_fall(run: xr.Dataset, fraction: float) -> float:
    """Axial strain at which p first falls below `fraction` of its start."""
    p = run.lab.mean_stress().values
    return float(run["axial_strain"].values[np.argmax(p < fraction * p[0])])


def isod_to_nothing(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    run = lab.run(lab.specimen())
    end = lk.read_state(lab.runs[-1])
    last = run.isel(time=-1)
    names = ("contact_anisotropy", "normal_force_anisotropy", "mobilisation")
    checks = [
        true("no contact is left", len(end.contact_grain) == 0),
        true("stress is exactly 0", not last["stress"].values.any() and not last["stress_sff"].values.any()),
        true("Z is exactly 0", float(last["coordination_number"]) == 0.0),
        true("A, F and F^t are NaN", all(np.isnan(last[name].values).all() for name in names)),
        *_flight(end),
    ]
    cv = ConstantVolume(rate=20.0, strain=0.04 * lab.extent)
    sheared = lab.run(without_ledger(end.at_rest()), cv, "sheared", record_strain=1e-3 * lab.extent)
    free = sheared["coordination_number"].values == 0.0
    checks += [
        true("sheared: some records have no contacts", free.any()),
        true("sheared: stress exactly 0 there", not sheared["stress"].values[free].any()),
        true("sheared: p > 0 at all records with contacts", (sheared.lab.mean_stress().values[~free] > 0.0).all()),
    ]
    return (
        f"{pressure_text(run)} after {-float(last['axial_strain']):.2%} of dilation; in the CV test afterwards, Z = 0 "
        f"at {free.sum()} of {free.size} records, {pressure_text(sheared)}"
    ), checks


def _flight(end: State) -> list[Check]:
    """Checks that grains without contacts keep their velocities, on the `fused` engine in the deforming cell."""
    engine = FusedEngine(end, precision=end.precision)
    met: set[int] = set()
    for _ in range(FREE_STEPS):
        engine.advance(1, end.velocity_gradient)
        met.update(engine.state().contact_grain.ravel().tolist())
    after = engine.state()
    before = fluctuation_velocity(end)
    size = np.linalg.norm(before, axis=1).max()
    change = np.linalg.norm(fluctuation_velocity(after) - before, axis=1)
    alone = ~np.isin(np.arange(end.number_of_grains), list(met))
    work = abs(after.ledger.cell_work - end.ledger.cell_work) / end.ledger.start
    return [
        true(f"most grains meet no other within {FREE_STEPS} steps", alone.mean() > 0.5),
        below("change of the velocities of those, relative to the largest", change[alone].max() / size, 1e-9),
        below("work of the empty cell over the initial energy", work, 1e-6),
    ]


def isoc_beyond(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    state = lab.specimen()
    run = lab.run(state)
    p, overlap = run.lab.mean_stress().values, run["overlap_ratio"].values
    refusal = lab.refused_run(state, "more", IsotropicCompression(pressure=4e6))
    limit = pressure_limit(state.scene)
    checks = [
        true("p reaches 3 MPa", p[-1] >= limit > p[-2]),
        true("overlap exceeds 2 %", overlap[-1] > OVERLAP_LIMIT),
        true("the run reports it", "mean overlap" in lab.names_exceeded()),
        true("4 MPa is refused", "at most 3e+06" in refusal),
        true("p grows with the strain", (np.diff(p) > 0.0).all()),
    ]
    return f"{pressure_text(run)}, mean overlap {overlap[-1]:.2%} of D", checks


def very_dense(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    state = lab.specimen()
    run = lab.run(state)
    p, overlap = run.lab.mean_stress().values, run["overlap_ratio"].values
    names = lab.names_exceeded()
    checks = [true(f"the run reports: {name}", name in names) for name in ("mean overlap", "mean stress")]
    return f"{pressure_text(run)}, mean overlap {overlap.max():.1%} of D; {ratio_text(run)}", [
        *checks,
        true("p exceeds the limit", p.min() > pressure_limit(state.scene)),
    ]


def very_loose(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    scene = lab.scene
    file = lab.folder / "s.state.nc"
    recipe = lk.Recipe(scene.void_ratio, scene.step1_friction, grains=lab.grains, cell="fixed")
    message = str(lab.refused(lambda: lk.make_specimen(recipe, engine=lab.device, file=file, progress=False)))
    checks = [
        true("the error says what to change", "coordination number" in message and "void ratio" in message),
        true("no file is left behind", not file.exists()),
    ]
    return message, checks


def gentle_servo(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    run = lab.run(lab.specimen())
    p = run.lab.mean_stress().values
    return f"p {p.min() / 1e3:.2f} to {p.max() / 1e3:.2f} kPa; {ratio_text(run)}", [
        below("relative error of p at the start", abs(p[0] / lab.scene.pressure - 1.0), 2e-3)
    ]
