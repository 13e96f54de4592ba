"""PROPS of the user material: the constants of a model in the order that the Fortran source expects."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.errors import InputError
from labkit.model.parameters import Model, Parameters
from labkit.parameters import check_parameters, parameter

COMPONENTS = ("11", "22", "33", "12", "13", "23")
STATE_NAMES = ("e", "Z", "Lambda", *(tensor + component for tensor in ("A", "F", "Ft") for component in COMPONENTS))
FLAGS = ("strain_rate", "force_rate", "compression", "beyond_e_cmax")  # names of the first flags of Constants
TOLERANCE = 1e-4  # tolerance of a substep, the default of labkit.plugins.umat.material_point.update


@dataclasses.dataclass(frozen=True)
class PointStart:
    """Initial state of points for which the finite-element program specifies none; None if it is not given.

    If the program specifies an initial stress, this stress replaces the pressure.
    """

    void_ratio: float | None = parameter(None, above=0.0, help="initial void ratio of points without a state")
    pressure: float | None = parameter(
        None, unit="Pa", above=0.0, help="initial isotropic pressure of points without an initial stress"
    )

    def __post_init__(self) -> None:
        """Check every parameter. Raises InputError."""
        check_parameters(self)


def properties(
    model: Model, start: PointStart | None = None, tolerance: float = TOLERANCE, stress_unit: float = 1.0
) -> dict[str, float]:
    """Return PROPS by name, in order: E, Table 2, the readings (0 or 1), tolerance, initial void ratio and pressure.

    LodeDependence, c_dLam, the other readings, DensityDependence and Reversals follow if any differs from the paper's
    model.

    Raises InputError for a tolerance or unit that is not positive.

    Args:
        model: The model.
        start: Initial state of points for which the program specifies none.
        tolerance: Relative error of a substep.
        stress_unit: Unit of stress of the analysis, Pa, e.g. 1e3 for kPa; E and the pressure are divided by this unit.
    """
    if not 1e-12 <= tolerance <= 1.0:
        raise InputError(field="tolerance", value=tolerance, allowed="a number from 1e-12 to 1")
    if not (np.isfinite(stress_unit) and stress_unit > 0.0):
        raise InputError(field="stress_unit", value=stress_unit, allowed="a positive number of Pa, e.g. 1e3 for kPa")
    start = start or PointStart()
    flags = {name: float(value) for name, value in model.constants._asdict().items() if isinstance(value, bool)}
    later = {name: flags.pop(name) for name in ("distance", "reported", "parallel")}
    optional = {**dataclasses.asdict(model.lode), "c_dLam": model.c_dLam, **later}
    optional |= dataclasses.asdict(model.density) | dataclasses.asdict(model.reversals)
    return {
        "E": model.young_modulus / stress_unit,
        **{field.name: float(getattr(model.parameters, field.name)) for field in dataclasses.fields(Parameters)},
        **dict(zip(FLAGS, flags.values(), strict=True)),
        "tolerance": tolerance,
        "initial_void_ratio": start.void_ratio or 0.0,
        "initial_pressure": (start.pressure or 0.0) / stress_unit,
        **(optional if any(optional.values()) else {}),
    }
