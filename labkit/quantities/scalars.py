"""The table of quantities: every scalar of a record by name, with its unit, label and formula.

labkit.quantities.recorded adds the recorded variables, and looks names up. A record is a mapping from the names of
variables to values; the same formulas accept one record or all records of a run, whose arrays have an additional first
dimension, `time`. What a formula needs to know of the run beside its records are the Facts. Accessor, figures,
conditions, summaries and misfits read this table.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from labkit.errors import InputError
from labkit.micro.stress import (
    equivalent_stress,
    intermediate_ratio,
    lode_angle,
    mean_stress,
    principal_stresses,
    q_of_test,
    relative_error,
)
from labkit.micro.tensors import symmetric

Record = Mapping[str, Any]
Series = Callable[[np.ndarray], np.ndarray]  # a function of the strains (n, 3, 3) of all records

# Constant component of the total stress -> function that returns this component of a stress (..., 3, 3).
TOTAL: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "mean": mean_stress,
    "axial": lambda stress: stress[..., 2, 2],
    "radial": lambda stress: 0.5 * (stress[..., 0, 0] + stress[..., 1, 1]),
}
WINDOW = 0.01  # accumulated strain over which the dilation angle is measured


@dataclasses.dataclass(frozen=True, eq=False)
class Facts:
    """What the formulas need to know of a run beside its records. The default is an axisymmetric undrained test.

    Args:
        run: What refusals call the run, e.g. `this run of cp`.
        axisymmetric: False if the path is not axisymmetric about z: q and the deviatoric strain are the invariants.
        undrained: True if a part of the run keeps its volume.
        reference: Effective stress at the start of undrained loading, Pa: (3, 3), or (n, 3, 3) with NaN at the records
            of drained parts. None if the loading is drained here.
        total: Component of the total stress that is constant in an undrained test: a key of TOTAL.
        measured: Pore pressure that was measured, (n,), Pa; None to compute it from `total`.
        strain: Function that returns the scalar strain of the path, (...), from strains (..., 3, 3).
        strain_name: Its name.
        accumulate: Function that returns the strain accumulated up to each record.
        amplitude: Function that returns the change of the scalar strain since its last reversal at each record.
        cycles: Function of the strains and stresses of all records that counts cycles; None for a monotonic test.
    """

    run: str = "this run"
    axisymmetric: bool = True
    undrained: bool = True
    reference: np.ndarray | None = None
    total: str = "mean"
    measured: np.ndarray | None = None
    strain: Series = lambda strain: strain[..., 2, 2]
    strain_name: str = "axial strain"
    accumulate: Series = lambda strain: np.concatenate([[0.0], np.cumsum(np.abs(np.diff(strain[..., 2, 2])))])
    amplitude: Series = lambda strain: np.abs(strain[..., 2, 2] - strain[0, 2, 2])
    cycles: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A scalar of a record.

    Args:
        name: Name in conditions, figures, summaries and Python.
        unit: SI unit, or `1`.
        long_name: Meaning, for labels; or a function of the Facts that returns it.
        formula: Function of (record, facts).
        needs: Recorded variables that the formula reads.
        undrained: True if it has a meaning in undrained loading only.
        cyclic: True if it has a meaning in tests that reverse only.
        every_record: True if the formula needs all records, so that conditions cannot use it.
    """

    name: str
    unit: str
    long_name: str | Callable[[Facts], str]
    formula: Callable[[Record, Facts], object]
    needs: tuple[str, ...] = ("stress",)
    undrained: bool = False
    cyclic: bool = False
    every_record: bool = False

    def __call__(self, record: Record, facts: Facts | None = None) -> np.ndarray:
        """Compute the value, shape () or (time,). Raises KeyError if the record lacks a variable.

        Raises InputError if the quantity has no meaning for a run with these facts.

        Args:
            record: One record, or all records of a run.
            facts: Facts of the run (default: an axisymmetric test).
        """
        self.require_meaning(facts := facts or Facts())
        values = {name: np.asarray(record[name], dtype=float) for name in self.needs}
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.formula(values, facts), dtype=float)

    def require_meaning(self, facts: Facts) -> None:
        """Raise InputError if the quantity has no meaning for a run with these facts."""
        if self.undrained and not facts.undrained:
            raise InputError(
                f"{facts.run} is drained: its volume changes, so it has no pore pressure; give a test at "
                "constant volume"
            )
        if self.cyclic and facts.cycles is None:
            raise InputError(f"{facts.run} is monotonic, so it has no cycles: give a test that reverses")

    def label(self, facts: Facts) -> str:
        """Return the meaning of the quantity in a run with these facts."""
        return self.long_name if isinstance(self.long_name, str) else self.long_name(facts)


