"""Pressures at the ends of what is possible: from no contact at all to overlaps beyond the limit."""

from __future__ import annotations

import numpy as np

import labkit as lk
from analysis.hard_cases.checks import below, between, later_half, pressure_words, ratio_words, true
from analysis.hard_cases.laboratory import Judged, Laboratory, without_ledger
from analysis.hard_cases.measures import FREE_STEPS
from labkit.dem import (
    OVERLAP_LIMIT,
    ConstantVolume,
    IsotropicCompression,
    fluctuation_velocity,
    pressure_limit,
    read_checkpoint,
)
from labkit.engines import FusedEngine


def loose_cv(lab: Laboratory) -> Judged:
    """See the scene of this name."""
    state = lab.specimen()
    run, reference = lab.run(state), lab.half_step(state)
    p = run.lab.mean_stress().values
    whole = lab.extent == 1.0
    fall = 0.1 if whole else 0.9  # of its start, to which p falls
    there, expected = (_strain_of_fall(each, fall) for each in (run, reference))
    checks = [
        true("p > 0 all along", p.min() > 0.0),
        below("p at the end over the start", p[-1] / p[0], 0.05 if whole else fall),
        # A skeleton that is about to vanish is chaotic: with steps of 0.5, 0.6, 0.7, 0.8 and 1 of the usual one p fell
        # to a tenth at strains from 9.8 to 14.7 %, and q/p beyond was 0.76 to 0.96.
        below(f"strain at which p is at {fall:g} of its start, against half the step", abs(there - expected), 0.06),
        between("q/p", later_half(run)["q/p"], 0.5 if whole else 0.0, 1.2),
    ]
    return f"{pressure_words(run)}, at least {p.min():.3g} Pa; {ratio_words(run)}", checks


def _strain_of_fall(run, share):
    """Axial strain at which p first is below `share` of its start."""
    p = run.lab.mean_stress().values
    return run["axial_strain"].values[np.argmax(p < share * p[0])]


def isod_to_nothing(lab: Laboratory) -> Judged:
    """See the scene of this name."""
    run = lab.run(lab.specimen())
    gone = read_checkpoint(lab.runs[-1])
    last = run.isel(time=-1)
    names = ("contact_anisotropy", "normal_force_anisotropy", "mobilisation")
    checks = [
        true("no contact is left", len(gone.contact_grain) == 0),
        true("stress is exactly 0", not last["stress"].values.any() and not last["stress_sff"].values.any()),
        true("Z is exactly 0", float(last["coordination_number"]) == 0.0),
        true("A, F and F^t are no numbers", all(np.isnan(last[name].values).all() for name in names)),
        *_flight(gone),
    ]
    cv = ConstantVolume(rate=20.0, strain=0.04 * lab.extent)
    sheared = lab.run(without_ledger(gone.at_rest()), cv, "sheared", record_strain=1e-3 * lab.extent)
    free = sheared["coordination_number"].values == 0.0
    checks += [
        true("sheared: some records without contacts", free.any()),
        true("sheared: stress exactly 0 there", not sheared["stress"].values[free].any()),
        true("sheared: p > 0 wherever grains touch", (sheared.lab.mean_stress().values[~free] > 0.0).all()),
    ]
    return (
        f"{pressure_words(run)} after {-float(last['axial_strain']):.2%} of dilation; then Z = 0 at {free.sum()} of "
        f"{free.size} records of CV, {pressure_words(sheared)}"
    ), checks


def _flight(gone):
    """Without contacts, grains keep their velocities; followed by the engine fused, in the cell that goes on."""
    engine = FusedEngine(gone)
    engine.advance(FREE_STEPS, gone.velocity_gradient)
    after = engine.state()
    # Grains at rest do not tell, those that meet another in the meantime may turn
    before, size = fluctuation_velocity(gone), np.linalg.norm(fluctuation_velocity(gone), axis=1)
    change = np.linalg.norm(fluctuation_velocity(after) - before, axis=1)
    share = np.mean(change < 1e-9 * size.max())
    work = abs(after.ledger.cell_work - gone.ledger.cell_work) / gone.ledger.start
    return [
        below(f"grains that turn within {FREE_STEPS} steps", 1.0 - share, 0.1),
        below("work of the empty cell over the first energy", work, 1e-6),
    ]


def isoc_beyond(lab: Laboratory) -> Judged:
    """See the scene of this name."""
    state = lab.specimen()
    run = lab.run(state)
    p, overlap = run.lab.mean_stress().values, run["overlap_ratio"].values
    refusal = lab.refused_run(state, "more", IsotropicCompression(pressure=4e6))
    limit = pressure_limit(state.scene)
    checks = [
        true("p reaches 3 MPa", p[-1] >= limit > p[-2]),
        true("overlap is beyond 2 %", overlap[-1] > OVERLAP_LIMIT),
        true("the run says so", "mean overlap" in lab.names_exceeded()),
        true("4 MPa is refused", "at most 3e+06" in refusal),
        true("p grows with the strain", (np.diff(p) > 0.0).all()),
    ]
    return f"{pressure_words(run)}, mean overlap {overlap[-1]:.2%} of D", checks


def very_dense(lab: Laboratory) -> Judged:
    """See the scene of this name."""
    state = lab.specimen()
    run = lab.run(state)
    p, overlap = run.lab.mean_stress().values, run["overlap_ratio"].values
    said = lab.names_exceeded()
    checks = [true(f"the run says: {what}", what in said) for what in ("mean overlap", "mean stress in Pa")]
    return f"{pressure_words(run)}, mean overlap {overlap.max():.1%} of D; {ratio_words(run)}", [
        *checks,
        true("p is beyond the limit", p.min() > pressure_limit(state.scene)),
    ]


def very_loose(lab: Laboratory) -> Judged:
    """See the scene of this name."""
    scene = lab.scene
    file = lab.folder / "s.state.nc"
    recipe = lk.Recipe(scene.void_ratio, scene.step1_friction, grains=lab.grains)
    said = str(lab.refused(lambda: lk.make_specimen(recipe, engine=lab.engine, file=file, progress=False)))
    checks = [
        true("the error says what to change", "come apart" in said and "lower the void ratio" in said),
        true("no file is left", not file.exists()),
    ]
    return said, checks


def gentle_servo(lab: Laboratory) -> Judged:
    """See the scene of this name."""
    run = lab.run(lab.specimen())
    p = run.lab.mean_stress().values
    return f"p {p.min() / 1e3:.2f} to {p.max() / 1e3:.2f} kPa; {ratio_words(run)}", [
        below("p at the start, off by", abs(p[0] / lab.scene.pressure - 1.0), 2e-3),
    ]
