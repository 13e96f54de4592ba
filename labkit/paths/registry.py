"""Registry of loading paths: classes in the modules of this package, and classes that users register."""

from __future__ import annotations

import dataclasses
from typing import TypeVar

import numpy as np

from labkit.errors import InputError
from labkit.extensions import Registry, require_subclass
from labkit.parameters import Values, parameters_of
from labkit.paths.path import Path, require_direction

_TESTS, _RELOADING, _CYCLES = (f"labkit.paths.{name}:" for name in ("element_tests", "stress_reversals", "cycles"))
Kind = TypeVar("Kind", bound=Path)
PATHS = Registry[type[Path]](
    "path",
    {
        "cv": "labkit.paths.standard:ConstantVolume",
        "cr": "labkit.paths.standard:ConstantRadialStress",
        "cp": "labkit.paths.standard:ConstantMeanStress",
        "isoc": "labkit.paths.standard:IsotropicCompression",
        "isod": "labkit.paths.standard:IsotropicDilation",
        "cyclic_cp": "labkit.paths.standard:CyclicConstantMeanStress",
        "c1": _TESTS + "ConstantAxialStress",
        "true_triaxial": _TESTS + "TrueTriaxial",
        "plane_strain": _TESTS + "PlaneStrain",
        "oedometer": _TESTS + "Oedometer",
        "simple_shear": _TESTS + "SimpleShear",
        "simple_shear_cv": _TESTS + "SimpleShearConstantVolume",
        "stress_rotation": _TESTS + "StressRotation",
        "proportional": _TESTS + "ProportionalStrain",
        "mixed": _TESTS + "Mixed",
        "isotropic_reloading": _RELOADING + "IsotropicReloading",
        "oedometer_reloading": _RELOADING + "OedometerReloading",
        "steps": "labkit.paths.steps:Steps",
        "undrained_cycles": _CYCLES + "UndrainedCycles",
        "drained_cycles": _CYCLES + "DrainedCycles",
        "strain_cycles": _CYCLES + "StrainCycles",
        "shear_cycles": _CYCLES + "ShearCycles",
        "strain_probe": "labkit.paths.probes:StrainProbe",
        "stress_probe": "labkit.paths.probes:StressProbe",
    },
    meant={
        "triaxial": "'cr' (drained), 'cv' (undrained) or 'true_triaxial'",
        "drained": "'cr'",
        "cd": "'cr'",
        "undrained": "'cv'",
        "cu": "'cv'",
        "compression": "'cr' (triaxial), 'isoc' (isotropic) or 'oedometer'",
        "shear": "'simple_shear' or 'simple_shear_cv'",
        "cyclic": "'cyclic_cp', 'undrained_cycles', 'drained_cycles' or 'strain_cycles'",
        "k0": "'oedometer_reloading' (to a stress) or 'oedometer' (to a strain)",
    },
)


def register_path(kind: type[Kind]) -> type[Kind]:
    """Register a subclass of Path under its `name` and return it; usable as a decorator.

    Raises InputError unless `direction` is three numbers, the third of them not negative.
    """
    require_subclass(kind, Path)
    require_direction(kind)
    return PATHS.register(kind)


def make_path(name: str, parameters: Values | None = None) -> Path:
    """Return the path with this name; parameters that are None get their defaults.

    Raises InputError for an unknown path, a value that is out of range, or a parameter that the path does not have.
    """
    kind = PATHS.require(name)
    values = {key: value for key, value in (parameters or {}).items() if value is not None}
    for key in values:
        if key not in parameters_of(kind):
            raise InputError(f"is not a parameter of {name}: leave it out", field=key)
    for key, definition in parameters_of(kind).items():
        if definition.default is dataclasses.MISSING and key not in values:
            raise InputError("is missing", field=key, allowed=definition.allowed_values)
    return kind(**values)


def path_of(name: str, values: Values) -> Path | None:
    """Return the path of a run file from its name and `path_parameters`; None if the name is not registered."""
    if name not in PATHS:
        return None
    kind = PATHS[name]
    return kind(**{key: value for key, value in values.items() if key in parameters_of(kind)})


def accumulated_strain(axial_strain: np.ndarray) -> np.ndarray:
    """Return the accumulated axial strain at each record, (n,); it also increases after reversals."""
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(axial_strain)))])
