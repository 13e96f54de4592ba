"""Parameters of the model (Table 2), interpretations of ambiguous equations (Readings), and Model, which has both."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from typing import ClassVar

import numpy as np

from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.micro.tensors import to_tensor
from labkit.model.constants import Constants
from labkit.model.differentials import stress_rate_of
from labkit.model.equations import stress_of
from labkit.model.law import FUNCTIONS, ConstitutiveLaw, Functions, RateLaw
from labkit.model.rates import model_rates

ROOT_3_2 = math.sqrt(1.5)  # |diag(-1/2, -1/2, 1)|: from the zz component of a triaxial deviator to its norm


@dataclasses.dataclass(frozen=True)
class Parameters:
    """Parameters of Table 2, all dimensionless. A_c, F_c and Ft_c are norms: 0.45 sqrt(3/2) means A_zz = 0.45.

    Raises InputError for a value that is not a number or not positive; the exponents and factors in MAY_BE_ZERO may be
    zero.
    """

    # critical state
    e_cmax: float = 0.76
    c_cZ: float = 5.57
    gamma_cZ: float = 0.7
    c_cLam: float = 0.098
    A_c: float = 0.45 * ROOT_3_2
    F_c: float = 0.77 * ROOT_3_2
    Ft_c: float = 0.045 * ROOT_3_2
    # contact structure
    c_eA: float = 1.0
    gamma_eA: float = 0.65
    beta_dA: float = 35.0
    gamma_A: float = 0.4
    c_eZ: float = 4.96
    beta_eZ: float = 70.0
    c_Z: float = 0.125
    c_com: float = 7.2
    c_vZ: float = 0.3
    beta_vZ: float = 3.0
    # contact forces
    gamma_F: float = 0.2
    gamma_eLam: float = 0.65  # Table 2 calls it gamma_Lambda
    c_eLam: float = 100.0
    c_vLamd: float = 0.075
    c_M: float = 100.0

    def __post_init__(self) -> None:
        """Raises InputError for an invalid value."""
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (isinstance(value, (int, float)) and math.isfinite(value)):
                raise InputError(f"parameter {field.name} is {value!r}: give a finite number")
            if value < 0.0 or (value == 0.0 and field.name not in MAY_BE_ZERO):
                allowed = "0 or more" if field.name in MAY_BE_ZERO else "a positive number"
                raise InputError(f"parameter {field.name} is {value:g}: give {allowed}")


MAY_BE_ZERO = ("gamma_A", "gamma_F", "gamma_eA", "gamma_eLam", "beta_dA", "beta_eZ", "beta_vZ", "c_Z")


@dataclasses.dataclass(frozen=True)
class Readings:
    """Interpretations of ambiguous points in the paper.

    Each default is given with its evidence; the alternative is available to demonstrate that it fails.

    strain_rate: `deviatoric`: |rate| in C1 to C5 is the norm of the deviatoric strain rate, along which A^c, F^c
        and F^tc point; `total`: |rate| is the norm of the total strain rate. Evidence: Eqs. 31 and 32 are fitted to
        isotropic tests, in which only the volumetric terms of C2 and C4 may act; with `total`, isotropic compression
        would also pull Z and Lambda towards their critical values.
    force_rate: `plain`: C4 is f^{e,L} (Lambda^c - Lambda) |rate|; `with_force`: with the additional factor |Lambda|
        that is visible in the scanned paper. Evidence: with Table 2 the factor makes C4 about a hundred times slower,
        so that 60 % axial strain is not enough to reach the critical state of Figs. 4 to 6
        (tests/model/test_readings.py). `distance`: f |Lambda^c - Lambda|^gamma_Lambda (Lambda^c - Lambda) |rate| with
        f = c_eLambda f^{e,Z}, by analogy with C1 and C3; results/model_evidence compares the two.
    compression: `minus`: f^{v,Z} = -exp(...) dZ^com/de (1 + e) in Eq. 31; `as_printed`: without the minus sign;
        `parallel`: with the minus sign and the exponential at most 1 (results/model_benchmark, small strains).
        Evidence: dZ^com/de is negative, and contacts form in compression; as printed they would be lost, and Z would
        no longer tend to the compression line.
    beyond_e_cmax: `error`: the equations hold up to e_cmax, beyond which (e_cmax - e)^0.7 is undefined; `flat`: beyond
        e_cmax Z^c = Z^com = 4 and Lambda^c = 0, one-sided and continuous. Evidence: Figs. 8 to 10 start at e0 = 0.77,
        beyond e_cmax = 0.76, so the authors' code must have handled this case; above the critical state line a sheared
        specimen loses its pressure, which corresponds to Lambda^c = 0, and Z^c cannot fall below 4, its value at zero
        force. A linear continuation would make Lambda^c negative and Z^c complex. `flat` is not the default, because
        it is not in the paper.
    line_void_ratio: `nominal`: e in Z^c, Z^com and Lambda^c is V/sum(pi D^3/6) - 1, as in C0; `reported`: the overlap
        lenses are taken out of the solid volume, as in the void ratio that the paper reports, by which Table 2 may have
        been fitted. Evidence: the two differ by 4 % of Lambda^c at 3 MPa; results/model_evidence compares them.
    """

    strain_rate: str = "deviatoric"
    force_rate: str = "plain"
    compression: str = "minus"
    beyond_e_cmax: str = "error"
    line_void_ratio: str = "nominal"

    def __post_init__(self) -> None:
        """Raises InputError for an unknown option."""
        for name, choices in READINGS.items():
            if getattr(self, name) not in choices:
                raise InputError(
                    f"option {name} of the model is {getattr(self, name)!r}: use one of {', '.join(choices)}"
                )


@dataclasses.dataclass(frozen=True)
class LodeDependence:
    """How the attractors depend on the Lode angle theta of the strain rate; zero, the default, is the paper's model.

    A^c, F^c and F^tc have the norms A_c, F_c, Ft_c in compression and 1 - 2b times these in extension, and w rotates
    their Lode angles in between (labkit.model.equations.attractor). e_cmax grows by d_e x^2, x = (1 - cos 3 theta)/2.
    Evidence: results/model_benchmark, from which MEASURED is taken. Raises InputError for a value that is not between
    -0.5 and 0.5.
    """

    A_b: float = 0.0
    A_w: float = 0.0
    F_b: float = 0.0
    F_w: float = 0.0
    Ft_b: float = 0.0
    Ft_w: float = 0.0
    d_e: float = 0.0

    def __post_init__(self) -> None:
        """Raises InputError for a value out of range."""
        _require_within(self, 0.5)


@dataclasses.dataclass(frozen=True)
class DensityDependence:
    """How the attractors depend on density; zero, the default, is the paper's model.

    A^c and F^tc are multiplied by 1 + A_Z (Z^c - 4) and 1 + Ft_Z (Z^c - 4), so that A_c and Ft_c apply at e_cmax. F^c
    is multiplied by the power 1 - F_d of f^{d,A}, and F^tc, constant in the paper, by the power Ft_d. Evidence:
    results/model_benchmark. Raises InputError for a value that is not between -1 and 1.
    """

    A_Z: float = 0.0
    Ft_Z: float = 0.0
    F_d: float = 0.0
    Ft_d: float = 0.0

    def __post_init__(self) -> None:
        """Raises InputError for a value out of range."""
        _require_within(self, 1.0)


@dataclasses.dataclass(frozen=True)
class Reversals:
    """Terms for reversals and rotation of the strain rate; K_F = 0, the default, is the paper's model.

    With K_F > 0, dF/dt = K_F (Z - Z_F) (n - max(0, F:n)/F_c F/F_c) |rate| replaces C3, so that F is stiff after a
    reversal, and the first term of C4 is multiplied by A:n/A_c, so that grains contract after a reversal. F has no
    stiffness at the coordination number Z_F. Here F_c = F_0 + F_e e and A_c = A_0 + A_e e, at least 0.1.
    Evidence: results/hidden_state, from which MEASURED_REVERSALS is taken. It holds for dense and medium grains; in
    loose ones (e above about 0.75) the volume is better without. Raises InputError for a number that is not finite, and
    for a negative K_F or Z_F.
    """

    K_F: float = 0.0
    Z_F: float = 0.0
    F_0: float = 0.0
    F_e: float = 0.0
    A_0: float = 0.0
    A_e: float = 0.0

    def __post_init__(self) -> None:
        """Raises InputError for a value out of range."""
        for name, value in vars(self).items():
            if not math.isfinite(value):
                raise InputError(field=name, value=value, allowed="a finite number")
            if value < 0.0 and name in ("K_F", "Z_F"):
                raise InputError(field=name, value=value, allowed="0 (the paper's model) or a positive number")


def _require_within(numbers: LodeDependence | DensityDependence, bound: float) -> None:
    for name, value in vars(numbers).items():
        if not -bound < value < bound:
            raise InputError(field=name, value=value, allowed=f"a number between {-bound:g} and {bound:g}")


READINGS = {
    "strain_rate": ("deviatoric", "total"),
    "force_rate": ("plain", "with_force", "distance"),
    "compression": ("minus", "as_printed", "parallel"),
    "beyond_e_cmax": ("error", "flat"),
    "line_void_ratio": ("nominal", "reported"),
}


FLOOR = np.full(27, 0.1)  # the error of a smaller component is relative to this value, not to the component
FLOOR[2] = 1e-4  # Lambda is 1e-3 to 1e-2


@dataclasses.dataclass(frozen=True)
class Model(ConstitutiveLaw):
    """The constitutive model: its parameters, its interpretations of the paper, and Young's modulus.

    Args:
        parameters: Parameters of Table 2.
        readings: Interpretations of the paper.
        young_modulus: Young's modulus E of the grains, Pa.
        c_dLam: Coefficient of an amendment, the term c_dLam Lambda (X - X^c):n |rate| in C4, with X = 2/5 A + 2/5 F +
            3 F^t, the stress ratio of Eq. 30. Zero, the default, gives the paper's model; see results/model_evidence.
        lode: Dependence of the attractors on the Lode angle, which is not in the paper either.
        density: Further dependence of the attractors on density, which is not in the paper.
        reversals: Terms for reversals and rotation of the strain rate, which are not in the paper.
    """

    name: ClassVar[str] = "labkit"
    leading: ClassVar[tuple[str, ...]] = ("e", "Z", "Lambda")
    parameters: Parameters = Parameters()
    readings: Readings = Readings()
    young_modulus: float = Scene().young_modulus
    c_dLam: float = 0.0
    lode: LodeDependence = LodeDependence()
    density: DensityDependence = DensityDependence()
    reversals: Reversals = Reversals()

    def __post_init__(self) -> None:
        """Raises InputError for a modulus that is not positive, or a negative c_dLam."""
        if not (math.isfinite(self.c_dLam) and self.c_dLam >= 0.0):
            raise InputError(field="c_dLam", value=self.c_dLam, allowed="0 (the paper's model) or a positive number")
        if not (math.isfinite(self.young_modulus) and self.young_modulus > 0.0):
            raise InputError(f"Young's modulus is {self.young_modulus}: give a positive number in Pa")

    @functools.cached_property
    def constants(self) -> Constants:
        """Constants for compiled code."""
        parts, readings = (self.parameters, self.lode, self.density, self.reversals), self.readings
        return Constants(
            E=float(self.young_modulus),
            **{name: float(value) for part in parts for name, value in vars(part).items()},
            c_dLam=float(self.c_dLam),
            total_rate=readings.strain_rate == "total",
            with_force=readings.force_rate == "with_force",
            distance=readings.force_rate == "distance",
            as_printed=readings.compression == "as_printed",
            flat=readings.beyond_e_cmax == "flat",
            reported=readings.line_void_ratio == "reported",
            parallel=readings.compression == "parallel",
        )

    def variables(self, vector: np.ndarray, stress: np.ndarray) -> dict[str, np.ndarray]:
        e, Z, Lam = (vector[..., k] for k in range(3))
        A, F, Ft, strain = (to_tensor(vector[..., k : k + 6]) for k in (3, 9, 15, 21))
        return {
            "axial_strain": vector[..., 23],
            "strain": strain,
            "stress": stress,
            "void_ratio": e,
            "void_ratio_nominal": e,
            "coordination_number": Z,
            "mean_normalised_force": Lam,
            "contact_anisotropy": A,
            "normal_force_anisotropy": F,
            "mobilisation": Ft,
        }

    def require_start(self, y: np.ndarray) -> None:
        self.require_density(float(y[0]))
        for value, label in ((y[1], "coordination number"), (y[2], "mean normalised force")):
            if value <= 0.0:
                raise InputError(
                    f"the initial {label} is 0: a path needs contacts that carry force; give a larger value"
                )

    def require_density(self, void_ratio: float) -> None:
        """Raise InputError if the equations are undefined at this void ratio."""
        limit = self.parameters.e_cmax
        if void_ratio >= limit and self.readings.beyond_e_cmax == "error":
            raise InputError(
                f"void ratio {void_ratio:g} is not below e_cmax = {limit:g}, where the critical state is undefined: "
                "use a denser state, or set beyond_e_cmax = flat (--beyond-e-cmax flat), which continues with Z^c = 4 "
                "and Lambda^c = 0, as needed for Fig. 8"
            )

    def floor(self, y: np.ndarray) -> np.ndarray:
        return FLOOR

    def with_parameters(self, **changes: float) -> Model:
        """Return a copy of the model with the named Parameters changed. Raises InputError for invalid values."""
        return dataclasses.replace(self, parameters=dataclasses.replace(self.parameters, **changes))

    def reading(self, **changes: str) -> Model:
        """Return a copy of the model with the named Readings changed. Raises InputError for unknown values."""
        return dataclasses.replace(self, readings=dataclasses.replace(self.readings, **changes))

    def to_json(self) -> str:
        """Return the model as JSON: parameters, readings, young_modulus, c_dLam, lode, density, reversals."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Model:
        """Return the model written by `to_json`. Raises InputError if the text is not a model."""
        try:
            values = json.loads(text)
            parameters, readings = Parameters(**values["parameters"]), Readings(**values["readings"])
            lode = LodeDependence(**values.get("lode", {}))
            density, reversals = values.get("density", {}), values.get("reversals", {})
            further = lode, DensityDependence(**density), Reversals(**reversals)
            return cls(parameters, readings, values["young_modulus"], values.get("c_dLam", 0.0), *further)
        except (TypeError, ValueError, KeyError) as error:
            raise InputError(f"these are not the parameters of a model: {error}") from None


MEASURED = LodeDependence(A_b=-0.041, A_w=0.026, F_b=0.045, F_w=0.095, Ft_b=0.113, Ft_w=0.056, d_e=0.017)
MEASURED_REVERSALS = Reversals(K_F=46.471, Z_F=2.5728, F_0=2.9602, F_e=-2.8248, A_0=3.9689, A_e=-4.5714)
TABLE_2 = Model()  # Table 2 with the default interpretations

FUNCTIONS[Constants] = Functions(model_rates, stress_of, stress_rate_of, RateLaw.settle)
