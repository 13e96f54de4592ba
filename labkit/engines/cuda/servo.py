"""The servo on the device: the velocity gradients of the coming steps, from stresses that never leave it.

The formulas are those of labkit.servo.correction; labkit.servo.plan prepares the data of the path that they need.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from labkit.engines.cuda.arrays import DeviceArray, States, zeros
from labkit.engines.cuda.device import cuda
from labkit.engines.cuda.motion import det
from labkit.micro.tensors import ROOT2, symmetric, to_six
from labkit.servo.correction import LOW_PASS
from labkit.servo.plan import Correcting, Corrections

TERMS = 9  # of the power series of exp(rate x time step); the exponent is far below 1


class Plans(NamedTuple):
    """The Corrections of each state, n in all, with r rows each; see labkit.servo.plan.

    Args:
        row: Next row, (n,).
        steps: Steps of each row, (n, r).
        gradient: Velocity gradient of the prescribed rates alone, (n, r, 3, 3), 1/s.
        given: Prescribed rates, (n, r, 3, 3), 1/s.
        target: Targets of the held stresses, (n, r, 6), Pa.
        both: 1 where Corrections.shared, (n, r).
        exponential: 1 where Corrections.exponential, (n, r).
        shared: Prescribed rates to add to those so far, (n, r, 6), 1/s.
        controlled: 1 if the servo holds stresses, (n,).
        isochoric: 1 if the servo keeps the volume, (n,).
        anew: 1 if the servo starts from rates of zero, (n,).
        measure: M, (n, 6, 6).
        gain: G, (n, 6, 6), 1/(Pa s).
        project: P, (n, 6, 6).
        held: K, (n, 6).
        limit: Limit of the servo's rates, (n,), 1/s.
    """

    row: DeviceArray
    steps: DeviceArray
    gradient: DeviceArray
    given: DeviceArray
    target: DeviceArray
    both: DeviceArray
    exponential: DeviceArray
    shared: DeviceArray
    controlled: DeviceArray
    isochoric: DeviceArray
    anew: DeviceArray
    measure: DeviceArray
    gain: DeviceArray
    project: DeviceArray
    held: DeviceArray
    limit: DeviceArray


def new_plans(n: int, rows: int) -> Plans:
    """Allocate plans of n states, with room for this number of rows."""
    flags = {name: zeros(n, np.int32) for name in ("row", "controlled", "isochoric", "anew")}
    flags |= {name: zeros((n, rows), np.int32) for name in ("steps", "both", "exponential")}
    return Plans(
        **flags,
        gradient=zeros((n, rows, 3, 3)),
        given=zeros((n, rows, 3, 3)),
        target=zeros((n, rows, 6)),
        shared=zeros((n, rows, 6)),
        measure=zeros((n, 6, 6)),
        gain=zeros((n, 6, 6)),
        project=zeros((n, 6, 6)),
        held=zeros((n, 6)),
        limit=zeros(n),
    )


def put_plan(plans: Plans, i: int, plan: Corrections) -> None:
    """Copy the Corrections of the i-th state to the device."""
    rows, servo = len(plan.steps), plan.servo
    isochoric = servo is not None and servo.isochoric
    flags = {"row": False, "controlled": servo is not None, "anew": plan.anew, "isochoric": isochoric}
    for name, flag in flags.items():
        _put(getattr(plans, name)[i : i + 1], np.array([flag]))
    for name in ("steps", "gradient", "given", "exponential"):
        _put(getattr(plans, name)[i, :rows], getattr(plan, name))
    if servo is None:
        return
    both = plan.shared
    _put(plans.both[i, :rows], both)
    _put(plans.shared[i, :rows], to_six(symmetric(plan.given)) * both[:, None])
    _put(plans.target[i, :rows], np.pad(plan.target, ((0, 0), (0, 6 - plan.target.shape[1]))))
    for name, value in _pad(servo).items():
        _put(getattr(plans, name)[i : i + 1], value[None])


def _pad(servo: Correcting) -> dict[str, np.ndarray]:
    """Return the arrays of a Correcting, filled up to six held stresses."""
    missing = 6 - len(servo.measure)
    return {
        "measure": np.pad(servo.measure, ((0, missing), (0, 0))),
        "gain": np.pad(servo.gain, ((0, 0), (0, missing))),
        "project": servo.project,
        "held": servo.held,
        "limit": np.array(servo.limit),
    }


def _put(target: DeviceArray, values: np.ndarray | Sequence[float]) -> None:
    target.copy_to_device(np.ascontiguousarray(values, target.dtype))


def asks(states: States, plans: Plans, s: int) -> bool:
    """True if a state needs its stress because its next row is due and its servo holds stresses."""
    return is_due(states, s) and plans.controlled[s] == 1


def is_due(states: States, s: int) -> bool:
    """True if the next row of a state is due."""
    return states.left[s] > 0 and states.due[s] == 0 and states.until[s] == 0


def correct(states: States, plans: Plans, totals: DeviceArray) -> None:
    """Set the velocity gradients of the states whose next row is due. One thread per state.

    `totals` (n, 9) are the sums of branch (x) force, N m.
    """
    s = cuda.grid(1)
    if s >= len(states.left) or not is_due(states, s):
        return
    row = plans.row[s]
    plans.row[s] = row + 1
    states.until[s] = plans.steps[s, row]
    for i in range(3):
        for j in range(3):
            states.wanted[s, i, j] = plans.gradient[s, row, i, j]
    if plans.controlled[s] == 1:
        rates, servoed = cuda.local.array(6, np.float64), cuda.local.array((3, 3), np.float64)
        find_rates(states, plans, totals, s, row, rates)
        filter_rates(states, plans, s, row, rates)
        tensor_of(rates, servoed)
        if plans.exponential[s, row] == 1:
            exponential(plans, s, row, servoed, states.time_step[s], states.wanted)
        else:
            for i in range(3):
                for j in range(3):
                    states.wanted[s, i, j] += servoed[i, j]


def find_rates(states: States, plans: Plans, totals: DeviceArray, s: int, row: int, rates: DeviceArray) -> None:
    """Set rates (6,) to limited rates that bring the stresses to their targets, before the low-pass filter, 1/s."""
    stress, missing = cuda.local.array(6, np.float64), cuda.local.array(6, np.float64)
    per_volume = -1.0 / det(states.cell[s])
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        stress[k] = per_volume * totals[s, 4 * k]
        stress[3 + k] = per_volume * ROOT2 * 0.5 * (totals[s, 3 * i + j] + totals[s, 3 * j + i])
    for k in range(6):
        missing[k] = plans.target[s, row, k]
        for j in range(6):
            missing[k] -= plans.measure[s, k, j] * stress[j]
    largest = plans.limit[s]
    for j in range(6):
        rates[j] = 0.0
        for k in range(6):
            rates[j] += plans.gain[s, j, k] * missing[k]
        largest = max(largest, abs(rates[j]))
    for j in range(6):
        if plans.isochoric[s] == 1:
            rates[j] *= -plans.limit[s] / largest
        else:
            rates[j] = -min(max(rates[j], -plans.limit[s]), plans.limit[s])


def filter_rates(states: States, plans: Plans, s: int, row: int, rates: DeviceArray) -> None:
    """Replace rates (6,) by the servo's rates after the low-pass filter, 1/s."""
    before, kept = cuda.local.array(6, np.float64), cuda.local.array(6, np.float64)
    so_far = 0.0 if plans.anew[s] == 1 and row == 0 else 1.0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        before[k] = so_far * states.used[s, k, k]
        before[3 + k] = so_far * ROOT2 * 0.5 * (states.used[s, i, j] + states.used[s, j, i])
    for k in range(6):
        kept[k] = before[k]
        if plans.both[s, row] == 1:
            kept[k] = 0.0
            for j in range(6):
                kept[k] += plans.project[s, k, j] * (before[j] + plans.shared[s, row, j])
    for k in range(6):
        rates[k] = plans.held[s, k] * (LOW_PASS * rates[k] + (1.0 - LOW_PASS) * kept[k])


def tensor_of(six: DeviceArray, tensor: DeviceArray) -> None:
    """Set tensor (3, 3) from six (6,) components in Mandel notation."""
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        tensor[k, k] = six[k]
        tensor[i, j] = tensor[j, i] = six[3 + k] / ROOT2


def exponential(plans: Plans, s: int, row: int, servoed: DeviceArray, dt: float, wanted: DeviceArray) -> None:
    """Set the velocity gradient L of a state, 1 + L dt = exp(-(given - servoed) dt), by its power series."""
    term, after = cuda.local.array((3, 3), np.float64), cuda.local.array((3, 3), np.float64)
    for i in range(3):
        for j in range(3):
            term[i, j] = wanted[s, i, j] = servoed[i, j] - plans.given[s, row, i, j]
    for k in range(2, TERMS):
        for i in range(3):
            for j in range(3):
                after[i, j] = 0.0
                for m in range(3):
                    after[i, j] += term[i, m] * (servoed[m, j] - plans.given[s, row, m, j]) * dt / k
        for i in range(3):
            for j in range(3):
                term[i, j] = after[i, j]
                wanted[s, i, j] += after[i, j]
