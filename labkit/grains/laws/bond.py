"""The bond part: cement between two grains, a beam parallel to their contact."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from labkit.grains.laws.parts import LawPart, Numbers

if TYPE_CHECKING:
    from labkit.grains.scene import Scene

PI = math.pi


class ParallelBond(LawPart):
    """A parallel bond (Potyondy and Cundall 2004), a round bar between the centres of two grains.

    Its radius is r = `bond_radius` min(Ra, Rb), its length L the distance of the centres when it was made, with
    A = pi r^2, I = pi r^4/4 and J = 2 I; E = `bond_modulus` and G = E/kappa. It resists elongation with EA/L, shear
    with GA/L, bending with EI/L and torsion with GJ/L, in addition to the contact, and breaks permanently when

        N/A + |M| r/I >= `bond_strength`,  N in tension,    or    |V|/A + |T| r/J >= `bond_shear_strength`.

    Its energy is then lost. A bond is made without force (labkit.bond).
    """

    kind = "bond"
    uses: ClassVar[tuple[str, ...]] = (
        "bond_modulus", "bond_radius", "bond_strength", "bond_shear_strength", "stiffness_ratio",
    )  # fmt: skip

    def numbers(self, scene: Scene) -> Numbers:
        """First argument of the functions below."""
        modulus = scene.bond_modulus
        return (
            modulus,
            modulus / scene.stiffness_ratio,
            scene.bond_radius,
            scene.bond_strength,
            scene.bond_shear_strength,
        )

    def gap(self, scene: Scene, radius: float) -> float:
        """Largest gap across which a bond between two grains of this radius, m, holds, m."""
        return 1.01 * scene.bond_strength / scene.bond_modulus * 2.0 * radius

    @staticmethod
    def radius(numbers: Numbers, radius_a: float, radius_b: float) -> float:
        """Radius of the bond, m."""
        return numbers[2] * np.minimum(radius_a, radius_b)

    @staticmethod
    def stiffness(numbers: Numbers, radius: float, length: float) -> tuple[float, float, float, float]:
        """Stiffness against elongation and shear, N/m, bending and torsion, N m, from radius and length, m."""
        area = PI * radius * radius / length
        second = 0.25 * radius * radius * area
        return numbers[0] * area, numbers[1] * area, numbers[0] * second, 2.0 * numbers[1] * second

    @staticmethod
    def excess(numbers: Numbers, radius: float, tension: float, shear: float, bending: float, torsion: float) -> float:
        """The larger of the two stresses divided by its strength: the bond breaks at 1."""
        area = PI * radius * radius
        normal = (tension + 4.0 * bending / radius) / area / numbers[3]
        return np.maximum(normal, (shear + 2.0 * torsion / radius) / area / numbers[4])

    @staticmethod
    def energy(stiffness: Numbers, tension: float, shear: float, bending: float, torsion: float) -> float:
        """Stored energy, J, from the four stiffnesses, the tension, N, and the squares of the others."""
        elongated = tension * tension / stiffness[0] + shear / stiffness[1]
        return 0.5 * (elongated + bending / stiffness[2] + torsion / stiffness[3])
