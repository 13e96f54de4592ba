"""The scene: material, grading, contact law and time-step rule (Table 1)."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import cast, overload

import numpy as np

from labkit.dem.laws import LAWS, ContactLaw
from labkit.errors import InputError
from labkit.parameters import check_parameters, parameter, restored


@dataclasses.dataclass(frozen=True)
class Scene:
    """Immutable description of the grains and their contacts. SI units; the defaults are those of Table 1.

    `law = "rolling_resistance"` is YADE's rolling-resistance law. It differs from Eqs. 1-3 of the paper in three
    important ways:

    * no dashpots: energy is dissipated by Newton's local non-viscous damping, `local_damping`;
    * rolling stiffness kt Ra Rb/4 instead of kt (Ra Rb/(Ra + Rb))^2: equal for equal grains, at most 4.2 % higher at a
      size ratio of 1.5;
    * rolling limit mu_r min(Ra, Rb)/2 instead of mu_r Ra Rb/(Ra + Rb): equal for equal grains, at most 16.7 % lower at
      a size ratio of 1.5, 6 % lower on average over random pairs. `rolling_limit_scale` multiplies it: with 1.064 the
      mean over random pairs of +-20 % equals the paper's.

    Two further differences come from YADE's kinematics: it multiplies the relative shear velocity by
    1/(1 - delta/(Ra + Rb)) to avoid ratcheting, and rotates forces with their contact to first order only, so that over
    a run they leave the tangent plane by some 1e-3 of their magnitude.

    `law = "spring_dashpot"` is Eqs. 1-3, available only in the `fused` engine: dashpots `beta_n`, `beta_t`,
    kr = kt r*^2, |M| <= mu_r r* fn; no local damping. The limits apply to the springs, with fn = kn delta. The dashpots
    act in parallel, so that a separating pair may be in tension for an instant. Records and stresses contain the spring
    forces, which follow from a State; the work done on the cell includes the dashpots.

    The grains of a `planar` scene move in planes y = const, rotate only about y and represent discs: kn is that of two
    grains of mean diameter whatever their size, so that coarse and fine layers differ only in scale.

    `law` may also be user-defined, see labkit.ContactLaw. Raises InputError for a value outside its physical range.
    """

    mean_diameter: float = parameter(0.17e-3, unit="m", low=1e-9, high=1e3, help="mean diameter D of the grains")
    diameter_spread: float = parameter(
        0.2, low=0.0, high=0.9, help="half-width of the uniform distribution of diameters, divided by D"
    )
    density: float = parameter(2650.0, unit="kg/m3", low=1e-3, high=1e9, help="density rho of the grains")
    young_modulus: float = parameter(0.15e9, unit="Pa", low=1.0, high=1e15, help="Young's modulus E of the contacts")
    stiffness_ratio: float = parameter(2.0, low=0.1, high=100.0, help="stiffness ratio kappa = kn/kt")
    friction: float = parameter(0.4, low=0.0, high=10.0, help="friction coefficient mu")
    rolling_friction: float = parameter(0.1, low=0.0, high=10.0, help="rolling friction coefficient mu_r")
    rolling_limit_scale: float = parameter(
        1.0, low=0.0, high=10.0, help="factor on the rolling limit of the rolling_resistance law"
    )
    local_damping: float = parameter(
        0.2, low=0.0, high=0.99, help="local non-viscous damping coefficient, with the rolling_resistance law"
    )
    time_step_factor: float = parameter(
        0.2, low=1e-6, high=10.0, help="time step divided by sqrt(m/kn) of the mean grain"
    )
    law: str = parameter("rolling_resistance", choices=LAWS, help="contact law")
    planar: bool = parameter(False, option=False, help="discs in a plane instead of spheres")
    beta_n: float = parameter(
        0.2, low=0.0, high=10.0, help="damping ratio of the normal dashpot, with the spring_dashpot law"
    )
    beta_t: float = parameter(
        0.2, low=0.0, high=10.0, help="damping ratio of the tangential dashpot, with the spring_dashpot law"
    )

    def __post_init__(self) -> None:
        """Check every parameter."""
        check_parameters(self)

    @property
    def contact_law(self) -> ContactLaw:
        """The ContactLaw named `law`."""
        return _instance(LAWS[self.law])

    def normal_stiffness(self, radius_a: np.ndarray | float, radius_b: np.ndarray | float) -> np.ndarray:
        """kn of the contact law. Radii in m, any shape; N/m."""
        a, b = cast(np.ndarray, radius_a), cast(np.ndarray, radius_b)
        return self.contact_law.normal_stiffness(self, a, b)

    def tangential_stiffness(self, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """kt of the contact law. Radii in m, any shape; N/m."""
        return self.contact_law.tangential_stiffness(self, radius_a, radius_b)

    def rolling_stiffness(self, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """kr of the contact law. Radii in m, any shape; N m."""
        return self.contact_law.rolling_stiffness(self, radius_a, radius_b)

    def normal_force(self, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray) -> np.ndarray:
        """Elastic normal force of the contact law. Radii and overlaps in m, any shape; N, compression positive."""
        return self.contact_law.normal_force(self, radius_a, radius_b, overlap)

    @overload
    def mass(self, radius: float) -> float: ...

    @overload
    def mass(self, radius: np.ndarray) -> np.ndarray: ...

    def mass(self, radius: np.ndarray | float) -> np.ndarray | float:
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
        """Time step of a test, s: `time_step_factor` sqrt(m/kn) (sqrt(1 + zeta^2) - zeta).

        zeta is the damping ratio of the stiffest mode, 0 without dashpots. With the default factor this is 0.55 to 0.6
        of the stability limit of a dense specimen (labkit.dem.time_step) for both of labkit's laws.
        """
        zeta = self.contact_law.damping_ratio(self)
        return self.time_step_factor * self.time_unit * (math.sqrt(1.0 + zeta**2) - zeta)

    def with_friction(self, friction: float, rolling_friction: float) -> Scene:
        """A copy of the scene with another (mu, mu_r)."""
        return dataclasses.replace(self, friction=friction, rolling_friction=rolling_friction)

    def to_json(self) -> str:
        """The scene as JSON, for files."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Scene:
        """The scene from the JSON of a file. Raises InputError if the text is not a scene."""
        try:
            values = json.loads(text)
            if not isinstance(values, dict):
                raise TypeError(f"{text} has no fields")
            return restored(cls, values)
        except InputError:  # a value out of range, or a user-defined law that is not loaded
            raise
        except (TypeError, ValueError) as error:
            raise InputError(f"not a labkit scene: {error}") from None


MADE_WITH = ("mean_diameter", "diameter_spread")  # fixed when the specimen is made; a run cannot change them

_INSTANCES: dict[type, ContactLaw] = {}


def _instance(kind: type[ContactLaw]) -> ContactLaw:
    """The only instance of a law: laws hold no values, so all scenes share it."""
    return _INSTANCES.setdefault(kind, kind())
