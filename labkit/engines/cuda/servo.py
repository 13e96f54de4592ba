"""The servo on the device: the velocity gradients of the coming steps, from stresses that never leave it.

It uses the formula of labkit.servo.formula, with the data that labkit.servo.plan prepares.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from labkit.engines.cuda.arrays import DeviceArray, States, zeros
from labkit.engines.cuda.device import cuda
from labkit.servo.formula import ServoPlan, det
from labkit.servo.formula import correct as correct_gradient
from labkit.servo.plan import Corrections


class Plans(NamedTuple):
    """The ServoPlan of each state, n in all, with r rows each: a leading dimension (n,) for each of its fields.

    `row` (n,) is the next row.
    """

    row: DeviceArray
    steps: DeviceArray
    gradient: DeviceArray
    given: DeviceArray
    goal: DeviceArray
    shared: DeviceArray
    memory: DeviceArray
    exponential: DeviceArray
    controlled: DeviceArray
    isochoric: DeviceArray
    limit: DeviceArray
    pull: DeviceArray
    kept: DeviceArray
    spread: DeviceArray


def new_plans(n: int, rows: int) -> Plans:
    """Allocate plans of n states, with room for this number of rows."""
    flags = {name: zeros(n, np.int32) for name in ("row", "controlled", "isochoric")}
    flags |= {name: zeros((n, rows), np.int32) for name in ("steps", "memory", "exponential")}
    return Plans(
        **flags,
        gradient=zeros((n, rows, 3, 3)),
        given=zeros((n, rows, 3, 3)),
        goal=zeros((n, rows, 6)),
        shared=zeros((n, rows, 6)),
        limit=zeros(n),
        pull=zeros((n, 6, 3, 3)),
        kept=zeros((n, 3, 6, 3, 3)),
        spread=zeros((n, 3, 3, 6)),
    )


def put_plan(plans: Plans, i: int, corrections: Corrections) -> None:
    """Copy the Corrections of the i-th state to the device."""
    rows = len(corrections.steps)
    for name, value in {"row": 0, **corrections.plan._asdict()}.items():
        target = getattr(plans, name)
        values = np.asarray(value, target.dtype)
        by_row = name in ("steps", "gradient", "given", "goal", "shared", "memory", "exponential")
        part = target[i, :rows] if by_row else target[i : i + 1]
        part.copy_to_device(np.ascontiguousarray(values if by_row else values[None]))


def plan_of(plans: Plans, s: int) -> ServoPlan:
    """The ServoPlan of state s."""
    return ServoPlan(
        plans.steps[s],
        plans.gradient[s],
        plans.given[s],
        plans.goal[s],
        plans.shared[s],
        plans.memory[s],
        plans.exponential[s],
        plans.controlled[s],
        plans.isochoric[s],
        plans.limit[s],
        plans.pull[s],
        plans.kept[s],
        plans.spread[s],
    )


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
    rates, matrices = cuda.local.array((2, 6), np.float64), cuda.local.array((3, 3, 3), np.float64)
    row = plans.row[s]
    plans.row[s] = row + 1
    states.until[s] = plans.steps[s, row]
    volume, dt = det(states.cell[s]), states.time_step[s]
    plan = plan_of(plans, s)
    correct_gradient(plan, row, totals[s], volume, dt, states.used[s], states.wanted[s], rates, matrices)
