"""Scalar quantities of a record by name: recorded scalars, components of recorded tensors, and derived quantities.

A record is a mapping from the names of labkit.quantities.recorded.record_table to values. The same functions accept
one record or all records of a run, whose arrays have an additional first dimension, `time`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from labkit.errors import InputError, nearest
from labkit.io.schema import BY_VOLUME, ECCENTRICITY, Variable
from labkit.micro.stress import deviatoric_stress, equivalent_stress, mean_stress
from labkit.micro.tensors import symmetric
from labkit.quantities.recorded import record_table

Record = Mapping[str, Any]


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A scalar of a record.

    The `symbol` labels axes and legends; the `unit` is the SI unit, or `1` if dimensionless. The `function` takes
    (record, first), where `first` is the first record of the run, with an `undrained_stress` if undrained loading began
    before it; `needs` lists the variables that `function` reads.
    """

    name: str
    symbol: str
    unit: str
    long_name: str
    function: Callable[[Record, Record], object]
    needs: tuple[str, ...]

    @property
    def of_pore_pressure(self) -> bool:
        """True if the quantity has a meaning in undrained tests only."""
        return self.name in ("pore_pressure", "r_u")

    def __call__(self, record: Record, first: Record | None = None) -> np.ndarray:
        """Compute the value, shape () or (time,). Raises KeyError if the record lacks a variable.

        Args:
            record: One record, or all records of a run.
            first: First record of the run (default: `record`, or its first row if it has the dimension time).
        """
        values = {name: np.asarray(record[name], dtype=float) for name in self.needs}
        if first is None:
            table = record_table()
            first = {name: _first(value, table.get(name)) for name, value in values.items()}
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.function(values, first), dtype=float)


def _first(value: np.ndarray, variable: Variable | None) -> np.ndarray:
    """Return the first row of an array with the dimension time; the value of a single record is returned unchanged."""
    dimensions = len(variable.dimensions) if variable is not None else 1
    return value[0] if value.ndim == dimensions else value


def _principal(record: Record) -> np.ndarray:
    """Return the principal stresses in ascending order, shape (..., 3), in Pa; NaN where the stress is not finite."""
    stress = symmetric(record["stress"])
    known = np.isfinite(stress).all(axis=(-2, -1))[..., None]
    return np.where(known, np.linalg.eigvalsh(np.where(known[..., None], stress, 0.0)), np.nan)


def _intermediate_ratio(record: Record) -> np.ndarray:
    """Return the ratio b = (sigma_2 - sigma_3)/(sigma_1 - sigma_3)."""
    third, second, largest = np.moveaxis(_principal(record), -1, 0)
    return (second - third) / (largest - third)


def _lode_angle(record: Record) -> np.ndarray:
    b = _intermediate_ratio(record)
    return np.degrees(np.arctan2(np.sqrt(3.0) * b, 2.0 - b))


def _friction_angle(record: Record) -> np.ndarray:
    principal = _principal(record)
    largest, least = principal[..., 2], principal[..., 0]
    return np.degrees(np.arcsin((largest - least) / (largest + least)))


def _pressure(record: Record) -> float | np.ndarray:
    return mean_stress(np.asarray(record["stress"]))


def _reference(first: Record) -> float | np.ndarray:
    """Return the mean stress at the start of undrained loading, which may have begun before the first record."""
    return mean_stress(np.asarray(first.get("undrained_stress", first["stress"])))


