"""The energy balance of a specimen: work of the cell = change of the stored energy + what friction, rolling and
damping have taken. An integration that is not stable makes energy of nothing, and this shows it.

An engine adds up work and losses in every step (State.ledger); the stored energy is a function of the State. Each
loss is summed by its own formula, slip times force and not as a remainder, so that the balance can fail.
"""

from __future__ import annotations

from labkit.errors import PhysicsError
from labkit.micro.contacts import contacts_of
from labkit.micro.indicators import elastic_energy, kinetic_energy
from labkit.dem.state import Ledger

BALANCE_LIMIT = 0.05  # of the larger of work and initial energy


def stored_energy(state, contacts=None):
    """Kinetic energy without the mean field and elastic energy, J."""
    contacts = contacts_of(state) if contacts is None else contacts
    return kinetic_energy(state) + elastic_energy(state.scene, state.radius, contacts)


def opened(state):
    """The same state with a new ledger, which begins with the energy that is stored now."""
    return state.replace(ledger=Ledger(start=stored_energy(state)))


def balance_error(state, contacts=None):
    """Energy that has vanished (positive) or come from nothing (negative) since the ledger was opened, over the work
    of the cell or the initial energy, whichever is larger; 0 where both are zero."""
    ledger = state.ledger
    scale = max(abs(ledger.cell_work), ledger.start)
    lost = ledger.friction_loss + ledger.rolling_loss + ledger.damping_loss
    missing = ledger.cell_work + ledger.start - stored_energy(state, contacts) - lost
    return missing / scale if scale > 0.0 else 0.0


def require_balanced(state, contacts=None):
    """Raises PhysicsError when the energy balance has drifted."""
    error = balance_error(state, contacts)
    if not abs(error) <= BALANCE_LIMIT:
        raise PhysicsError(
            f"the energy balance is off by {error:.1%} of the work at step {state.step}: the time step "
            f"{state.time_step:.3g} s is too large, lower time_step_factor from {state.scene.time_step_factor:g}"
        )
