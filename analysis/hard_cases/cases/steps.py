"""Time steps near the stability limit, and an excessive strain rate."""

from __future__ import annotations

import dataclasses

import numpy as np

import labkit as lk
from analysis.hard_cases.checks import agree, between, later_half, pressure_text, ratio_text, true
from analysis.hard_cases.laboratory import Judged, Laboratory, with_step, without_ledger
from labkit.engines import FusedEngine
from labkit.grains import State, critical_time_step
from labkit.paths import IsotropicCompression, IsotropicDilation

QUASI_STATIC = 20.0  # 1/s, the rate that `fast` is compared with


def step_under(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    specimen = lab.specimen()
    state = with_step(specimen, 0.97 * _limit_over_step(specimen))
    run, reference = lab.run(state), lab.half_step(state)
    return f"{pressure_text(run)}; {ratio_text(run)}", [*agree(run, reference, p=0.08, ratio=0.06, Z=0.1)]


def _limit_over_step(state: State) -> float:
    return critical_time_step(state) / state.scene.time_step


def step_over(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    specimen = lab.specimen()
    limit = _limit_over_step(specimen)
    over, apart = with_step(specimen, 1.03 * limit), _spread_out(with_step(specimen, 3.0 * limit), 1.08)
    refusal = lab.refused_run(over, "over")
    isoc = IsotropicCompression(rate=20.0, strain=0.2, pressure=1e6)
    stopped = lab.refused_run(apart, "unseen", isoc)
    return f"{refusal} | {stopped}", [
        true("refused because of the time step", "time_step_factor" in refusal),
        true("no file is written", not lab.file("over").exists()),
        true("no contacts at the start", len(FusedEngine(apart).state().contact_grain) == 0),
        true("stopped by the energy balance", "energy balance" in stopped),
    ]


def _spread_out(state: State, factor: float) -> State:
    """The grains of a state with all distances multiplied by `factor`, and no contacts."""
    nothing = np.zeros((0, 3))
    return state.replace(
        position=state.position * factor,
        cell=state.cell * factor,
        contact_grain=np.zeros((0, 2), np.int32),
        contact_shift=nothing.astype(np.int32),
        tangential_force=nothing,
        rolling_moment=nothing,
    )


def step_outgrown(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    lk.run(lab.specimen(), IsotropicDilation(pressure=5e3), file=lab.file("loose"), progress=False)
    start = without_ledger(lk.read_state(lab.file("loose")).at_rest())
    state = with_step(start, 0.99 * _limit_over_step(start))
    run, reference = lab.run(state), lab.half_step(state)
    end = lk.read_state(lab.runs[-1])
    over = end.time_step / critical_time_step(end)
    return f"time step 0.99 times the limit at the start, {over:.2f} times at the end; {pressure_text(run)}", [
        true("the time step exceeds the limit at the end", over > 1.0),
        *agree(run, reference, p=0.05, Z=0.1, e=2e-3),
    ]


def fast(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    state = lab.specimen()
    run = lab.run(state)
    file = lab.shared / f"quasi_static_n{lab.grains}.run.nc"
    path = dataclasses.replace(lab.scene, rate=QUASI_STATIC).loading(lab.extent)
    slow = later_half(lk.run(state, path, file=file, progress=False).data)["q/p"]
    ratio = later_half(run)["q/p"]
    inertial = float(run["inertial_number"].values.max())
    return f"I up to {inertial:.2g}; q/p {ratio:.3f}, quasi-static {slow:.3f}", [
        true("the run reports: inertial number", "inertial number" in lab.names_exceeded()),
        between("q/p compared with the quasi-static value", ratio, slow - 0.05, slow + 0.2),
    ]
