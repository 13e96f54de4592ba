"""The finite-element interface: updates states by strain increments, with stresses and consistent tangents.

Many points are updated at once, each independently. A symmetric tensor is six numbers in Mandel notation (xx, yy, zz,
sqrt2 yz, sqrt2 xz, sqrt2 xy; labkit.model.tensors.to_six and to_tensor), compression positive. A finite-element code
with tension positive must change the sign of strain and stress; the tangent is the same.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.engines.kernel.tables import Pointers
from labkit.errors import InputError, PhysicsError
from labkit.model.compiled import Table, constants_at, entry, numbers_at
from labkit.model.differentials import STATE, rates_differentials, stress_rate_of
from labkit.model.equations import strain_driven, stress_of
from labkit.model.integrators import FLOOR, SMALLEST
from labkit.model.parameters import Model
from labkit.model.rates import FINE, REASONS, TOO_MANY_STEPS, outside
from labkit.model.state import ModelState
from labkit.model.tensors import put, put_six, six_at, trace

MOST_SUBSTEPS = 100_000
WORK = 37  # rows of the work array, each of STATE numbers


@dataclasses.dataclass(frozen=True, eq=False)
class Update:
    """Points after an increment.

    If the increment of a point failed, its state is unchanged, its stress and tangent are NaN, and the calling code
    should halve the increment.

    Args:
        state: e, Z, Lambda, A, F, F^t, (n, 21).
        stress: (n, 6), Pa.
        tangent: (n, 6, 6), Pa, or None.
        status: 0, or the reason why the increment failed (labkit.model.rates.REASONS), (n,).
        substeps: Number of substeps, (n,).
    """

    state: np.ndarray
    stress: np.ndarray
    tangent: np.ndarray | None
    status: np.ndarray
    substeps: np.ndarray

    def require(self) -> Update:
        """Return this update. Raises PhysicsError if the update failed at any point."""
        failed = np.flatnonzero(self.status)
        if failed.size:
            point = failed[0]
            raise PhysicsError(
                f"{failed.size} of {len(self.status)} points failed, point {point}: {REASONS[int(self.status[point])]}"
            )
        return self


def states(state: ModelState, number: int) -> np.ndarray:
    """Return an array (number, 21) with the same ModelState at `number` points."""
    return np.tile(state.vector()[:STATE], (number, 1))


def points(state: np.ndarray, increment: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a copy of the states (n, 21), and the strain increments (n, 6). Raises InputError for other shapes."""
    new, increment = np.array(state, dtype=float, order="C"), np.ascontiguousarray(increment, dtype=float)
    if new.ndim != 2 or new.shape[1] != STATE or increment.shape != (len(new), 6):
        raise InputError(f"state {new.shape} and increment {increment.shape} must be (n, {STATE}) and (n, 6)")
    return new, increment


def update(
    model: Model, state: np.ndarray, increment: np.ndarray, tangent: bool = True, tolerance: float = 1e-4
) -> Update:
    """Apply one increment of strain at every point; returns an Update.

    Each point is advanced in substeps by Heun's method; their number is chosen to keep the error of each substep below
    `tolerance` (Sloan's modified Euler with error control). The tangent is the exact derivative of these substeps, and
    therefore consistent with the computed stress increment. For isotropic increments see labkit.model.differentials.
    Raises InputError for shapes that do not match and for strains that are not finite.

    Args:
        model: The model.
        state: e, Z, Lambda, A, F, F^t, (n, 21).
        increment: Strain increment, (n, 6).
        tangent: True to compute the tangent.
        tolerance: Relative error of a substep.
    """
    new, increment = points(state, increment)
    if not np.isfinite(increment).all():
        raise InputError("the strain increment has a component that is not finite: give finite strains")
    if not 1e-12 <= tolerance <= 1.0:
        raise InputError(f"tolerance {tolerance:g} is not valid: give a number from 1e-12 to 1")
    n = len(new)
    stress = np.empty((n, 6))
    tangents = np.empty((n, 6, 6)) if tangent else np.empty((0, 6, 6))
    counts, work = np.empty((2, n)), np.empty((WORK, STATE))
    table = Pointers([new, increment, model.numbers, stress, tangents, counts, work])
    _update_all.of(type(model.constants))(table.address, tolerance, n, tangent)
    return Update(new, stress, tangents if tangent else None, *counts.astype(np.int64))


