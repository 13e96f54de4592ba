"""The servo's formula, in plain Python, which the engines compile for the CPU and for a GPU.

labkit.servo.plan explains it and prepares its data.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from labkit.micro.tensors import ROOT2

LOW_PASS = 0.25
TERMS = 9  # of the power series of exp(rate x time step); the exponent is far below 1

Array = Any  # a NumPy array, or one on the device; the formula only indexes it


class ServoPlan(NamedTuple):
    """The Corrections of labkit.servo.plan as arrays of fixed widths, with r rows; unused columns are 0.

    Args:
        steps: Time steps of each row, (r,).
        gradient: Velocity gradient of the prescribed rates alone, (r, 3, 3), 1/s.
        given: Prescribed rates, (r, 3, 3), 1/s.
        target: Targets of the held stresses, (r, 6), Pa.
        both: 1 where Corrections.shared, (r,).
        exponential: 1 where Corrections.exponential, (r,).
        shared: Prescribed rates to add to those so far, (r, 6), 1/s.
        controlled: 1 if the servo holds stresses.
        isochoric: 1 if the servo keeps the volume.
        anew: 1 if the servo starts from rates of zero.
        measure: M, (6, 6).
        gain: G, (6, 6), 1/(Pa s).
        project: P, (6, 6).
        held: K, (6,).
        limit: Limit of the servo's rates, 1/s.
    """

    steps: Array
    gradient: Array
    given: Array
    target: Array
    both: Array
    exponential: Array
    shared: Array
    controlled: Any
    isochoric: Any
    anew: Any
    measure: Array
    gain: Array
    project: Array
    held: Array
    limit: Any


def det(h: Array) -> float:
    """Determinant of a matrix (3, 3)."""
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
    sixes: Array,
    matrices: Array,
) -> None:
    """Set the velocity gradient of a row.

    Loops end at lengths of arrays, because compilers unroll those of known length at a cost of seconds.

    Args:
        plan: The plan.
        row: Number of the row.
        totals: Sums of branch (x) force on the first grain over the contacts, (9,), N m; read if a stress is held.
        volume: Volume of the cell, m3.
        time_step: Time step, s.
        before: Velocity gradient of the last step, (3, 3), 1/s.
        wanted: Velocity gradient to set, (3, 3), 1/s.
        sixes: Memory for (3, 6) numbers.
        matrices: Memory for (3, 3, 3) numbers.
    """
    three = len(wanted)
    for i in range(three):
        for j in range(three):
            wanted[i, j] = plan.gradient[row, i, j]
    if plan.controlled == 1:
        find_rates(plan, row, totals, -1.0 / volume, before, sixes)
        for k in range(three):
            i, j = (k + 1) % 3, (k + 2) % 3
            matrices[0, k, k] = sixes[0, k]
            matrices[0, i, j] = matrices[0, j, i] = sixes[0, 3 + k] / ROOT2
        if plan.exponential[row] == 1:
            exponential(plan, row, time_step, wanted, matrices)
        else:
            for i in range(three):
                for j in range(three):
                    wanted[i, j] += matrices[0, i, j]


def find_rates(plan: ServoPlan, row: int, totals: Array, per_volume: float, before: Array, sixes: Array) -> None:
    """Set sixes[0] to limited rates that bring the stresses to their targets, after the low-pass filter, 1/s."""
    three, six = len(before), len(plan.held)
    so_far = 0.0 if plan.anew == 1 and row == 0 else 1.0
    for k in range(three):
        i, j = (k + 1) % 3, (k + 2) % 3
        sixes[1, k] = per_volume * totals[4 * k]
        sixes[1, 3 + k] = per_volume * ROOT2 * 0.5 * (totals[3 * i + j] + totals[3 * j + i])
    for k in range(six):
        sixes[0, k], sixes[2, k] = 0.0, plan.target[row, k]
        for j in range(six):
            sixes[2, k] -= plan.measure[k, j] * sixes[1, j]
    largest = plan.limit
    for k in range(six):
        for j in range(six):
            sixes[0, k] += plan.gain[k, j] * sixes[2, j]
        largest = max(largest, abs(sixes[0, k]))
    for k in range(three):
        i, j = (k + 1) % 3, (k + 2) % 3
        sixes[1, k] = so_far * before[k, k]
        sixes[1, 3 + k] = so_far * ROOT2 * 0.5 * (before[i, j] + before[j, i])
    for k in range(six):
        if plan.isochoric == 1:  # limit all components by the same factor, which keeps the volume
            limited = -sixes[0, k] * plan.limit / largest
        else:
            limited = -min(max(sixes[0, k], -plan.limit), plan.limit)
        kept = sixes[1, k]
        if plan.both[row] == 1:  # a part outside the free rates would change the volume
            kept = 0.0
            for j in range(six):
                kept += plan.project[k, j] * (sixes[1, j] + plan.shared[row, j])
        sixes[0, k] = plan.held[k] * (LOW_PASS * limited + (1.0 - LOW_PASS) * kept)


def exponential(plan: ServoPlan, row: int, time_step: float, wanted: Array, matrices: Array) -> None:
    """Set the velocity gradient L, 1 + L dt = exp(-(given - matrices[0]) dt), by its power series."""
    three = len(wanted)
    for i in range(three):
        for j in range(three):
            matrices[0, i, j] -= plan.given[row, i, j]
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