_LODE = "Lode angle of the stress, 0 in compression and 60 in extension"
_FRICTION = "mobilised friction angle, arcsin((sigma_1 - sigma_3)/(sigma_1 + sigma_3))"
_EXCESS = "excess pore pressure p_0 - p of a test at constant volume and constant total mean stress"
_EXCESS_RATIO = "pore pressure ratio 1 - p/p_0 of a test at constant volume"
_VOLUMETRIC = "volumetric strain, logarithmic, compression positive"
_DEVIATORIC = "deviatoric strain 2/3 (eps_zz - (eps_xx + eps_yy)/2)"
_GAMMA = "shear strain in the x-z plane, 2 eps_xz"
_ROWS: dict[str, tuple[tuple[str, str, str, str, Callable[[Record, Record], object]], ...]] = {  # by variable
    "stress": (
        ("p", "p", "Pa", "mean stress", lambda r, _: _pressure(r)),
        ("q", "q", "Pa", "deviatoric stress", lambda r, _: deviatoric_stress(r["stress"])),
        ("stress_ratio", "q/p", "1", "stress ratio q/p", lambda r, _: deviatoric_stress(r["stress"]) / _pressure(r)),
        (
            "deviator",
            r"$\sqrt{3 J_2}$",
            "Pa",
            "invariant deviatoric stress, sqrt(3 J2)",
            lambda r, _: equivalent_stress(r["stress"]),
        ),
        ("sigma_1", r"$\sigma_1$", "Pa", "largest principal stress", lambda r, _: _principal(r)[..., 2]),
        ("sigma_2", r"$\sigma_2$", "Pa", "intermediate principal stress", lambda r, _: _principal(r)[..., 1]),
        ("sigma_3", r"$\sigma_3$", "Pa", "least principal stress", lambda r, _: _principal(r)[..., 0]),
        ("b", "b", "1", "intermediate principal stress ratio", lambda r, _: _intermediate_ratio(r)),
        ("lode_angle", r"$\theta$", "degree", _LODE, lambda r, _: _lode_angle(r)),
        ("friction_angle", r"$\varphi$", "degree", _FRICTION, lambda r, _: _friction_angle(r)),
        ("pore_pressure", "u", "Pa", _EXCESS, lambda r, first: _reference(first) - _pressure(r)),
        ("r_u", r"$r_u$", "1", _EXCESS_RATIO, lambda r, first: 1.0 - _pressure(r) / _reference(first)),
    ),
    "strain": (
        (
            "volumetric_strain",
            r"$\varepsilon_v$",
            "1",
            _VOLUMETRIC,
            lambda r, _: np.trace(r["strain"], axis1=-2, axis2=-1),
        ),
        (
            "deviatoric_strain",
            r"$\varepsilon_q$",
            "1",
            _DEVIATORIC,
            lambda r, _: 2.0 / 3.0 * deviatoric_stress(r["strain"]),
        ),
        ("gamma_xz", r"$\gamma_{xz}$", "1", _GAMMA, lambda r, _: r["strain"][..., 0, 2] + r["strain"][..., 2, 0]),
    ),
}
QUANTITIES: dict[str, Quantity] = {
    row[0]: Quantity(*row, (variable,)) for variable, rows in _ROWS.items() for row in rows
}
ALIASES = {
    "eta": "stress_ratio",
    "q/p": "stress_ratio",
    "e": "void_ratio",
    "Z": "coordination_number",
    "Lambda": "mean_normalised_force",
    "A": "contact_anisotropy",
    "F": "normal_force_anisotropy",
    "Ft": "mobilisation",
    "sigma": "stress",
    "eps": "strain",
}
_INVARIANT = {
    "q": QUANTITIES["deviator"],
    "stress_ratio": dataclasses.replace(
        QUANTITIES["stress_ratio"], function=lambda r, _: equivalent_stress(r["stress"]) / _pressure(r)
    ),
}  # quantities of a test that is not axisymmetric
SYMBOLS = {"void_ratio": "e", "coordination_number": "Z", "mean_normalised_force": r"$\Lambda$"}


def quantity(name: str, axisymmetric: bool = True) -> Quantity:
    """Return a Quantity by name: one of QUANTITIES, a recorded scalar, or a component such as `stress_xz` or `A_zz`.

    If the test is not `axisymmetric` about z, q and the stress ratio are the invariants. Raises InputError for an
    unknown name.
    """
    known = QUANTITIES if axisymmetric else QUANTITIES | _INVARIANT
    if ALIASES.get(name, name) in known:
        return known[ALIASES.get(name, name)]
    base, _, axes = name.rpartition("_")
    for variable, component in ((ALIASES.get(name, name), ""), (ALIASES.get(base, base), axes)):
        found = _recorded_quantity(variable, component)
        if found is not None:
            return found
    raise InputError("is unknown", field="quantity", value=name, allowed=_suggestion(name), quoted=True)


def _recorded_quantity(variable: str, axes: str) -> Quantity | None:
    """Return a recorded scalar, or the component `axes` (e.g. xz) of a recorded vector or tensor, or None."""
    if variable in QUANTITIES:
        return None if axes else QUANTITIES[variable]
    known = (record_table() | BY_VOLUME | ECCENTRICITY).get(variable)
    if known is None or len(known.dimensions) != 1 + len(axes) or not set(axes) <= set("xyz"):
        return None
    place = (..., *("xyz".index(axis) for axis in axes))
    name = f"{variable}_{axes}" if axes else variable
    return Quantity(
        name,
        SYMBOLS.get(variable, name.replace("_", " ")),
        known.units,
        f"{known.long_name}, {axes}" if axes else known.long_name,
        lambda record, _: record[variable][place],
        (variable,),
    )


def _suggestion(name: str) -> str:
    """List the names that can replace an unknown name."""
    scalars = [v.name for v in record_table().values() if len(v.dimensions) == 1]
    every = [*QUANTITIES, *(alias for alias in ALIASES if alias not in ("A", "F", "Ft", "sigma", "eps")), *scalars]
    close = nearest(name, every)
    start = "one of" if close is None else f"{close!r}, or another of"
    return f"{start} {', '.join(QUANTITIES)}, a recorded variable such as void_ratio, or a component such as stress_xz"
