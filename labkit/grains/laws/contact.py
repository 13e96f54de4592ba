"""One contact at one instant, its motion in a time step, and its response: input and output of a law's parts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from labkit.grains.laws.vectors import Vector


class Contact(NamedTuple):
    """One contact at one instant. Vectors point from the first grain (a) to the second (b).

    Args:
        stiffness: Coefficient of the normal part.
        radius_a: Radius of a, m.
        radius_b: Radius of b, m.
        overlap: Overlap, m.
        inverse: 1/distance, 1/m.
        branch: b - a, m.
        normal: branch/distance.
        velocity: Velocity of the centre of b relative to that of a, m/s.
        spin_a: Angular velocity of a, rad/s.
        spin_b: Angular velocity of b, rad/s.
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
        turn: Mean rotation of the grains about the normal, rad, in the form that the kinematics needs.
        slip: Relative velocity of the grains at the contact point, normal to the contact normal, m/s.
    """

    before: Vector
    turn: float
    slip: Vector


class BondHistory(NamedTuple):
    """History of the bond of a contact.

    Args:
        length: Distance of the centres when the bond was made, m; 0 without a bond.
        force: Shear force on a, N.
        moment: Bending moment and torque on a, N m.
    """

    length: float
    force: Vector
    moment: Vector


class Response(NamedTuple):
    """Forces and losses of a contact in one step.

    Args:
        force: Force on a, N; the force on b is opposite.
        torque_a: Torque on a, N m.
        torque_b: Torque on b, N m.
        tangential_force: History: tangential force on a, N.
        rolling_moment: History: rolling moment on a, N m.
        friction_loss: Energy dissipated by friction in this step, J.
        rolling_loss: Energy dissipated by rolling in this step, J.
        dashpot_loss: Energy dissipated by the dashpots in this step, J.
        breaking_loss: Energy lost in this step because the grains joined or parted, or their bond broke, J.
        joined: History: 1 if cohesion joins the grains, else 0.
        bonded: History of the bond; None without a bond part.
    """

    force: Vector
    torque_a: Vector
    torque_b: Vector
    tangential_force: Vector
    rolling_moment: Vector
    friction_loss: float
    rolling_loss: float
    dashpot_loss: float
    breaking_loss: float
    joined: float
    bonded: BondHistory | None


class Features(NamedTuple):
    """Numerical parameters of a law's parts for a scene. The kernel is compiled without the parts that are None.

    Args:
        shear: Stiffness of the tangential part divided by the coefficient of the normal part.
        friction: mu.
        rolling: Parameters of the rolling part.
        twisting: Parameters of the twisting part.
        dashpots: Parameters of the dashpots.
        whole: True if the limits apply to the forces including their dashpots.
        cohesion: Parameters of the cohesion part.
        bond: Parameters of the bond part.
        turning: True if the law needs velocities and produces torques.
    """

    shear: float
    friction: float | None = None
    rolling: tuple[float, ...] | None = None
    twisting: tuple[float, ...] | None = None
    dashpots: tuple[float, ...] | None = None
    whole: bool | None = None
    cohesion: tuple[float, ...] | None = None
    bond: tuple[float, ...] | None = None
    turning: bool | None = None


class Tangents(NamedTuple):
    """Tangent stiffnesses, N/m, and coefficients of the dashpots, N s/m, of contacts at given overlaps; any shape."""

    normal: np.ndarray
    tangential: np.ndarray
    normal_dashpot: np.ndarray
    tangential_dashpot: np.ndarray
