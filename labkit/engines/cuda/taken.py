"""A State read from the device: its arrays as they are there, and the State that is made of them on the host."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.engines.cuda.listing import contacts_from_lists, listed
from labkit.errors import PhysicsError
from labkit.grains.state import State

# arrays of a State that the device holds
ON_DEVICE = (
    "position",
    "velocity",
    "angular_velocity",
    "contact_grain",
    "contact_shift",
    "tangential_force",
    "rolling_moment",
)


@dataclasses.dataclass(frozen=True)
class Taken:
    """A State as it was read from the device.

    brief: the State without the arrays ON_DEVICE, and with its former ledger; order (grain,): index in the State of
    each grain on the device; first: first grain; arrays: those of States, Grains and Lists by name, (k, n).
    """

    brief: State
    order: np.ndarray
    first: int
    arrays: dict[str, np.ndarray]

    def state(self) -> State:
        """The State, with contacts sorted by grain and the ledger up to date. Raises PhysicsError."""
        brief, order = self.brief, self.order
        ledger = brief.ledger.plus(*self.arrays["energies"].sum(axis=1))
        if not np.isfinite(ledger.cell_work):
            raise PhysicsError(f"forces became NaN: the time step {brief.time_step:.3g} s is too large")
        kinematics = {}
        for name, array in (("position", "position"), ("velocity", "velocity"), ("angular_velocity", "spin")):
            kinematics[name] = np.empty((len(order), 3))
            kinematics[name][order] = self.arrays[array].T
        listing = listed(self.arrays, self.first)
        contacts = contacts_from_lists(listing, order, kinematics["position"], brief.radius, brief.cell)
        return brief.replace(**kinematics, **contacts, ledger=ledger)
