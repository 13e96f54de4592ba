"""What is modelled: the material, the contact law and the rule for the time step (Table 1)."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np

from labkit.dem.laws import LAWS, ContactLaw
from labkit.errors import InputError
from labkit.parameters import check_parameters, parameter, restored


@dataclasses.dataclass(frozen=True)
class Scene:
    """An immutable description of the grains and of how they touch. SI units; defaults are Table 1.

    `law = "rolling_resistance"` is YADE's rolling-resistance law. It departs from the paper's Eqs. 1-3 in three ways
    that matter:

    * no dashpots: energy leaves through Newton's local non-viscous damping, `local_damping`;
    * rolling stiffness kt Ra Rb/4 where the paper has kt (Ra Rb/(Ra + Rb))^2: equal for equal grains,
      at most 4.2 % higher at the size ratio 1.5;
    * rolling limit mu_r min(Ra, Rb)/2 where the paper has mu_r Ra Rb/(Ra + Rb): equal for equal grains,
      at most 16.7 % lower at the size ratio 1.5, 6 % lower on average over random pairs.
      `rolling_limit_scale` multiplies it: 1.064 makes the mean over random pairs of +-20 % right.

    Two more are YADE's kinematics: it multiplies the relative shear velocity by 1/(1 - delta/(Ra + Rb)) against
    ratcheting, and turns forces with their contact to first order, so that over a run they leave the tangent
    plane by some 1e-3 of their size.

    `law = "spring_dashpot"` is Eqs. 1-3, for the engine fused alone: dashpots `beta_n`, `beta_t`, kr = kt r*^2,
    |M| <= mu_r r* fn; no local damping. The limits bound the springs, fn there being kn delta; the dashpots act
    beside them, so that a separating pair may be pulled for an instant. Records and stresses hold the forces of the
    springs, which a State determines; the work of the cell counts the dashpots too.

    A `planar` scene has grains that move in planes y = const and turn about y only. They stand for discs: kn does not
    depend on their size and is that of two mean grains, so that coarse and fine layers differ in scale alone.

    `law` may also be one of your own, see labkit.ContactLaw. Raises InputError for a value outside its physical range.
    """

    mean_diameter: float = parameter(0.17e-3, unit="m", low=1e-9, high=1e3, help="D, mean diameter of the grains")
    diameter_spread: float = parameter(
        0.2, low=0.0, high=0.9, help="half-width of the uniform distribution of diameters over D"
    )
    density: float = parameter(2650.0, unit="kg/m3", low=1e-3, high=1e9, help="rho of the grains")
    young_modulus: float = parameter(0.15e9, unit="Pa", low=1.0, high=1e15, help="E of the contacts")
    stiffness_ratio: float = parameter(2.0, low=0.1, high=100.0, help="kappa = kn/kt")
    friction: float = parameter(0.4, low=0.0, high=10.0, help="mu")
    rolling_friction: float = parameter(0.1, low=0.0, high=10.0, help="mu_r")
    rolling_limit_scale: float = parameter(
        1.0, low=0.0, high=10.0, help="factor of the rolling limit, law rolling_resistance"
    )
    local_damping: float = parameter(
        0.2, low=0.0, high=0.99, help="Newton's non-viscous damping, law rolling_resistance"
    )
    time_step_factor: float = parameter(0.2, low=1e-6, high=10.0, help="time step over sqrt(m/kn) of the mean grain")
    law: str = parameter("rolling_resistance", choices=LAWS, help="contact law")
    planar: bool = parameter(False, option=False, help="discs in a plane")
    beta_n: float = parameter(0.2, low=0.0, high=10.0, help="normal dashpot, law spring_dashpot")
    beta_t: float = parameter(0.2, low=0.0, high=10.0, help="tangential dashpot, law spring_dashpot")

    def __post_init__(self) -> None:
        """Checks every parameter. Raises InputError."""
        check_parameters(self)

    @property
    def contact_law(self) -> ContactLaw:
        """The ContactLaw that `law` names."""
        return _instance(LAWS[self.law])

    def normal_stiffness(self, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """kn of the contact law. Radii in m, any shape; N/m."""
        return self.contact_law.normal_stiffness(self, radius_a, radius_b)

    def tangential_stiffness(self, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """kt of the contact law. Radii in m, any shape; N/m."""
        return self.contact_law.tangential_stiffness(self, radius_a, radius_b)

    def rolling_stiffness(self, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """kr of the contact law. Radii in m, any shape; N m."""
        return self.contact_law.rolling_stiffness(self, radius_a, radius_b)

    def normal_force(self, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray) -> np.ndarray:
        """Elastic normal force of the contact law. Radii and overlaps in m, any shape; N, compression positive."""
        return self.contact_law.normal_force(self, radius_a, radius_b, overlap)

    def mass(self, radius: np.ndarray) -> np.ndarray:
        """Mass of a spherical grain, kg. Radius in m, any shape."""
        return self.density * (4.0 / 3.0) * np.pi * radius**3

    def moment_of_inertia(self, radius: np.ndarray) -> np.ndarray:
        """2/5 m R^2 of a spherical grain, kg m2. Radius in m, any shape."""
        return 0.4 * self.mass(radius) * radius**2

    @property
    def time_unit(self) -> float:
        """sqrt(m/kn) of two grains of mean diameter, s."""
        radius = self.mean_diameter / 2
        return float(np.sqrt(self.mass(radius) / self.normal_stiffness(radius, radius)))

    @property
    def time_step(self) -> float:
        """The time step of a test, s: `time_step_factor` sqrt(m/kn) (sqrt(1 + zeta^2) - zeta).

        zeta is the damping ratio of the stiffest mode, 0 without dashpots. With the default factor this is 0.55 to
        0.6 of the rigorous limit of a dense specimen, labkit.dem.time_step, for either of labkit's laws.
        """
        zeta = self.contact_law.damping_ratio(self)
        return self.time_step_factor * self.time_unit * (math.sqrt(1.0 + zeta**2) - zeta)

    def with_friction(self, friction: float, rolling_friction: float) -> Scene:
        """The same scene with another (mu, mu_r)."""
        return dataclasses.replace(self, friction=friction, rolling_friction=rolling_friction)

    def to_json(self) -> str:
        """The scene as JSON, for files."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Scene:
        """The scene of a file. Raises InputError when the text is not a scene."""
        try:
            values = json.loads(text)
            if not isinstance(values, dict):
                raise TypeError(f"{text} holds no fields")
            return restored(cls, values)
        except InputError:  # a value that is not possible, or a law of one's own that is not loaded
            raise
        except (TypeError, ValueError) as error:
            raise InputError(f"not a labkit scene: {error}") from None


MADE_WITH = ("mean_diameter", "diameter_spread")  # what a run cannot change any more

_INSTANCES: dict[type, ContactLaw] = {}


def _instance(kind: type[ContactLaw]) -> ContactLaw:
    """The one instance of a law: laws hold no values, so that all scenes share it."""
    return _INSTANCES.setdefault(kind, kind())