@entry
def _update_all(table: Table, tolerance: float, n: int, with_tangent: int) -> int:
    states, increments, constants = (
        numbers_at(table[0], (n, STATE)),
        numbers_at(table[1], (n, 6)),
        constants_at(table[2]),
    )
    stresses, tangents = numbers_at(table[3], (n, 6)), numbers_at(table[4], (n, 6, 6))
    count, space = numbers_at(table[5], (2, n)), numbers_at(table[6], (WORK, STATE))
    identity = space[31:]
    for k in range(6):
        for i in range(6):
            identity[k, i] = 1.0 if i == k else 0.0
    for point in range(n):
        y = states[point]
        D = six_at(increments[point], 0)
        status, substeps = _update_one(y, D, constants, tolerance, with_tangent != 0, space, identity)
        count[0, point], count[1, point] = status, substeps
        if status != FINE:
            stresses[point] = np.nan
            if with_tangent:
                tangents[point] = np.nan
            continue
        put_six(stresses[point], 0, stress_of(y, constants))
        if with_tangent:
            for k in range(6):
                column = stress_rate_of(y, space[7 + k], constants)
                for i in range(6):
                    tangents[point, i, k] = column[i]
    return 0


def _update_one(y, D, c, tolerance, with_tangent, work, identity):
    """Apply the increment D by Heun's method with error control; `y` is changed only if the whole increment succeeds.

    The derivative of `y` with respect to D is left in work[7:13].
    """
    now, k1, k2, trial, new = work[0], work[1], work[2], work[3], work[4]
    S, S1, dk1, dk2 = work[7:13], work[13:19], work[19:25], work[25:31]
    put(now, y)
    S[:] = 0.0
    reason = outside(now, c)
    if reason != FINE:
        return reason, 0
    compressing = trace(D) > 0.0
    done, h, substeps, tries = 0.0, 1.0, 0, 0
    while done < 1.0:
        if tries >= MOST_SUBSTEPS:
            return (reason if reason != FINE else TOO_MANY_STEPS), substeps
        tries += 1
        h = min(h, 1.0 - done)
        strain_driven(now, D, compressing, c, k1)
        for i in range(STATE):
            trial[i] = now[i] + h * k1[i]
        reason = outside(trial, c)
        if reason == FINE:
            strain_driven(trial, D, compressing, c, k2)
            error = 0.0
            for i in range(STATE):
                new[i] = now[i] + 0.5 * h * (k1[i] + k2[i])
                error = max(error, abs(0.5 * h * (k2[i] - k1[i])) / max(abs(new[i]), FLOOR[i]))
            reason = outside(new, c)
        if reason != FINE:
            if h < SMALLEST:
                return reason, substeps
            h *= 0.25
            continue
        if error > tolerance:
            h *= max(0.1, 0.9 * np.sqrt(tolerance / error))
            continue
        if with_tangent:
            rates_differentials(now, D, compressing, c, S, identity, dk1, work[5:7])
            for k in range(6):
                for i in range(STATE):
                    S1[k, i] = S[k, i] + h * dk1[k, i]
            rates_differentials(trial, D, compressing, c, S1, identity, dk2, work[5:7])
            for k in range(6):
                for i in range(STATE):
                    S[k, i] += 0.5 * h * (dk1[k, i] + dk2[k, i])
        put(now, new)
        done += h
        substeps += 1
        if 1.0 - done < 1e-14:
            break
        h *= min(5.0, max(0.1, 0.9 * np.sqrt(tolerance / error) if error > 0.0 else 5.0))
    put(y, now)
    return FINE, substeps
