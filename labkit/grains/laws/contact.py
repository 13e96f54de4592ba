"""A contact at one instant, its motion in a time step and its response: input and output of the parts of a law."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from labkit.grains.laws.vectors import Vector

Values = Any  # a named tuple with the history, the parameters or the losses of a law


class Contact(NamedTuple):
    """One contact at one instant. Vectors point from the first grain (a) to the second (b).

    Args:
        stiffness: Coefficient of the normal part.
        radius_a: Radius of grain a (m).
        radius_b: Radius of grain b (m).
        overlap: Overlap (m).
        inverse: 1/distance (1/m).
        branch: b - a (m).
        normal: branch/distance.
        velocity: Velocity (m/s) of the centre of b relative to the centre of a.
        spin_a: Angular velocity of grain a (rad/s).
        spin_b: Angular velocity of grain b (rad/s).
    """

    stiffness: float
    radius_a: float
    radius_b: float
    overlap: float
    inverse: float
    branch: Vector
    normal: Vector
    velocity: Vector
    spin_a: Vector
    spin_b: Vector


class ContactMotion(NamedTuple):
    """How a contact moves in a time step.

    Args:
        before: Contact normal at the start of the step.
        turn: Mean rotation of the grains about the normal (rad); half of it in the kinematics Midpoint.
        slip: Relative velocity (m/s) of the grains at the contact point, normal to the contact normal.
    """

    before: Vector
    turn: float
    slip: Vector


class ContactStep(NamedTuple):
    """Input of the parts of a law for a contact in a time step.

    Args:
        contact: The contact.
        motion: Its motion.
        dt: Time step (s).
        wide: Overlap (m) that determines the tangential stiffness.
        earlier: The same overlap (m) in the previous step.
        kt: Tangential stiffness (N/m).
        limiting: Normal force (N) that limits friction and rolling.
    """

    contact: Contact
    motion: ContactMotion
    dt: float
    wide: float
    earlier: float
    kt: float
    limiting: float


class Share(NamedTuple):
    """The response of a part on which no other part depends, such as a bond.

    Args:
        tension: Tensile force along the normal (N).
        force: Tangential force on grain a (N).
        moment: Moment on grain a (N m); the moment on b is opposite.
        history: Columns of history of the part.
        losses: Losses of the part (J).
    """

    tension: float
    force: Vector
    moment: Vector
    history: tuple[float | Vector, ...]
    losses: tuple[float, ...]


class Response(NamedTuple):
    """Forces, history and losses of a contact in one step.

    Args:
        force: Force on grain a (N); the force on b is opposite.
        torque_a: Torque on grain a (N m).
        torque_b: Torque on grain b (N m).
        history: The columns of history at the end of the step, by name.
        losses: Energies (J) dissipated in this step, by name.
    """

    force: Vector
    torque_a: Vector
    torque_b: Vector
    history: Values
    losses: Values


class Tangents(NamedTuple):
    """Tangent stiffnesses and dashpot coefficients of contacts at given overlaps; arrays of any shape.

    Args:
        normal: Normal stiffness (N/m).
        tangential: Tangential stiffness (N/m).
        rolling: Rolling stiffness (N m).
        twisting: Twisting stiffness (N m).
        normal_dashpot: Coefficient of the normal dashpot (N s/m).
        tangential_dashpot: Coefficient of the tangential dashpot (N s/m).
    """

    normal: np.ndarray
    tangential: np.ndarray
    rolling: np.ndarray
    twisting: np.ndarray
    normal_dashpot: np.ndarray
    tangential_dashpot: np.ndarray
