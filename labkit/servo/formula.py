"""The formula of the servo in plain Python, which an engine can compile for the CPU or for a GPU.

labkit.servo.plan explains the formula and prepares its data.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

LOW_PASS = 0.25
TERMS = 9  # number of terms in the power series of exp(rate x time step); the exponent is much smaller than 1

Array = Any  # a NumPy array or an array on a GPU; the formula only indexes arrays


class ServoPlan(NamedTuple):
    """The Corrections of labkit.servo.plan as arrays with r rows, with all tensor products evaluated.

    Args:
        steps: Time steps of each row, (r,).
        gradient: Velocity gradient of the prescribed rates alone, (r, 3, 3), in 1/s.
        given: Prescribed rates, (r, 3, 3), in 1/s.
        goal: G s, (r, 6), in 1/s.
        shared: P d where Corrections.is_projected, otherwise 0, (r, 6), in 1/s.
        memory: Index of the part of `kept` that a row uses, (r,).
        exponential: 1 where Corrections.exponential, (r,).
        controlled: 1 if the servo holds stresses.
        isochoric: 1 if the servo keeps the volume.
        limit: Limit of the servo's rates (1/s).
        pull: G M, to be applied to a stress (3, 3), (6, 3, 3), in 1/(Pa s).
        water: G M I K_w/n, (6,), in 1/s: what pore water adds to the rates, per unit of ln(V); 0 without water.
        kept: Operators that select, from the current velocity gradient, all rates, the free rates (P) or none,
            (3, 6, 3, 3).
        spread: Velocity gradient due to each rate, 0 for rates that are not free (K), (3, 3, 6).
    """

    steps: Array
    gradient: Array
    given: Array
    goal: Array
    shared: Array
    memory: Array
    exponential: Array
    controlled: Array
    isochoric: Array
    limit: Array
    pull: Array
    water: Array
    kept: Array
    spread: Array


def det(h: Array) -> float:
    """Return the determinant of a matrix (3, 3)."""
    total = 0.0
    for k in range(3):
        m, n = (k + 1) % 3, (k + 2) % 3
        total += h[0, k] * (h[1, m] * h[2, n] - h[1, n] * h[2, m])
    return total


def correct(
    plan: ServoPlan,
    row: int,
    totals: Array,
    volume: float,
    time_step: float,
    before: Array,
    wanted: Array,
    memory: tuple[Array, Array],
) -> None:
    """Set the velocity gradient of a row of the plan.

    Loops run over the lengths of arrays, because compilers spend seconds on unrolling loops of known length.

    Args:
        plan: The plan.
        row: Index of the row.
        totals: Sums of branch (x) force on the first grain over the contacts, (9,), in N m; read if a stress is held.
        volume: Volume of the cell (m3).
        time_step: Time step (s).
        before: Velocity gradient of the previous step, (3, 3), in 1/s.
        wanted: Velocity gradient to set, (3, 3), in 1/s.
        memory: Working arrays with the shapes (2, 6) and (3, 3, 3).
    """
    three, (rates, matrices) = len(wanted), memory
    if plan.controlled == 1:
        find_rates(plan, row, totals, volume, before, rates)
    for i in range(three):
        for j in range(three):
            servoed = 0.0
            if plan.controlled == 1:
                for k in range(rates.shape[1]):
                    servoed += plan.spread[i, j, k] * rates[0, k]
            wanted[i, j] = plan.gradient[row, i, j] + servoed
            matrices[0, i, j] = servoed - plan.given[row, i, j]
    if plan.exponential[row] == 1:
        exponential(time_step, wanted, matrices)


def find_rates(plan: ServoPlan, row: int, totals: Array, volume: float, before: Array, rates: Array) -> None:
    """Set rates[0] to the limited, low-pass filtered rates (1/s) that bring the stresses to their targets."""
    three, six = len(before), rates.shape[1]
    largest, memory, per_volume, logarithm = plan.limit, plan.memory[row], 1.0 / volume, math.log(volume)
    for k in range(six):
        rates[0, k], rates[1, k] = plan.goal[row, k] + plan.water[k] * logarithm, plan.shared[row, k]
        for i in range(three):
            for j in range(three):
                rates[0, k] += per_volume * plan.pull[k, i, j] * totals[3 * i + j]
                rates[1, k] += plan.kept[memory, k, i, j] * before[i, j]
        largest = max(largest, abs(rates[0, k]))
    for k in range(six):
        if plan.isochoric == 1:  # limit all components by the same factor, which preserves the volume
            limited = rates[0, k] * plan.limit / largest
        else:
            limited = min(max(rates[0, k], -plan.limit), plan.limit)
        rates[0, k] = (1.0 - LOW_PASS) * rates[1, k] - LOW_PASS * limited


def exponential(time_step: float, wanted: Array, matrices: Array) -> None:
    """Set `wanted` to L with 1 + L dt = exp(matrices[0] dt), by the power series of the exponential."""
    three = len(wanted)
    for i in range(three):
        for j in range(three):
            matrices[1, i, j] = wanted[i, j] = matrices[0, i, j]
    for k in range(2, TERMS):
        for i in range(three):
            for j in range(three):
                matrices[2, i, j] = 0.0
                for m in range(three):
                    matrices[2, i, j] += matrices[1, i, m] * matrices[0, m, j] * time_step / k
        for i in range(three):
            for j in range(three):
                matrices[1, i, j] = matrices[2, i, j]
                wanted[i, j] += matrices[2, i, j]
