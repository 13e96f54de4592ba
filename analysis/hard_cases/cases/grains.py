"""Deep overlaps, a wide grading, and few grains."""

from __future__ import annotations

import dataclasses

import labkit as lk
from analysis.hard_cases.checks import agree, between, later_half, pressure_text, ratio_text, true
from analysis.hard_cases.laboratory import Judged, Laboratory, without_ledger
from labkit.engines import FusedEngine
from labkit.grains import critical_time_step, read_state
from labkit.results import findings
from labkit.specimens import insert_grains


def deep_overlaps(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    recipe = lk.Recipe(lab.scene.void_ratio, lab.scene.step1_friction, grains=lab.grains, cell="fixed")
    grains = insert_grains(lk.Scene(), recipe)
    listed = FusedEngine(grains).state()
    messages = [
        lab.refused_run(state, name) for name, state in (("unlisted", grains), ("listed", without_ledger(listed)))
    ]
    return messages[0], [
        true("the state lists no contacts", len(grains.contact_grain) == 0 < len(listed.contact_grain)),
        *(true("refused for its overlaps", "overlap" in text and "labkit specimen" in text) for text in messages),
    ]


def size_ratio_5(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    usual = lk.Scene(diameter_spread=2 / 3)
    file = lab.shared / f"ratio5_n{lab.grains}.state.nc"
    of_mean = usual.time_step_factor * usual.time_unit / usual.time_step  # gives the time step of the mean grain
    large_step = dataclasses.replace(usual, time_step_factor=of_mean * usual.time_step_factor)
    if not file.exists():
        recipe = lk.Recipe(lab.scene.void_ratio, lab.scene.step1_friction, grains=lab.grains, cell="fixed")
        lk.make_specimen(recipe, usual, file=file, progress=False)
    state = read_state(file)
    message = lab.refused_run(state.replace(scene=large_step), "large")
    run, reference = lab.run(state), lab.half_step(state)
    printed = [finding for finding in findings(run) if finding.name.startswith("C0 as printed")]
    lab.messages += [f"labkit verify: {finding}" for finding in printed]
    sizes = state.radius.max() / state.radius.min()
    refused, limit = "time step" in message and "time_step_factor" in message, critical_time_step(state)
    text = f"time step of the mean grain {large_step.time_step / limit:.2f} times the limit" + ", refused" * refused
    return f"sizes 1 to {sizes:.2f}; {text}; {pressure_text(run)}; {ratio_text(run)}", [
        between("ratio of sizes", sizes, 4.0, 5.1),
        true("the usual time step is stable", usual.time_step < limit),
        true("a time step above the limit is refused", refused == (large_step.time_step > limit)),
        true("labkit verify prints the error of C0 as printed", bool(printed)),
        *agree(run, reference, p=0.2, ratio=0.1, Z=0.2),
    ]


def few_grains(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    run = lab.run(lab.specimen(500))
    if lab.extent < 1.0:
        peak = (run.lab.deviatoric_stress() / run.lab.mean_stress()).values[-1]
        return f"{pressure_text(run)}; q/p {peak:.3f} at the end", [between("q/p at the end", peak, 0.5, 1.3)]
    ratio = later_half(run)["q/p"]
    return f"{pressure_text(run)}; {ratio_text(run)}", [between("q/p at the critical state", ratio, 0.84, 1.0)]
