"""Energy balance of a specimen.

The work done on the cell equals the change of the stored energy plus the energy dissipated by friction, rolling and
damping, by grains that part and by bonds that break. An unstable integration violates this balance, because it creates
energy.

An engine sums work and losses in every step (State.ledger); the stored energy is a function of the State. Each loss is
computed independently, as slip times force, and not as the remainder of the balance, so the balance reveals errors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from labkit.errors import PhysicsError
from labkit.grains.state import Ledger, State
from labkit.grains.time_step import critical_time_step
from labkit.micro.indicators import elastic_energy
from labkit.micro.snapshot import Snapshot

BALANCE_LIMIT = 0.05  # fraction of the larger of work and initial energy
BLAMED = 0.9  # fraction of the critical time step; a smaller time step is unlikely to cause the error


def fluctuation_velocity(state: State) -> np.ndarray:
    """Return the velocity relative to the mean field, v - L x, shape (grain, 3), in m/s."""
    return state.velocity - state.position @ state.velocity_gradient.T


def kinetic_energy(state: State) -> float:
    """Return the kinetic energy (J) of all grains: rotation, and translation relative to the mean field."""
    if state.bodies is not None:
        return state.bodies.kinetic_energy(state.scene.density, state.angular_velocity, state.velocity_gradient)
    velocity = fluctuation_velocity(state)
    translation = state.scene.mass(state.radius) @ np.einsum("gi,gi->g", velocity, velocity)
    spin = np.einsum("gi,gi->g", state.angular_velocity, state.angular_velocity)
    return 0.5 * float(translation + state.scene.moment_of_inertia(state.radius) @ spin)


def drift_velocity(state: State) -> np.ndarray:
    """Return the velocity (3,) of the centre of mass relative to the mean field, in m/s: total momentum over mass."""
    mass, bodies = state.scene.mass(state.body_radius), state.bodies
    velocity = fluctuation_velocity(state) if bodies is None else bodies.fluctuation_velocity(state.velocity_gradient)
    return mass @ velocity / mass.sum()


def stored_energy(state: State, snapshot: Snapshot | None = None) -> float:
    """Return the kinetic energy relative to the mean field plus the elastic energy, in J.

    Pass the Snapshot of the state if it is already computed.
    """
    return kinetic_energy(state) + elastic_energy(snapshot or state.snapshot())


def open_ledger(state: State) -> State:
    """Return the same state with a new ledger, which starts from the current stored energy.

    Forces and moments of springs that the scene lacks, left over from a scene with friction or rolling resistance, are
    set to zero, because YADE would keep such moments unchanged.
    """
    law = state.scene.contact_law
    declared = law.composition(state.scene).columns
    springs = [name for name in ("tangential_force", "rolling_moment") if name not in declared]
    columns = {name: values for name, values in state.columns.items() if name in law.columns}
    state = state.replace(**{name: np.zeros_like(getattr(state, name)) for name in springs}, columns=columns)
    return state.replace(ledger=Ledger(start=stored_energy(state)))


def balance_error(state: State, snapshot: Snapshot | None = None) -> float:
    """Return the relative error of the energy balance since the ledger was opened: positive for a loss, else negative.

    The error is relative to the same energy as in `relative_to_work`. Pass the Snapshot of the state if it is already
    computed.
    """
    return relative_balance(state.ledger, stored_energy(state, snapshot))


def relative_balance(ledger: Ledger, stored: float) -> float:
    """Return the `balance_error` from a ledger and the current stored energy (J)."""
    missing = ledger.cell_work + ledger.start - stored - ledger.total_loss
    return float(relative_to_work(missing, ledger.cell_work, ledger.start))


def relative_to_work(energy: ArrayLike, cell_work: ArrayLike, start: float) -> np.ndarray:
    """Divide an energy by the work done on the cell or the initial energy, whichever is larger; 0 if both are zero.

    Args:
        energy: Energy (J) of a shape that broadcasts with `cell_work`.
        cell_work: Work done on the cell (J).
        start: Initial energy (J); negative if adhesion prevails.
    """
    energy, scale = np.broadcast_arrays(energy, np.maximum(np.abs(cell_work), np.abs(start)))
    return np.divide(energy, scale, out=np.zeros(energy.shape), where=scale > 0.0)


def require_balanced(state: State, snapshot: Snapshot | None = None, error: float | None = None) -> None:
    """Raise PhysicsError if the error of the energy balance is too large.

    Pass the Snapshot of the state and its balance_error if they are already computed. The balance is not checked if
    the engine sums no losses.
    """
    if state.ledger.without_losses:
        return
    error = balance_error(state, snapshot) if error is None else error
    if not abs(error) <= BALANCE_LIMIT:
        raise PhysicsError(
            f"the energy balance is off by {error:.1%} of the work at step {state.step}: {_likely_reason(state, error)}"
            + ("" if state.scene.contact_law.labkits else "; or the losses of your law do not match its forces")
        )


def _likely_reason(state: State, error: float) -> str:
    """Return the likely cause of the error: the time step, unless it is well below the critical time step."""
    factor = f"time_step_factor from {state.scene.time_step_factor:g}"
    fraction = state.time_step / critical_time_step(state) if np.isfinite(error) else np.inf
    if fraction > BLAMED:
        return f"the time step {state.time_step:.3g} s is too large, reduce {factor}"
    return f"the time step is {fraction:.0%} of the critical one; if a smaller one does not help, report it ({factor})"
