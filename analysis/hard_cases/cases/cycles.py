"""Cycles of growing amplitude, and many cycles of constant amplitude."""

from __future__ import annotations

import numpy as np
import xarray as xr

from analysis.curves import turns
from analysis.hard_cases.checks import agree, below, true
from analysis.hard_cases.laboratory import Judged, Laboratory

# Drift of e per cycle that counts as none: with 120 grains, another order of sums alone changed the drift in a quarter
# of ten cycles by 3e-7. A hundred such cycles change e by less than a third of the last limit below.
RESOLVED = 3e-7


def growing_cycles(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    state = lab.specimen()
    run, reference = lab.run(state), lab.half_step(state)
    at = turning_records(run)
    lost = np.diff((run["friction_loss"] + run["rolling_loss"] + run["damping_loss"]).values[at])
    q, q_reference = (
        (each.lab.deviatoric_stress() / each.lab.mean_stress()).values[turning_records(each)[1:]]
        for each in (run, reference)
    )
    checks = [
        true("seven legs", len(q) == 7 and len(q_reference) == 7),
        true("q has the sign of the leg", (np.sign(q) == (-1.0) ** np.arange(len(q))).all()),
        true("every leg dissipates more energy than the one before", lost[0] > 0.0 and (np.diff(lost) > 0.0).all()),
        below(
            "q/p at the reversals compared with half the time step, RMS", np.sqrt(np.mean((q - q_reference) ** 2)), 0.1
        ),
        *agree(run, reference, e=3e-3),
    ]
    return (
        f"q/p at the reversals {', '.join(f'{x:.2f}' for x in q)}; a leg dissipates {lost[0]:.2g} to {lost[-1]:.2g} J",
        checks,
    )


def turning_records(run: xr.Dataset) -> np.ndarray:
    """Indices of the first record, the records at which the axial strain reverses, and the last record."""
    return np.concatenate([[0], turns(run["axial_strain"].values), [run.sizes["time"] - 1]])


def many_cycles(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    state = lab.specimen()
    run, reference = lab.run(state), lab.half_step(state)
    e, p = cycle_ends(run)
    expected, _ = cycle_ends(reference)
    drift = np.diff(e)
    part = max(1, len(drift) // 4)
    first, last = drift[:part].mean(), drift[-part:].mean()
    checks = [
        below("p of a cycle, largest drift from the first", np.abs(p / p[0] - 1.0).max(), 0.005),
        below("drift of e per cycle, last quarter over first quarter", abs(last) / max(abs(first), RESOLVED), 1.0),
        below(
            "e of all cycles compared with half the time step", np.abs(e - e[0] - expected + expected[0]).max(), 1e-4
        ),
    ]
    return (
        f"{len(drift)} cycles: e {e[-1] - e[0]:+.2e}, per cycle {first:+.1e} in the first quarter and {last:+.1e} in "
        f"the last; p {p[-1] / p[0] - 1.0:+.1e}"
    ), checks


def cycle_ends(run: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Void ratio and p (Pa) at the upper reversals of the cycles."""
    upper = turning_records(run)[1::2]
    return run["void_ratio"].values[upper], run.lab.mean_stress().values[upper]
