"""Measurements and checks that apply to every run."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import labkit as lk
from analysis.hard_cases.checks import Check, below, true
from labkit.engines import FusedEngine
from labkit.grains import State
from labkit.micro import relative_error
from labkit.records import BALANCE_LIMIT, DRIFT_LIMIT, fluctuation_velocity
from labkit.results import SFF_PRESSURE, drift_share, findings

# relative difference between the stored stress and those from the stored contacts and the kernel's contacts; in mixed
# precision, the rounding of one force
STRESS_TOLERANCE = {"double": 1e-9, "mixed": 1e-7}
C0_TOLERANCE = (
    0.06  # relative to Love's stress, for 500 grains; inversely proportional to the square root of their number
)
MOMENTUM_TOLERANCE = {"double": 1e-10, "mixed": 5e-2}  # relative to sum m |c|; 4.5e5 roundings
FREE_STEPS = 50  # steps for which a state is advanced without contacts, or without damping
MEASURED = ("energy_balance_error", "stress_error", "held_error", "c0_error", "momentum", "undamped_momentum")


def measure(file: str | Path) -> dict[str, Any]:
    """The quantities in MEASURED for a run file, and two more numbers.

    The two are the largest fraction of kinetic energy due to drift, and the number of grains.
    """
    run, state = lk.open_run(file), lk.read_state(file)
    held = [finding for finding in findings(run) if finding.name.startswith("held:")]
    stress = run["stress"].values
    contacts = relative_error(run.lab.love_stress().values, run.lab.at_snapshots("stress").values)
    kernel = FusedEngine(state, precision=state.precision).stress()
    size = np.linalg.norm(stress[-1])
    at_end = np.linalg.norm(kernel - stress[-1]) / size if size else np.linalg.norm(kernel)
    judged = run.lab.mean_stress().values > SFF_PRESSURE
    c = fluctuation_velocity(state)
    mass = state.scene.mass(state.radius)
    moving = float(mass @ np.linalg.norm(c, axis=1))
    return {
        "energy_balance_error": float(np.abs(run["energy_balance_error"].values).max()),
        "stress_error": float(max(np.nanmax(contacts, initial=0.0), at_end)),  # NaN is 0/0: both stresses are zero
        "held_error": max((finding.value for finding in held), default=None),
        "c0_error": float(run.lab.sff_error().values[judged].max()) if judged.any() else None,
        "momentum": float(np.linalg.norm(mass @ c)) / moving if moving else 0.0,
        "undamped_momentum": undamped_momentum(state) if state.engine == "fused" and moving else None,
        "drift_share": float(drift_share(run).max()),
        "held": held,
        "grains": state.number_of_grains,
        "precision": state.precision,
        "records": len(stress),
        "finite": bool(np.isfinite(stress).all() and np.isfinite(run["energy_balance_error"].values).all()),
    }


def undamped_momentum(state: State) -> float:
    """Change of sum m c, relative to sum m |c|, while a state is advanced in a fixed cell without local damping.

    It is rounding error if contact forces are equal and opposite. Local damping acts on each grain separately and is
    not an action-reaction pair.
    """
    mass, still = state.scene.mass(state.radius)[:, None], np.zeros((3, 3))
    undamped = state.replace(scene=dataclasses.replace(state.scene, local_damping=0.0))
    engine = FusedEngine(undamped, precision=state.precision)
    engine.advance(1, still)  # removes the mean field
    before = mass * engine.state().velocity
    engine.advance(FREE_STEPS, still)
    after = mass * engine.state().velocity
    return float(np.linalg.norm(after.sum(axis=0) - before.sum(axis=0)) / np.linalg.norm(after, axis=1).sum())


def common_checks(values: Mapping[str, Any], judges_c0: bool) -> Iterator[Check]:
    """Checks that every run that was not refused must pass. `values`: result of measure()."""
    grains, precision = values["grains"], values["precision"]
    yield true("stresses and energies are finite", values["finite"])
    yield below("energy balance", values["energy_balance_error"], BALANCE_LIMIT)
    yield below("stored stress, difference from its contacts", values["stress_error"], STRESS_TOLERANCE[precision])
    # Local damping accelerates the centre of mass at random, to about one grain's share of the kinetic energy.
    yield below(
        "drift of the centre of mass, fraction of the kinetic energy", values["drift_share"], DRIFT_LIMIT + 10 / grains
    )
    if values["undamped_momentum"] is not None:
        yield below("momentum created by contact forces", values["undamped_momentum"], MOMENTUM_TOLERANCE[precision])
    if judges_c0 and values["c0_error"] is not None:
        yield below(
            "difference of C0 and Love's stress", values["c0_error"], C0_TOLERANCE * max(1.0, (500 / grains) ** 0.5)
        )
    for finding in values["held"]:
        yield Check(finding.name, finding.value, finding.limit, finding.holds)
