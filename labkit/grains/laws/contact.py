"""One contact at one instant, its motion in a time step, and its response: what the parts of a law compute with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from labkit.grains.laws.vectors import Vector


class Contact(NamedTuple):
    """One contact at one instant. Vectors point from the first grain (a) to the second (b).

    stiffness: the coefficient of the normal part; radius_a, radius_b, overlap: m; inverse: 1/distance, 1/m;
    branch: b - a, m; normal: branch/distance; velocity: of b relative to a (centres), m/s; spin_a, spin_b: rad/s.
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

    before: its normal at the start of the step; turn: mean rotation of the grains about it, rad, as the kinematics
    needs it; slip: relative velocity of the grains at the contact point, normal to the contact normal, m/s.
    """

    before: Vector
    turn: float
    slip: Vector


class Response(NamedTuple):
    """Forces and losses of a contact in one step.

    force: on a, N (the force on b is opposite); torque_a, torque_b: N m; tangential_force, rolling_moment: the history,
    acting on a; friction_loss, rolling_loss, dashpot_loss: energy dissipated in this step, J.
    """

    force: Vector
    torque_a: Vector
    torque_b: Vector
    tangential_force: Vector
    rolling_moment: Vector
    friction_loss: float
    rolling_loss: float
    dashpot_loss: float


class Features(NamedTuple):
    """Numbers of the parts of a law for a scene. The kernel is compiled without the parts that are None.

    shear: stiffness of the tangential part, over the coefficient of the normal part; friction: mu; rolling, twisting,
    dashpots: numbers that these parts need; whole: True if the limits apply to the forces with their dashpots;
    turning: True if the law needs velocities and produces torques.
    """

    shear: float
    friction: float | None = None
    rolling: tuple[float, ...] | None = None
    twisting: tuple[float, ...] | None = None
    dashpots: tuple[float, ...] | None = None
    whole: bool | None = None
    turning: bool | None = None


class Tangents(NamedTuple):
    """Tangent stiffnesses, N/m, and coefficients of the dashpots, N s/m, of contacts at given overlaps; any shape."""

    normal: np.ndarray
    tangential: np.ndarray
    normal_dashpot: np.ndarray
    tangential_dashpot: np.ndarray
