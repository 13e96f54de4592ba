"""The bond part: cement between two grains, which acts as a beam parallel to their contact."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from labkit.errors import InputError
from labkit.grains.laws.contact import Contact, ContactStep, Share, Values
from labkit.grains.laws.parts import BREAKING, Column, LawPart, Numbers
from labkit.grains.laws.tangential import STIFFNESS_RATIO
from labkit.grains.laws.vectors import Vector, across, choose, dot
from labkit.parameters import parameter

if TYPE_CHECKING:
    from labkit.grains.scene import Scene

PI = math.pi


class ParallelBond(LawPart):
    """A parallel bond (Potyondy and Cundall 2004), a round bar between the centres of two grains.

    The bar has the radius r = `bond_radius` min(Ra, Rb) and a length L equal to the distance between the centres when
    the bond was created; A = pi r^2, I = pi r^4/4, J = 2 I, E = `bond_modulus` and G = E/kappa. It resists elongation
    with EA/L, shear with GA/L, bending with EI/L and torsion with GJ/L, in addition to the contact, and breaks
    permanently when

        N/A + |M| r/I >= `bond_strength`,  N in tension,    or    |V|/A + |T| r/J >= `bond_shear_strength`.

    The energy stored in the bond is then dissipated. A new bond carries no force (labkit.bond).
    """

    kind = "bond"
    parameters: ClassVar[Mapping[str, object]] = {
        "stiffness_ratio": STIFFNESS_RATIO,
        "bond_modulus": parameter(
            0.15e9, unit="Pa", low=1.0, high=1e15, help="Young's modulus of bonds, with the law bonded"
        ),
        "bond_radius": parameter(
            1.0, low=1e-3, high=10.0, help="radius of a bond over that of its smaller grain, with the law bonded"
        ),
        "bond_strength": parameter(
            1e6, unit="Pa", above=0.0, high=1e12, help="tensile strength of bonds, with the law bonded"
        ),
        "bond_shear_strength": parameter(
            1e6, unit="Pa", above=0.0, high=1e12, help="shear strength of bonds, with the law bonded"
        ),
    }
    history: ClassVar[Mapping[str, Column]] = {
        "bond_length": Column(
            "m", "distance of the centres when the bond was made, 0 without a bond", joins=True, range=(0.5, 1.5)
        ),
        "bond_force": Column("N", "shear force of the bond on the first grain", size=3, odd=True),
        "bond_moment": Column("N m", "bending moment and torque of the bond on the first grain", size=3, odd=True),
    }
    losses: ClassVar[Mapping[str, str]] = BREAKING
    not_in_yade = "its bonds replace the springs of a contact and have no stress criterion"

    def numbers(self, scene: Scene) -> Numbers:
        """Return the parameters of the bond, the argument `numbers` of the functions below."""
        modulus = scene.bond_modulus
        return (
            modulus,
            modulus / scene.stiffness_ratio,
            scene.bond_radius,
            scene.bond_strength,
            scene.bond_shear_strength,
        )

    def reach(self, scene: Scene, stiffness: float, radius: float) -> float:
        if scene.bond_strength > scene.bond_modulus:
            allowed = f"at most the bond modulus, {scene.bond_modulus:g} Pa"
            problem = "Pa lets bonds stretch to more than twice their length"
            raise InputError(problem, field="bond_strength", value=scene.bond_strength, allowed=allowed)
        return 1.01 * scene.bond_strength / scene.bond_modulus * 2.0 * radius

    @staticmethod
    def respond(step: ContactStep, history: Values, numbers: Numbers, carry: Callable[..., Vector]) -> Share:
        """Return the Share of a bond in a time step.

        Args:
            step: The contact in a time step.
            history: The columns of history at the start of the step.
            numbers: See the method `numbers`.
            carry: Function of the kinematics that rotates a vector of the history with the contact.
        """
        contact, motion, dt, n = step.contact, step.motion, step.dt, step.contact.normal
        length = abs(history.bond_length)
        there = 1.0 if length > 0.0 else 0.0
        stiffness = stiffness_of(numbers, contact.radius_a, contact.radius_b, length)
        bend = contact.spin_b - contact.spin_a
        twist = dot(history.bond_moment, motion.before)
        force = carry(history.bond_force, n, motion) + (there * stiffness[1] * dt) * motion.slip
        moment = carry(history.bond_moment - twist * motion.before, n, motion)
        moment = moment + (there * stiffness[2] * dt) * across(bend, n)
        twist += there * stiffness[3] * dt * dot(bend, n)
        tension = tension_of(contact, length, stiffness[0])
        radius = bond_radius(numbers, contact.radius_a, contact.radius_b)
        shear, bending = math.sqrt(dot(force, force)), math.sqrt(dot(moment, moment))
        whole = 1.0 if excess(numbers, radius, tension, shear, bending, abs(twist)) < 1.0 else 0.0
        half = 0.5 * there * dt  # the energy of the middle of the step is lost: see cohesion.py
        v, m = force - (half * stiffness[1]) * motion.slip, moment - (half * stiffness[2]) * across(bend, n)
        axial, torque = dot(n, contact.velocity), twist - half * stiffness[3] * dot(bend, n)
        pulled = tension - half * stiffness[0] * axial
        lost = (1.0 - whole) * bond_energy(stiffness, pulled, dot(v, v), dot(m, m), torque * torque)
        force, moment = whole * force, whole * (moment + twist * n)
        return Share(whole * tension, force, moment, (whole * length, force, moment), (lost,))

    @staticmethod
    def stored_energy(contact: Contact, history: Values, numbers: Numbers) -> float:
        """Return the energy (J) stored in the bond, from its history."""
        length, force, moment = abs(history.bond_length), history.bond_force, history.bond_moment
        stiffness = stiffness_of(numbers, contact.radius_a, contact.radius_b, length)
        twist = dot(moment, contact.normal)
        torsion = twist * twist
        bending = dot(moment, moment) - torsion
        return bond_energy(stiffness, tension_of(contact, length, stiffness[0]), dot(force, force), bending, torsion)

    @staticmethod
    def normal_force(contact: Contact, history: Values, numbers: Numbers) -> float:
        """Return the normal force of the bond (N), compression positive, from its history alone."""
        length = abs(history.bond_length)
        return -tension_of(contact, length, stiffness_of(numbers, contact.radius_a, contact.radius_b, length)[0])


def bond_radius(numbers: Numbers, radius_a: float, radius_b: float) -> float:
    """Return the radius (m) of a bond."""
    return numbers[2] * np.minimum(radius_a, radius_b)


def stiffness_of(
    numbers: Numbers, radius_a: float, radius_b: float, length: float
) -> tuple[float, float, float, float]:
    """Return the stiffness in elongation and shear (N/m), bending and torsion (N m); finite if `length` is 0."""
    radius = bond_radius(numbers, radius_a, radius_b)
    area = PI * radius * radius / choose(length > 0.0, length, radius)
    second = 0.25 * radius * radius * area
    return numbers[0] * area, numbers[1] * area, numbers[0] * second, 2.0 * numbers[1] * second


def tension_of(contact: Contact, length: float, stiffness: float) -> float:
    """Return the tension of a bond (N) from its length (m) and its stiffness in elongation (N/m); 0 without a bond."""
    there = choose(length > 0.0, 1.0, 0.0)
    return there * stiffness * (contact.radius_a + contact.radius_b - contact.overlap - length)


def excess(numbers: Numbers, radius: float, tension: float, shear: float, bending: float, torsion: float) -> float:
    """Return the larger of normal and shear stress, each divided by its strength: the bond breaks at 1."""
    area = PI * radius * radius
    normal = (tension + 4.0 * bending / radius) / area / numbers[3]
    return np.maximum(normal, (shear + 2.0 * torsion / radius) / area / numbers[4])


def bond_energy(stiffness: Numbers, tension: float, shear: float, bending: float, torsion: float) -> float:
    """Return the energy of a bond (J); `shear`, `bending` and `torsion` are squares of shear force and moments."""
    elongated = tension * tension / stiffness[0] + shear / stiffness[1]
    return 0.5 * (elongated + bending / stiffness[2] + torsion / stiffness[3])
