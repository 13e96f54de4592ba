"""Energy created by the factor with which YADE's rolling-resistance law avoids granular ratcheting.

With s = Ra + Rb, the distance d = s - delta, the relative velocity v of the centres and the spins wa, wb, the law
extends its tangential spring at the rate

    u = (s/d) v - (Ra wa + Rb wb) x n,    projected onto the contact plane,

while its force t acts on the centres, with the arms Ra - delta/2 and Rb - delta/2. Grains and cell therefore do work
on the contact at the rate t . w,

    w = v - ((Ra - delta/2) wa + (Rb - delta/2) wb) x n.

Springs and friction receive t . u, so the law creates energy at the rate

    P = sum of t . (u - w) over the contacts.

For equal radii u - w = (delta/s) u: the created energy is the fraction delta/s of the friction loss: 1 to 2 % in a
specimen within the limits of the overlap and 7 % at e = 0.3. The created energy accumulates, and friction becomes the
largest term of the energy balance.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.grains.laws.vectors import Vector, across, cross, dot
from labkit.grains.state import State
from labkit.micro.snapshot import Snapshot
from labkit.records.energy import relative_to_work


def ratcheting_power(state: State, snapshot: Snapshot | None = None) -> float:
    """Return the rate P (W) at which the contact law creates energy; 0 for a law without the factor.

    The slip velocities u and w differ by (s/d - 1) v and by half of the overlap times the spins. Pass the Snapshot of
    the state if it is already computed.
    """
    first, second = state.contact_grain.T.astype(np.intp, order="C")
    if not state.scene.contact_law.avoids_ratcheting or not len(first):
        return 0.0
    spheres, spin = (snapshot or state.snapshot()).spheres, state.angular_velocity
    contacts = spheres.contacts
    image = state.contact_shift @ (state.velocity_gradient @ state.cell).T  # velocity of the periodic image
    velocity = state.velocity.take(second, 0) + image - state.velocity.take(first, 0)
    distance = contacts.branch_length(spheres.radius)
    turning = spin.take(first, 0) + spin.take(second, 0)
    v, w, n, t = (Vector(*rows.T.copy()) for rows in (velocity, turning, contacts.normal, state.tangential_force))
    power = (distance + contacts.overlap) / distance * dot(v, across(t, n)) - dot(v, t)
    return float(np.sum(power - 0.5 * contacts.overlap * dot(w, cross(n, t))))


@dataclasses.dataclass
class Ratcheting:
    """Energy (J) created up to each record of a run: the power at the records integrated by the trapezoidal rule.

    `work` has one value per record; `power` (W) and `time` (s) are the values at the last record.
    """

    work: list[float] = dataclasses.field(default_factory=list)
    power: float = 0.0
    time: float = 0.0

    def add(self, number: int, time: float, power: float) -> float:
        """Add or replace the record `number`, and return the energy (J) created up to this record.

        Args:
            number: Index of the record.
            time: Time of the record (s).
            power: ratcheting_power at the record (W).
        """
        before = self.work[-1] if self.work else 0.0
        del self.work[number:]
        self.work.append(before + 0.5 * (self.power + power) * (time - self.time) if number else 0.0)
        self.power, self.time = power, time
        return self.work[-1]

    def copy(self) -> Ratcheting:
        """Return a copy for the thread that writes the file."""
        return Ratcheting(list(self.work), self.power, self.time)

    def error(self, state: State) -> float:
        """Return the contribution of the created energy to the relative error of the energy balance."""
        created = self.work[-1] if self.work else 0.0
        return float(relative_to_work(created, state.ledger.cell_work, state.ledger.start))
