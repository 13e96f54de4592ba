"""What is modelled: the material, the contact law and the rule for the time step (Table 1)."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np

from labkit.errors import InputError

LAWS = ("yade", "paper")
STIFFEST_DAMPING = 3.4  # damping ratio of the stiffest mode over that of one contact: a grain has many dashpots


@dataclasses.dataclass(frozen=True)
class Scene:
    """An immutable description of the grains and of how they touch. SI units; defaults are Table 1.

    `law = "yade"` is YADE's rolling-resistance law. It departs from the paper's Eqs. 1-3 in three ways that matter:

    * no dashpots: energy leaves through Newton's local non-viscous damping, `local_damping`;
    * rolling stiffness kt Ra Rb/4 where the paper has kt (Ra Rb/(Ra + Rb))^2: equal for equal grains,
      at most 4.2 % higher at the size ratio 1.5;
    * rolling limit mu_r min(Ra, Rb)/2 where the paper has mu_r Ra Rb/(Ra + Rb): equal for equal grains,
      at most 16.7 % lower at the size ratio 1.5, 6 % lower on average over random pairs.
      `rolling_limit_scale` multiplies it: 1.064 makes the mean over random pairs of +-20 % right.

    Two more are YADE's kinematics: it multiplies the relative shear velocity by 1/(1 - delta/(Ra + Rb)) against
    ratcheting, and turns forces with their contact to first order, so that over a run they leave the tangent
    plane by some 1e-3 of their size.

    A `planar` scene has grains that move in planes y = const and turn about y only. They stand for discs: kn does not
    depend on their size and is that of two mean grains, so that coarse and fine layers differ in scale alone.

    `law = "paper"` is Eqs. 1-3, for the engine fused alone: dashpots `beta_n`, `beta_t`, kr = kt r*^2,
    |M| <= mu_r r* fn; no local damping. The limits bound the springs, fn there being kn delta; the dashpots act
    beside them, so that a separating pair may be pulled for an instant. Records and stresses hold the forces of the
    springs, which a State determines; the work of the cell counts the dashpots too.

    Raises InputError for a value outside its physical range.
    """

    mean_diameter: float = 0.17e-3  # D, m
    diameter_spread: float = 0.2  # half-width of the uniform distribution over D
    density: float = 2650.0  # rho, kg/m3
    young_modulus: float = 0.15e9  # E, Pa
    stiffness_ratio: float = 2.0  # kappa = kn/kt
    friction: float = 0.4  # mu
    rolling_friction: float = 0.1  # mu_r
    rolling_limit_scale: float = 1.0
    local_damping: float = 0.2  # Newton's non-viscous damping, of law yade
    time_step_factor: float = 0.2  # of sqrt(m/kn) of the mean grain
    law: str = "yade"
    planar: bool = False  # discs in a plane, see below
    beta_n: float = 0.2  # dashpots of law paper
    beta_t: float = 0.2

    def __post_init__(self):
        for field, low, high in _RANGES:
            value = getattr(self, field)
            if not (isinstance(value, (int, float)) and math.isfinite(value) and low <= value <= high):
                raise InputError(f"{field.replace('_', ' ')} is {value}: give a number from {low:g} to {high:g}")
        if self.law not in LAWS:
            raise InputError(f"contact law {self.law!r} is unknown: use one of {', '.join(LAWS)}")

    def normal_stiffness(self, radius_a, radius_b):
        """kn = (pi/2) E D*, D* = Da Db/(Da + Db) (paper, below Eq. 3). Radii in m, any shape; N/m."""
        if self.planar:
            return np.pi / 4 * self.young_modulus * self.mean_diameter * np.ones_like(radius_a + radius_b)
        return np.pi * self.young_modulus * radius_a * radius_b / (radius_a + radius_b)

    def tangential_stiffness(self, radius_a, radius_b):
        """kt = kn/kappa (paper, below Eq. 3). Radii in m, any shape; N/m."""
        return self.normal_stiffness(radius_a, radius_b) / self.stiffness_ratio

    def rolling_stiffness(self, radius_a, radius_b):
        """kr: kt Ra Rb/4 of law yade, kt r*^2 of law paper (Eq. 3). Radii in m, any shape; N m."""
        kt, product = self.tangential_stiffness(radius_a, radius_b), radius_a * radius_b
        return kt * (product / 4.0 if self.law == "yade" else (product / (radius_a + radius_b)) ** 2)

    def dashpots(self, radius_a, radius_b):
        """2 beta sqrt(m* k) of the normal and of the tangential dashpot, m* = ma mb/(ma + mb) (Eqs. 1 and 2).

        Radii in m, any shape; N s/m. Of law paper alone.
        """
        a, b = self.mass(radius_a), self.mass(radius_b)
        reduced = a * b / (a + b)
        kn, kt = self.normal_stiffness(radius_a, radius_b), self.tangential_stiffness(radius_a, radius_b)
        return 2.0 * self.beta_n * np.sqrt(reduced * kn), 2.0 * self.beta_t * np.sqrt(reduced * kt)

    def mass(self, radius):
        """Mass of a spherical grain, kg. Radius in m, any shape."""
        return self.density * (4.0 / 3.0) * np.pi * radius**3

    def moment_of_inertia(self, radius):
        """2/5 m R^2 of a spherical grain, kg m2. Radius in m, any shape."""
        return 0.4 * self.mass(radius) * radius**2

    @property
    def time_unit(self):
        """sqrt(m/kn) of two grains of mean diameter, s."""
        radius = self.mean_diameter / 2
        return float(np.sqrt(self.mass(radius) / self.normal_stiffness(radius, radius)))

    @property
    def time_step(self):
        """The time step of a test, s: `time_step_factor` sqrt(m/kn) (sqrt(1 + zeta^2) - zeta).

        zeta is the damping ratio of the stiffest mode, 0 without dashpots. With the default factor this is 0.55 to
        0.6 of the rigorous limit of a dense specimen, labkit.dem.time_step, for either law.
        """
        zeta = STIFFEST_DAMPING * max(self.beta_n, self.beta_t) if self.law == "paper" else 0.0
        return self.time_step_factor * self.time_unit * (math.sqrt(1.0 + zeta**2) - zeta)

    def with_friction(self, friction, rolling_friction):
        """The same scene with another (mu, mu_r)."""
        return dataclasses.replace(self, friction=friction, rolling_friction=rolling_friction)

    def to_json(self):
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text):
        """Raises InputError when the text is not a scene."""
        try:
            return cls(**json.loads(text))
        except (TypeError, ValueError) as error:
            raise InputError(f"not a labkit scene: {error}") from None


_RANGES = (
    ("mean_diameter", 1e-9, 1e3),
    ("diameter_spread", 0.0, 0.9),
    ("density", 1e-3, 1e9),
    ("young_modulus", 1.0, 1e15),
    ("stiffness_ratio", 0.1, 100.0),
    ("friction", 0.0, 10.0),
    ("rolling_friction", 0.0, 10.0),
    ("rolling_limit_scale", 0.0, 10.0),
    ("local_damping", 0.0, 0.99),
    ("time_step_factor", 1e-6, 10.0),
    ("beta_n", 0.0, 10.0),
    ("beta_t", 0.0, 10.0),
)
