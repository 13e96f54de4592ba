"""Parameters of the model (Table 2), the readings of what is ambiguous in print, and both with E as a Model."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from typing import NamedTuple

from labkit.dem.scene import Scene
from labkit.errors import InputError

ROOT_3_2 = math.sqrt(1.5)  # |diag(-1/2, -1/2, 1)|: from the zz component of a triaxial deviator to its norm


@dataclasses.dataclass(frozen=True)
class Parameters:
    """Table 2. A_c, F_c and Ft_c are norms: 0.45 sqrt(3/2) is A_zz = 0.45. All are dimensionless.

    Raises InputError for a value that is not a number or not positive (gamma_A, gamma_F, beta_* and c_Z may be zero).
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
        """Raises InputError for a value that is not possible."""
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (isinstance(value, (int, float)) and math.isfinite(value)):
                raise InputError(f"parameter {field.name} is {value!r}: give a finite number")
            if value < 0.0 or (value == 0.0 and field.name not in MAY_BE_ZERO):
                what = "0 or more" if field.name in MAY_BE_ZERO else "a positive number"
                raise InputError(f"parameter {field.name} is {value:g}: give {what}")


MAY_BE_ZERO = ("gamma_A", "gamma_F", "gamma_eA", "gamma_eLam", "beta_dA", "beta_eZ", "beta_vZ", "c_Z")


@dataclasses.dataclass(frozen=True)
class Readings:
    """How to read what the print leaves open. Each default with its evidence; the other value is there to see it fail.

    strain_rate: `deviatoric`: |rate| in C1 to C5 is the norm of the deviatoric strain rate, along which A^c, F^c
        and F^tc point; `total`: the norm of the whole strain rate multiplies C1 to C5. Evidence: Eqs. 31 and 32 are
        fitted to isotropic tests, in which C2 and C4 must leave the volumetric terms alone; with `total` an isotropic
        compression would also pull Z and Lambda to their critical values.
    force_rate: `plain`: C4 is f^{e,L} (Lambda^c - Lambda) |rate|; `with_force`: the factor |Lambda| that the scan
        shows. Evidence: with Table 2 the factor makes C4 about a hundred times slower, so that 60 % of axial
        strain do not reach the critical state which Figs. 4 to 6 reach (tests/model/test_readings.py).
    compression: `minus`: f^{v,Z} = -exp(...) dZ^com/de (1 + e) in Eq. 31; `as_printed`: without the sign. Evidence:
        dZ^com/de is negative, and contacts are gained in compression; as printed they are lost, and no longer
        tend to the compression line.
    beyond_e_cmax: `error`: the equations end at e_cmax, where (e_cmax - e)^0.7 ends to have a value; `flat`: there
        Z^c = Z^com = 4 and Lambda^c = 0, one-sided and continuous. Evidence: Figs. 8 to 10 start at e0 = 0.77,
        beyond e_cmax = 0.76, so that the authors' code went on somehow; above the critical state line a sheared
        specimen loses its pressure, which is Lambda^c = 0, and Z^c cannot fall below its value at zero force, 4.
        A linear continuation would make Lambda^c negative and Z^c complex. It is not the default, because it is
        no equation of the paper.
    """

    strain_rate: str = "deviatoric"
    force_rate: str = "plain"
    compression: str = "minus"
    beyond_e_cmax: str = "error"

    def __post_init__(self) -> None:
        """Raises InputError for an unknown reading."""
        for name, choices in READINGS.items():
            if getattr(self, name) not in choices:
                raise InputError(f"reading {name} is {getattr(self, name)!r}: use one of {', '.join(choices)}")


READINGS = {
    "strain_rate": ("deviatoric", "total"),
    "force_rate": ("plain", "with_force"),
    "compression": ("minus", "as_printed"),
    "beyond_e_cmax": ("error", "flat"),
}

Constants = NamedTuple(
    "Constants",
    [
        ("E", float),
        *((field.name, float) for field in dataclasses.fields(Parameters)),
        *((name, bool) for name in ("total_rate", "with_force", "as_printed", "flat")),
    ],
)
Constants.__doc__ = "What compiled code takes: E in Pa, the parameters, and whether each reading is its second value."


@dataclasses.dataclass(frozen=True)
class Model:
    """Everything that is constant: parameters, readings and the modulus E of the grains, Pa."""

    parameters: Parameters = Parameters()
    readings: Readings = Readings()
    young_modulus: float = Scene().young_modulus

    def __post_init__(self) -> None:
        """Raises InputError for a modulus that is not positive."""
        if not (math.isfinite(self.young_modulus) and self.young_modulus > 0.0):
            raise InputError(f"Young's modulus is {self.young_modulus}: give a positive number in Pa")

    @functools.cached_property
    def constants(self) -> Constants:
        """The Constants of compiled code."""
        second = [getattr(self.readings, name) == choices[1] for name, choices in READINGS.items()]
        values = (float(value) for value in dataclasses.astuple(self.parameters))
        return Constants(float(self.young_modulus), *values, *second)

    def with_parameters(self, **changes: float) -> Model:
        """The model with other values of some Parameters, by name. Raises InputError."""
        return dataclasses.replace(self, parameters=dataclasses.replace(self.parameters, **changes))

    def reading(self, **changes: str) -> Model:
        """The model with other Readings, by name. Raises InputError."""
        return dataclasses.replace(self, readings=dataclasses.replace(self.readings, **changes))

    def to_json(self) -> str:
        """The model as JSON: parameters, readings and young_modulus."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Model:
        """The model of `to_json`. Raises InputError if the text is not a model."""
        try:
            found = json.loads(text)
            return cls(Parameters(**found["parameters"]), Readings(**found["readings"]), found["young_modulus"])
        except (TypeError, ValueError, KeyError) as error:
            raise InputError(f"not the parameters of a model: {error}") from None