def _friction_angle(record: Record, facts: Facts) -> np.ndarray:
    principal = principal_stresses(record["stress"])
    largest, least = principal[..., 2], principal[..., 0]
    return np.degrees(np.arcsin((largest - least) / (largest + least)))


def _pore_pressure(record: Record, facts: Facts, total: str | None = None) -> np.ndarray:
    """Return u as measured, or sigma_total - sigma' of the component of the total stress that is constant.

    It is NaN in drained loading.
    """
    if facts.measured is not None and total is None:
        return facts.measured - facts.measured[0]
    component = TOTAL[total or facts.total]
    reference = np.full((3, 3), np.nan) if facts.reference is None else facts.reference
    return component(reference) - component(record["stress"])


def _pressure_ratio(record: Record, facts: Facts, total: str | None = None) -> np.ndarray:
    """Return r_u = u/sigma'_0."""
    reference = np.full((3, 3), np.nan) if facts.reference is None else facts.reference
    return _pore_pressure(record, facts, total) / TOTAL[total or facts.total](reference)


def dilation_angle(strain: np.ndarray, accumulated: np.ndarray, window: float = WINDOW) -> np.ndarray:
    """Return the dilation angle psi (n,), degrees, positive if the volume grows.

    sin psi = -d eps_v/(|d eps_1| + |d eps_2| + |d eps_3|), with the principal strains of the increment over a `window`
    of accumulated strain around each record. This is -d eps_v/(2 d eps_1 - d eps_v) in triaxial compression and plane
    strain (Schanz and Vermeer 1996), and -d eps_v/(d eps_v - 2 d eps_3) in triaxial extension.
    """
    ends = np.clip(accumulated + 0.5 * window * np.array([[-1.0], [1.0]]), accumulated[0], accumulated[-1])
    columns = symmetric(strain).reshape(-1, 9).T
    before, after = (np.stack([np.interp(end, accumulated, column) for column in columns], axis=1) for end in ends)
    increment = (after - before).reshape(-1, 3, 3)
    volume, size = np.trace(increment, axis1=1, axis2=2), np.abs(np.linalg.eigvalsh(increment)).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.degrees(np.arcsin(-volume / size))


