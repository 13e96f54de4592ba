"""What every run is measured and checked for."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import labkit as lk
from analysis.hard_cases.checks import Check, below, true
from labkit.dem import BALANCE_LIMIT, DRIFT_LIMIT, State, fluctuation_velocity, read_checkpoint
from labkit.engines import FusedEngine
from labkit.micro import relative_error
from labkit.runs import SFF_PRESSURE, drift_share, findings

STRESS_TOLERANCE = 1e-9  # of the stress: stored, from stored contacts, and from the contacts that the kernel finds
C0_TOLERANCE = 0.06  # of Love with 500 grains; it falls with the root of their number
MOMENTUM_TOLERANCE = 1e-10  # of sum m |c|
FREE_STEPS = 50  # for which a state is followed without contacts, or without damping
MEASURED = ("energy_balance_error", "stress_error", "held_error", "c0_error", "momentum", "undamped_momentum")


def measure(file: str | Path) -> dict[str, Any]:
    """MEASURED of a run file, and the worst share of drift in the kinetic energy and the number of grains."""
    run, state = lk.open_run(file), read_checkpoint(file)
    held = [finding for finding in findings(run) if finding.name.startswith("held:")]
    stress = run["stress"].values
    contacts = relative_error(run.lab.love_stress().values, run.lab.at_snapshots("stress").values)
    kernel = FusedEngine(state).stress()
    size = np.linalg.norm(stress[-1])
    at_end = np.linalg.norm(kernel - stress[-1]) / size if size else np.linalg.norm(kernel)
    judged = run.lab.mean_stress().values > SFF_PRESSURE
    c = fluctuation_velocity(state)
    mass = state.scene.mass(state.radius)
    moving = float(mass @ np.linalg.norm(c, axis=1))
    return {
        "energy_balance_error": float(np.abs(run["energy_balance_error"].values).max()),
        "stress_error": float(max(np.nanmax(contacts, initial=0.0), at_end)),  # 0/0 is NaN: nothing against nothing
        "held_error": max((finding.value for finding in held), default=None),
        "c0_error": float(run.lab.sff_error().values[judged].max()) if judged.any() else None,
        "momentum": float(np.linalg.norm(mass @ c)) / moving if moving else 0.0,
        "undamped_momentum": undamped_momentum(state) if state.engine == "fused" and moving else None,
        "drift_share": float(drift_share(run).max()),
        "held": held,
        "grains": state.number_of_grains,
        "records": len(stress),
        "finite": bool(np.isfinite(stress).all() and np.isfinite(run["energy_balance_error"].values).all()),
    }


def undamped_momentum(state: State) -> float:
    """Change of sum m c over sum m |c| while a state goes on in a held cell without local damping: rounding, as long
    as contact forces come in pairs. Local damping acts on each grain by itself and is no pair of forces.
    """
    mass, still = state.scene.mass(state.radius)[:, None], np.zeros((3, 3))
    engine = FusedEngine(state.replace(scene=dataclasses.replace(state.scene, local_damping=0.0)))
    engine.advance(1, still)  # takes the mean field off
    before = mass * engine.state().velocity
    engine.advance(FREE_STEPS, still)
    after = mass * engine.state().velocity
    return float(np.linalg.norm(after.sum(axis=0) - before.sum(axis=0)) / np.linalg.norm(after, axis=1).sum())


def common_checks(found: Mapping[str, Any], judges_c0: bool) -> Iterator[Check]:
    """What every run must fulfil that was not refused. `found`: of measure()."""
    grains = found["grains"]
    yield true("stresses and energies are numbers", found["finite"])
    yield below("energy balance", found["energy_balance_error"], BALANCE_LIMIT)
    yield below("stored stress against its contacts", found["stress_error"], STRESS_TOLERANCE)
    # Local damping kicks the centre of mass at random, which then has about one grain's share of the kinetic energy.
    yield below("drift of the centre of mass, share of kinetic energy", found["drift_share"], DRIFT_LIMIT + 10 / grains)
    if found["undamped_momentum"] is not None:
        yield below("momentum that pairs of grains make of nothing", found["undamped_momentum"], MOMENTUM_TOLERANCE)
    if judges_c0 and found["c0_error"] is not None:
        yield below("C0 against Love", found["c0_error"], C0_TOLERANCE * max(1.0, (500 / grains) ** 0.5))
    for finding in found["held"]:
        yield Check(finding.name, finding.value, finding.limit, finding.holds)
