"""The scene: material, grading, contact law and time-step rule (Table 1)."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from labkit.errors import InputError, as_typed
from labkit.grains.grading import Grading, Uniform, read_grading
from labkit.grains.laws import LAWS, ContactLaw
from labkit.grains.laws.parts import PARAMETERS
from labkit.parameters import Keys, Number, Values, check_parameters, parameter, parameters_of, without_option
from labkit.text.html import html_table

Size = TypeVar("Size", float, np.ndarray)


@dataclasses.dataclass(frozen=True)
class Scene:
    """Immutable description of the grains and their contacts. SI units; the defaults are those of Table 1.

    `law = "rolling_resistance"` is YADE's rolling-resistance law. It differs from Eqs. 1-3 of the paper in three
    important ways:

    * no dashpots: energy is dissipated by Newton's local non-viscous damping, `local_damping`;
    * rolling stiffness kt Ra Rb/4 instead of kt (Ra Rb/(Ra + Rb))^2: the same for equal grains, up to 4.2 % higher for
      a size ratio of up to 1.5;
    * rolling limit mu_r min(Ra, Rb)/2 instead of mu_r Ra Rb/(Ra + Rb): the same for equal grains, up to 16.7 % lower
      for a size ratio of up to 1.5, and 6 % lower on average over random pairs. `rolling_limit_scale` multiplies it:
      with 1.064 the mean over random pairs of +-20 % equals the paper's.

    Two further differences come from YADE's kinematics: it multiplies the relative shear velocity by
    1/(1 - delta/(Ra + Rb)) to avoid ratcheting, and rotates the tangential forces with their contact to first order
    only, so during a run they leave the tangent plane by about 1e-3 of their magnitude.

    `law = "spring_dashpot"` is Eqs. 1-3: dashpots `beta_n` and `beta_t`, kr = kt r*^2, |M| <= mu_r r* fn, and no local
    damping. The engine `yade` does not support it. The limits apply to the springs, with fn = kn delta. The dashpots
    act in parallel, so a separating pair may be in tension for an instant. Records and stresses contain the spring
    forces, which follow from a State; the work done on the cell includes the dashpots.

    `law = "springs_in_series"` is spring_dashpot with the stiffness of PFC, pi E min(Ra, Rb)^2/(Ra + Rb); only the
    engine `fused` supports it. `law = "hertz_mindlin"` is YADE's Hertz-Mindlin law without rolling resistance, with
    local damping; `hertz_mindlin_rolling` adds rolling resistance, and `hertz_mindlin_dashpot` has YADE's dashpots
    instead of local damping. In these laws `young_modulus` and `poisson_ratio` are the elastic constants of the grains.
    labkit.grains.laws.tangential derives the energy of these contacts. `hertz_mindlin_rescaled` has local damping and
    reduces the tangential force when the normal force falls, so no energy is created.

    With rolling resistance, `twisting_friction` > 0 adds the same spring and limit about the contact
    normal. In spring_dashpot and springs_in_series, `limits = "forces"` applies the limits of Eqs. 2 and 3 to |ft| and
    |fn| including the dashpot forces, which is another reading of these equations.

    The grains of a `planar` scene move in planes y = const, rotate only about y and represent discs: whatever
    the grain sizes, kn is the stiffness of two grains of mean diameter, so coarse and fine layers differ only in
    scale.

    `grading` is a text or a CSV file that describes a different size distribution (labkit.grains.grading).
    `mean_diameter` is then the mean of this distribution by number, and `diameter_spread` has no effect.

    `law = "dmt"`, `"jkr"`, `"bonded"` and `"capillary"` add adhesion, bonds and liquid bridges, with local damping
    (labkit.grains.laws.cohesion and bond; docs/cohesion.md).

    `law` may also be user-defined (labkit.ContactLaw). Raises InputError for a value outside its physical range.
    """

    mean_diameter: Number[float] = parameter(
        0.17e-3, unit="m", low=1e-9, high=1e3, help="mean diameter D of the grains"
    )
    diameter_spread: Number[float] = parameter(
        0.2, low=0.0, high=0.9, help="half-width of the uniform distribution of diameters, divided by D"
    )
    density: Number[float] = parameter(2650.0, unit="kg/m3", low=1e-3, high=1e9, help="density rho of the grains")
    young_modulus: Number[float] = parameter(
        0.15e9, unit="Pa", low=1.0, high=1e15, help="Young's modulus E of the contacts"
    )
    stiffness_ratio: Number[float] = PARAMETERS["stiffness_ratio"]
    friction: Number[float] = PARAMETERS["friction"]
    rolling_friction: Number[float] = PARAMETERS["rolling_friction"]
    rolling_limit_scale: Number[float] = PARAMETERS["rolling_limit_scale"]
    local_damping: Number[float] = PARAMETERS["local_damping"]
    time_step_factor: Number[float] = parameter(
        0.2, low=1e-6, high=10.0, help="time step divided by sqrt(m/kn) of the mean grain"
    )
    law: str = parameter("rolling_resistance", choices=LAWS, help="contact law")
    planar: bool = without_option(parameter(False, help="discs in a plane instead of spheres"))
    beta_n: Number[float] = PARAMETERS["beta_n"]
    beta_t: Number[float] = PARAMETERS["beta_t"]
    poisson_ratio: Number[float] = PARAMETERS["poisson_ratio"]
    twisting_friction: float = PARAMETERS["twisting_friction"]
    limits: str = PARAMETERS["limits"]
    adhesion_energy: float = PARAMETERS["adhesion_energy"]
    bond_modulus: Number[float] = PARAMETERS["bond_modulus"]
    bond_radius: float = PARAMETERS["bond_radius"]
    bond_strength: Number[float] = PARAMETERS["bond_strength"]
    bond_shear_strength: Number[float] = PARAMETERS["bond_shear_strength"]
    surface_tension: float = PARAMETERS["surface_tension"]
    contact_angle: float = PARAMETERS["contact_angle"]
    bridge_volume: float = PARAMETERS["bridge_volume"]
    grading: str | None = parameter(
        None,
        kind=str,
        help="size distribution, e.g. `lognormal median=0.2mm sigma=0.3 smallest=0.1mm largest=0.5mm`, "
        "`sieve diameters=0.1mm,0.2mm,0.3mm passing=0,0.55,1`, uniform, rosin_rammler, or a CSV file of a sieve curve "
        "(default: uniform about mean_diameter)",
    )

    parameters: tuple[tuple[str, object], ...] = ()  # name and value of the parameters of the law's user-defined parts

    def __post_init__(self) -> None:
        """Check every parameter."""
        check_parameters(self)
        law, further = self.contact_law.parameters, dict(self.parameters)
        rows = {name: row for name, row in law.items() if name not in PARAMETERS}
        values = tuple((name, row.read(further.pop(name, row.default))) for name, row in rows.items())
        object.__setattr__(self, "parameters", values)
        unused = {name: getattr(self, name) for name in PARAMETERS.keys() - law.keys()}
        for name, value in sorted({**unused, **further}.items()):
            if name in further or value not in (getattr(Scene, name), 0.0):
                raise _unused(name, value, self.law)
        if self.grading is None:
            return
        grading = read_grading(self.grading)
        if self.mean_diameter not in (Scene.mean_diameter, grading.mean_diameter):
            allowed = f"no mean diameter with a grading, which has {grading.mean_diameter:.6g} m"
            raise InputError(field="mean_diameter", value=self.mean_diameter, allowed=allowed)
        object.__setattr__(self, "grading", grading.to_text())
        object.__setattr__(self, "mean_diameter", grading.mean_diameter)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Return a parameter of the law's user-defined parts, as if it were a field."""
            for parameter, value in self.__dict__.get("parameters", ()):
                if parameter == name:
                    return value
            raise AttributeError(f"Scene has no {name}")

    @staticmethod
    def further_parameters() -> Keys:
        """Return the parameters of the user-defined parts of all laws, name -> Parameter."""
        laws = (_instance(LAWS[name]).parameters.items() for name in LAWS)
        return {name: parameter for law in laws for name, parameter in law if name not in PARAMETERS}

    @property
    def sizes(self) -> Grading:
        """The distribution of diameters; a spread of 0 gives it a width of 1e-9 of the mean."""
        if self.grading is not None:
            return read_grading(self.grading)
        low, high = ((1.0 + s * max(self.diameter_spread, 1e-9)) * self.mean_diameter for s in (-1.0, 1.0))
        return Uniform(smallest=low, largest=high)

    @property
    def of_the_paper(self) -> bool:
        """True for grain sizes, friction and a law of the paper, for which the strength is known (Tables 1 and 2)."""
        same = all(getattr(self, name) == getattr(Scene, name) for name in (*MADE_WITH, "friction", "rolling_friction"))
        return same and not self.planar and self.law in ("rolling_resistance", "spring_dashpot", "springs_in_series")

    @property
    def blocked_motions(self) -> str:
        """Blocked components of grain motion: displacements in lower case, rotations in upper case."""
        return "yXZ" if self.planar else ""

    def elastic_radii(self, radius_a: np.ndarray, radius_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the radii (m) that determine the normal stiffness: the given radii, or for discs the mean radius."""
        if not self.planar:
            return radius_a, radius_b
        mean = np.full_like(radius_a + radius_b, 0.5 * self.mean_diameter)
        return mean, mean

    @property
    def contact_law(self) -> ContactLaw:
        """The ContactLaw named `law`."""
        return _instance(LAWS[self.law])

    def normal_stiffness(self, radius_a: np.ndarray | float, radius_b: np.ndarray | float) -> np.ndarray:
        """Return the stiffness kn (N/m) of the contact law; radii in m, any shape."""
        a, b = cast(np.ndarray, radius_a), cast(np.ndarray, radius_b)
        return self.contact_law.normal_stiffness(self, a, b)

    def tangential_stiffness(self, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Return the stiffness kt (N/m) of the contact law; radii in m, any shape."""
        return self.contact_law.tangential_stiffness(self, radius_a, radius_b)

    def rolling_stiffness(self, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Return the stiffness kr (N m) of the contact law; radii in m, any shape."""
        return self.contact_law.rolling_stiffness(self, radius_a, radius_b)

    def mass(self, radius: Size) -> Size:
        """Return the mass (kg) of a spherical grain; radius in m, any shape."""
        return self.density * (4.0 / 3.0) * np.pi * radius**3

    def moment_of_inertia(self, radius: np.ndarray) -> np.ndarray:
        """Return the moment of inertia 2/5 m R^2 (kg m2) of a spherical grain; radius in m, any shape."""
        return 0.4 * self.mass(radius) * radius**2

    @property
    def time_unit(self) -> float:
        """sqrt(m/kn), in s, of two grains of mean diameter.

        kn of a nonlinear law is the tangent at REFERENCE_OVERLAP.
        """
        radius = self.mean_diameter / 2
        return self._period(radius, radius)

    def _period(self, radius: float, other: float) -> float:
        """Return sqrt(m/kn), in s, of a grain in contact with another grain."""
        overlap = 4.0 * REFERENCE_OVERLAP * radius * other / (radius + other)
        kn = self.contact_law.tangents(self, *np.array([radius, other, overlap])).normal
        return float(np.sqrt(self.mass(radius) / kn))

    @property
    def time_step(self) -> float:
        """Time step of a test (s): `time_step_factor` T (sqrt(1 + zeta^2) - zeta).

        T is sqrt(m/kn) of the mean grain or, for a grading wider than in Table 1, sqrt(m/kn)/STIFFEST of the smallest
        grain in contact with the largest. zeta is the damping ratio of the stiffest mode, 0 without dashpots.
        With the default factor the time step is 0.5 to 0.7 of the stability limit of a dense specimen
        (labkit.grains.time_step).
        """
        zeta = self.contact_law.damping_ratio(self)
        period = self.time_unit
        if not self.planar and self.size_ratio > PAPER_RATIO:
            radii = 0.5 * self.sizes.smallest, 0.5 * self.sizes.largest
            period = min(period, self._period(*radii) / STIFFEST)
        return self.time_step_factor * period * (math.sqrt(1.0 + zeta**2) - zeta)

    @property
    def size_ratio(self) -> float:
        """Largest divided by smallest diameter."""
        if self.grading is None:
            return (1.0 + self.diameter_spread) / (1.0 - self.diameter_spread)
        return self.sizes.largest / self.sizes.smallest

    def replace(self, **changes: Any) -> Scene:
        """Return a copy with some parameters changed; parameters that its law does not use are reset to their defaults.

        Raises InputError for a change that the contact law does not use.
        """
        values = {**self.values(), "law": changes.get("law", self.law)}
        for name, _ in self.parameters if values["law"] != self.law else ():
            del values[name]
        return Scene(**{**used_parameters(values), **changes})

    def with_friction(self, friction: float, rolling_friction: float) -> Scene:
        """Return a copy of the scene with other friction coefficients mu and mu_r, if its contact law uses them."""
        values = {"law": self.law, "friction": friction, "rolling_friction": rolling_friction}
        return self.replace(**used_parameters(values))

    def _repr_html_(self) -> str:
        """Return a table of the parameters that the contact law uses, for notebooks."""
        parameters = {**parameters_of(Scene), **self.contact_law.parameters}
        used = used_parameters(self.values()).items()
        rows = {name: f"{as_typed(value)} {parameters[name].unit}".removesuffix(" 1") for name, value in used}
        return html_table("Scene", rows)

    def to_json(self) -> str:
        """Return the scene as JSON text, as stored in files."""
        return json.dumps(self.values())

    def identity(self) -> dict[str, object]:
        """Return the values that identify the scene in the hash of a specimen.

        Parameters added in later versions of labkit are included only if they differ from their defaults.
        """
        later = parameters_of(Scene).keys() - FIRST
        return {
            name: value for name, value in self.values().items() if name not in later or value != getattr(Scene, name)
        }

    def values(self) -> Values:
        """Return the parameters, name -> value in SI units; those of user-defined parts come last."""
        return {**{name: getattr(self, name) for name in parameters_of(Scene)}, **dict(self.parameters)}

    @classmethod
    def from_json(cls, text: str) -> Scene:
        """Return the scene from the JSON of a file. Raises InputError if the text is not a scene."""
        try:
            values = json.loads(text)
            if not isinstance(values, dict):
                raise TypeError(f"{text} has no fields")
            if values.get("law") in FIRST_NAMES:
                values["law"] = FIRST_NAMES[values["law"]]
            return cls(**used_parameters(values))
        except InputError:  # a value out of range, or a user-defined law that is not loaded
            raise
        except (TypeError, ValueError) as error:
            raise InputError(f"not a labkit scene: {error}") from None


def _takes_parameters(kind: type[Scene]) -> None:
    """Let the constructor take the parameters of user-defined parts by keyword, as if they were fields."""
    of_fields = kind.__init__

    @functools.wraps(of_fields)
    def __init__(self: Scene, *values: Any, parameters: Iterable[tuple[str, object]] = (), **named: Any) -> None:
        further = {name: named.pop(name) for name in [*named] if name not in kind.__dataclass_fields__}
        named["parameters"] = tuple({**dict(parameters), **further}.items())
        of_fields(self, *values, **named)

    type.__setattr__(kind, "__init__", __init__)


_takes_parameters(Scene)
FIRST = {
    *("mean_diameter", "diameter_spread", "density", "young_modulus", "stiffness_ratio", "friction", "law", "planar"),
    *("rolling_friction", "rolling_limit_scale", "local_damping", "time_step_factor", "beta_n", "beta_t"),
}  # in the hashes of the first files
FIRST_NAMES = {"yade": "rolling_resistance", "paper": "spring_dashpot"}  # names of laws in the runs of results/paper
STIFFEST = 0.73  # sqrt(m/kn) of the smallest grain touching the largest / sqrt(m/kn) of the mean grain, Table 1
PAPER_RATIO = 1.5 * (1.0 + 1e-9)  # ratio of the largest to the smallest diameter in Table 1
REFERENCE_OVERLAP = 0.02  # delta/D, the largest mean overlap of section 2

MADE_WITH = ("mean_diameter", "diameter_spread", "grading")  # fixed with the specimen; a run cannot change them

_INSTANCES: dict[type, ContactLaw] = {}


def used_parameters(values: Mapping[str, object]) -> Values:
    """Return the parameters that the law in `values` uses, name -> value. Raises InputError for an unknown law."""
    used = _instance(LAWS.require(str(values.get("law", Scene.law)), "law")).parameters
    return {name: value for name, value in values.items() if name in used or name not in PARAMETERS}


def _unused(name: str, value: object, law: str) -> Exception:
    """Return the error for a parameter that the contact law `law` does not use."""
    laws = [other for other in LAWS if name in _instance(LAWS[other]).parameters]
    if not laws:
        return TypeError(f"Scene() got an unexpected keyword argument {name!r}")
    problem = f"is not used by the contact law {law}"
    return InputError(problem, field=name, value=value, allowed=f"none, or a law that uses it: {', '.join(laws)}")


def _instance(kind: type[ContactLaw]) -> ContactLaw:
    """Return the only instance of a law, which all scenes share because laws store no values."""
    return _INSTANCES.setdefault(kind, kind())