_ROWS = (
    Quantity("p", "Pa", "mean stress p", lambda r, _: mean_stress(r["stress"])),
    Quantity(
        "q",
        "Pa",
        lambda facts: "deviatoric stress q" if facts.axisymmetric else "deviatoric stress, invariant q",
        lambda r, facts: q_of_test(r["stress"], facts.axisymmetric),
    ),
    Quantity(
        "stress_ratio",
        "1",
        "stress ratio q/p",
        lambda r, facts: q_of_test(r["stress"], facts.axisymmetric) / mean_stress(r["stress"]),
    ),
    Quantity("deviator", "Pa", "deviatoric stress, invariant q", lambda r, _: equivalent_stress(r["stress"])),
    Quantity("sigma_1", "Pa", "largest principal stress", lambda r, _: principal_stresses(r["stress"])[..., 2]),
    Quantity("sigma_2", "Pa", "intermediate principal stress", lambda r, _: principal_stresses(r["stress"])[..., 1]),
    Quantity("sigma_3", "Pa", "least principal stress", lambda r, _: principal_stresses(r["stress"])[..., 0]),
    Quantity("b", "1", "intermediate principal stress ratio", lambda r, _: intermediate_ratio(r["stress"])),
    Quantity(
        "lode_angle", "degree", "Lode angle, 0 in compression and 60 in extension", lambda r, _: lode_angle(r["stress"])
    ),
    Quantity(
        "friction_angle",
        "degree",
        "mobilised friction angle, arcsin((sigma_1 - sigma_3)/(sigma_1 + sigma_3))",
        _friction_angle,
    ),
    Quantity("pore_pressure", "Pa", "excess pore pressure u", _pore_pressure, undrained=True),
    Quantity("r_u", "1", "pore pressure ratio r_u", _pressure_ratio, undrained=True),
    *(
        Quantity(
            f"{name}_{total}",
            unit,
            f"{long_name}, constant total {total} stress",
            functools.partial(formula, total=total),
            undrained=True,
        )
        for name, unit, long_name, formula in (
            ("pore_pressure", "Pa", "excess pore pressure u", _pore_pressure),
            ("r_u", "1", "pore pressure ratio r_u", _pressure_ratio),
        )
        for total in TOTAL
    ),
    Quantity(
        "volumetric_strain",
        "1",
        "volumetric strain, logarithmic, compression positive",
        lambda r, _: np.trace(r["strain"], axis1=-2, axis2=-1),
        ("strain",),
    ),
    Quantity(
        "deviatoric_strain",
        "1",
        lambda facts: "deviatoric strain" if facts.axisymmetric else "deviatoric strain, invariant",
        lambda r, facts: 2.0 / 3.0 * q_of_test(r["strain"], facts.axisymmetric),
        ("strain",),
    ),
    Quantity(
        "gamma_xz",
        "1",
        "shear strain in the x-z plane, 2 eps_xz",
        lambda r, _: r["strain"][..., 0, 2] + r["strain"][..., 2, 0],
        ("strain",),
    ),
    Quantity("strain", "1", lambda facts: facts.strain_name, lambda r, facts: facts.strain(r["strain"]), ("strain",)),
    Quantity(
        "accumulated_strain",
        "1",
        lambda facts: f"accumulated {facts.strain_name}",
        lambda r, facts: facts.accumulate(r["strain"]),
        ("strain",),
        every_record=True,
    ),
    Quantity(
        "double_amplitude",
        "1",
        lambda facts: f"{facts.strain_name} since the last reversal",
        lambda r, facts: facts.amplitude(r["strain"]),
        ("strain",),
        every_record=True,
    ),
    Quantity(
        "cycles",
        "1",
        "number of cycles N",
        lambda r, facts: np.nan if facts.cycles is None else facts.cycles(r["strain"], r["stress"]),
        ("strain", "stress"),
        cyclic=True,
        every_record=True,
    ),
    Quantity(
        "dilation_angle",
        "degree",
        "dilation angle",
        lambda r, facts: dilation_angle(r["strain"], facts.accumulate(r["strain"])),
        ("strain",),
        every_record=True,
    ),
    Quantity(
        "sff_error",
        "1",
        "error of C0 relative to Love",
        lambda r, _: relative_error(r["stress_sff"], r["stress"]),
        ("stress_sff", "stress"),
    ),
    Quantity(
        "sff_error_by_volume",
        "1",
        "error of the equation by volume relative to Love",
        lambda r, _: relative_error(r["stress_sff_by_volume"], r["stress"]),
        ("stress_sff_by_volume", "stress"),
    ),
)
QUANTITIES: dict[str, Quantity] = {row.name: row for row in _ROWS}
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
    "axial_stress": "stress_zz",
}
