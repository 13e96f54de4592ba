"""Quantities of every record of a run: strain and q as the path defines them, cycles, pore pressure, error of C0."""

from __future__ import annotations

import dataclasses
import functools
import json

import numpy as np
import xarray as xr

from labkit.errors import InputError, instead_of
from labkit.files.schema import number_of_bodies
from labkit.micro.stress import along_deviator, deviatoric_stress
from labkit.paths.facts import facts_of, number_of_cycles
from labkit.paths.path import Path
from labkit.paths.registry import path_of
from labkit.paths.strain_measures import AXIAL, PURE_SHEAR, SHEAR, StrainMeasure
from labkit.quantities.recorded import quantity
from labkit.quantities.scalars import ALIASES, QUANTITIES, WINDOW, Facts, Quantity, dilation_angle
from labkit.records.limits import RECORDED, prescribed_number
from labkit.results import undrained
from labkit.results.endings import LABORATORY, path_and_origin
from labkit.results.path_steps import records_of_steps
from labkit.results.several import Accessor, for_each_run
from labkit.sff.c0 import strength_shares

EQUATIONS = {"stress_sff": "C0", "stress_sff_by_volume": "the equation by volume"}
LEAST_RATIO = 0.2  # least |q|/p at which relative errors of q are computed


class OfRecords(Accessor):
    """The part of the accessor `run.lab` that needs only records. The path of the run determines the quantities.

    Methods that return a DataArray along `time` also take the records of a campaign.
    """

    @functools.cached_property
    def path(self) -> Path | None:
        """Loading path of the run; None if it is not registered in this process (see labkit.use)."""
        return path_of(self._run.attrs["path"], json.loads(self._run.attrs.get("path_parameters", "{}")))

    @property
    def number_of_grains(self) -> int:
        """Number of grains, each clump counted as one grain; 0 for a prediction of the model."""
        return number_of_bodies(self._run.sizes)

    def records_with_limits(self) -> dict[str, np.ndarray]:
        """Return the recorded variables that labkit.records.limits checks, name -> values."""
        records = {name: self._run[name].values for name in RECORDED if name in self._run}
        return records | prescribed_number(self._run.attrs.get("path_parameters", "{}"))

    @property
    def strain_measure(self) -> StrainMeasure:
        """The scalar strain that the path defines; the axial strain if the path is not registered."""
        measure = self.path.strain_measure() if self.path is not None else AXIAL
        if measure is SHEAR and self._run.attrs.get("engine") == "model":
            return PURE_SHEAR  # in the model, strain is the integral of the strain rate without spin
        return measure

    @functools.cached_property
    def _facts(self) -> Facts:
        """The facts of the path."""
        facts = facts_of(self.path, self.strain_measure, self.undrained_stress)
        return dataclasses.replace(facts, run=f"this run of {self._run.attrs['path']}")

    def _facts_for(self, row: Quantity) -> Facts:
        """Return the facts of the run that a quantity needs."""
        facts = self._facts
        if row.undrained:
            reference = self._reference
            facts = dataclasses.replace(facts, undrained=reference is not None, reference=reference, total=self.total)
            if "measured_pore_pressure" in self._run:
                facts = dataclasses.replace(facts, measured=self._values("measured_pore_pressure"))
        if row.cyclic and facts.cycles is None and len(self._reversals):
            counts = functools.partial(number_of_cycles, self.path, self.strain_measure)
            facts = dataclasses.replace(facts, cycles=counts)
        return facts

    @property
    def total(self) -> str:
        """Component of the total stress to which pore pressures refer, which is constant in the test.

        If the path does not say it, it is `radial` in a triaxial test of a laboratory, and otherwise `mean`.
        """
        measured = self._run.attrs.get("engine") == LABORATORY
        return (self.path and self.path.total) or ("radial" if measured and self.axisymmetric else "mean")

    @property
    def axisymmetric(self) -> bool:
        """True if q is sigma_zz - (sigma_xx + sigma_yy)/2; False if it is the invariant sqrt(3/2 s:s)."""
        return self._facts.axisymmetric

    @functools.cached_property
    def _reversals(self) -> np.ndarray:
        return self.strain_measure.reversals(self._values("strain"))

    @for_each_run
    def quantity(self, name: str, stress: str = "stress") -> xr.DataArray:
        """Return a scalar of the records by name, DataArray (time): the names are those of conditions, e.g. `q/p > 1`.

        Raises InputError for an unknown name, and for a quantity that has no meaning for this run, such as the pore
        pressure of a drained test.

        Args:
            name: A name in labkit.quantities.QUANTITIES, a recorded scalar, or a component such as `stress_xz`.
            stress: Recorded stress from which the quantity is computed, `stress` or `stress_sff`.
        """
        row = quantity(name)
        facts = self._facts_for(row)
        row.require_meaning(facts)
        if missing := [needed for needed in row.needs if needed not in self._run.variables]:
            problem = f"needs {', '.join(missing)}, which {path_and_origin(self._run.attrs)} did not record"
            raise InputError(problem, field="quantity", value=name, allowed="another quantity")
        records = {needed: self._values(stress if needed == "stress" else needed) for needed in row.needs}
        values = np.broadcast_to(row(records, facts), self._run["axial_strain"].size)
        return self._scalar(values, row.unit, row.label(facts)).rename(row.name)

    @for_each_run
    def variable(self, name: str | None) -> xr.DataArray:
        """Return a recorded variable, DataArray (time, ...), or a scalar of the records as `quantity` does.

        Raises InputError for a name that is neither, and for a variable without values, as in a measured test.
        """
        names = [str(key) for key, values in self._run.variables.items() if values.dims[:1] == ("time",)]
        full = ALIASES.get(name or "", name or "")
        try:
            values = self._run[full] if full in names else self.quantity(full)
        except InputError as error:
            if error.field != "quantity" or full in QUANTITIES:
                raise
            problem, allowed = "is not recorded" if name else "is missing", instead_of([*names, *ALIASES], name)
            raise InputError(problem, field="variable", value=name, allowed=allowed) from None
        if np.isnan(values.values).all():
            problem = f"has no values in {path_and_origin(self._run.attrs)}"
            raise InputError(problem, field="variable", value=name, allowed="a variable that this run recorded")
        return values

    @for_each_run
    def strain(self) -> xr.DataArray:
        """Return the strain that the path defines, e.g. axial strain or gamma_xz, DataArray (time).

        The strain has a sign. For a path without a characteristic component, it is the accumulated norm |eps|.
        """
        return self.quantity("strain" if self.strain_measure.signed else "accumulated_strain")

    def accumulated_strain(self) -> xr.DataArray:
        """Return the accumulated strain, DataArray (time): as `strain`, but growing also after reversals."""
        return self.quantity("accumulated_strain")

    @for_each_run
    def abscissa(self) -> xr.DataArray:
        """Return the abscissa of figures of the run, DataArray (time).

        It is the number of cycles in a cyclic test, the accumulated strain on other paths that reverse, and otherwise
        the strain.
        """
        if self.path is not None and self.path.cyclic:
            return self.cycles()
        return self.accumulated_strain() if len(self._reversals) else self.strain()

    def cycles(self) -> xr.DataArray:
        """Return the number of cycles at every record as in ASTM D5311, DataArray (time): 0.25 at the first peak.

        Raises InputError for a monotonic test.
        """
        return self.quantity("cycles")

    def q(self, name: str = "stress") -> xr.DataArray:
        """Return q of a recorded stress, DataArray (time), Pa.

        On axisymmetric paths q is sigma_zz - (sigma_xx + sigma_yy)/2, negative in triaxial extension; on all other
        paths q is the invariant sqrt(3/2 s:s).
        """
        return self.quantity("q", name)

    def part_of_q(self, tensor: np.ndarray, stress: np.ndarray) -> np.ndarray:
        """Return the contribution of a tensor T (..., 3, 3) to q: T_zz - (T_xx + T_yy)/2, or 3/2 s:T/q."""
        return deviatoric_stress(tensor) if self.axisymmetric else along_deviator(tensor, stress)

    @for_each_run
    def component(self, name: str) -> xr.DataArray:
        """Return the component of A, F or F^t that corresponds to q, DataArray (time).

        On axisymmetric paths this is zz; on all other paths it is the component T:s/|s| sqrt(2/3) along the stress
        deviator s, which equals T_zz in triaxial compression. `name` is `contact_anisotropy`,
        `normal_force_anisotropy` or `mobilisation`.
        """
        tensor, long_name = self._run[name].values, self._run[name].attrs.get("long_name", name)
        if self.axisymmetric:
            return self._scalar(tensor[:, 2, 2], "1", f"{long_name}, zz")
        along = along_deviator(tensor, self._run["stress"].values) / 1.5
        return self._scalar(along, "1", f"{long_name}, along the stress deviator")

    def lode_angle(self, name: str = "stress") -> xr.DataArray:
        """Return the Lode angle of a recorded stress, DataArray (time), degrees: 0 in compression, 60 in extension."""
        return self.quantity("lode_angle", name)

    def step(self, step: int | str) -> xr.Dataset:
        """Return the records of a step of a path file, `2`, or of several, `"4-18"` (results.path_steps)."""
        return records_of_steps(self._run, self.path, self._reference, step)

    def pore_pressure(self, total: str | None = None) -> xr.DataArray:
        """Return the excess pore pressure u = sigma_total - sigma' of undrained loading, DataArray (time), Pa.

        In a measured test whose file has the pore pressure, it is the measured one less its first value.
        It is NaN in drained steps of a path of steps, and counts from the start of undrained loading, also if that was
        in an earlier run. Raises InputError for a drained test.

        Args:
            total: Component of the total stress that is constant: `mean`, `axial` or `radial` (a triaxial test at
                constant cell pressure). Without it: the measured pore pressure, or `radial` if measured, or `mean`.
        """
        return self.quantity("pore_pressure" if total is None else f"pore_pressure_{total}")

    def pore_pressure_ratio(self, total: str | None = None) -> xr.DataArray:
        """Return r_u = u/sigma'_0 of undrained loading, DataArray (time), by default with sigma'_0 = p_0.

        sigma'_0 is the effective stress at the start of undrained loading; see `pore_pressure`.
        """
        return self.quantity("r_u" if total is None else f"r_u_{total}")

    @functools.cached_property
    def _reference(self) -> np.ndarray | None:
        """Effective stress at the start of undrained loading, Pa: (3, 3), or (n, 3, 3) with NaN where it is drained."""
        start = self.undrained_stress
        if self.is_undrained:
            return self._values("stress")[0] if start is None else start
        if "path_step" not in self._run:
            return None
        steps, volume, stress = map(self._values, ("path_step", "volume", "stress"))
        return undrained.references(steps, volume, stress, start)

    @property
    def undrained_stress(self) -> np.ndarray | None:
        """Effective stress at the start of undrained loading before this run, (3, 3), Pa; None if there was none."""
        end = self._run.attrs.get("undrained_stress", np.zeros(9)) if self.is_undrained else np.zeros(9)
        stress = np.reshape(self._run.attrs.get("undrained_before", end), (3, 3))  # 0.2.0.dev0 has the end only
        return stress if stress.any() else None

    def double_amplitude(self) -> xr.DataArray:
        """Return the change of the strain of the path since its last reversal, DataArray (time)."""
        return self.quantity("double_amplitude")

    def liquefaction(self, total: str | None = None) -> undrained.Liquefaction:
        """Return the cycles to initial liquefaction of an undrained test.

        Raises InputError for a drained or a monotonic test.
        """
        ratio = self.pore_pressure_ratio(total).values
        return undrained.liquefaction(self.cycles().values, ratio, self.double_amplitude().values)

    @property
    def is_undrained(self) -> bool:
        """True if the volume is constant, or changes as that of the pore water does."""
        return bool(self.path and self.path.water is not None) or undrained.is_constant(self._values("volume"))

    def strength_shares(self) -> xr.DataArray:
        """Return the contributions of A, F, F^t and the product of A and F to q/p of C0, DataArray (term, time).

        For grains that are not spheres, M and X of labkit.micro.eccentricity contribute too.
        """
        A, F, Ft = (self.variable(name).values for name in ("A", "F", "Ft"))
        names = ("normal_force_eccentricity", "tangential_force_eccentricity")
        eccentric = (self._run[names[0]].values, self._run[names[1]].values) if names[0] in self._run else None
        shares = strength_shares(A, F, Ft, self.axisymmetric, eccentric)
        return xr.DataArray(
            np.array(list(shares.values())),
            dims=("term", "time"),
            coords={
                "term": list(shares),
                "axial_strain": ("time", self._run["axial_strain"].values),
                "strain": ("time", self.strain().values),
            },
            attrs={"units": "1", "long_name": "contribution to q/p of C0"},
        )

    def sff_error(self, name: str = "stress_sff") -> xr.DataArray:
        """Return |C0 - Love|/|Love| at every record with the Frobenius norm, DataArray (time).

        `name` is the recorded stress that is compared: `stress_sff`, C0 as printed, or `stress_sff_by_volume`.
        """
        return self.quantity(name.replace("stress_sff", "sff_error"))

    def sff_errors(self, name: str = "stress_sff") -> xr.Dataset:
        """Return signed relative errors of C0 in p, q and q/p at every record, Dataset (time) of p, q and ratio.

        `name` is as for `sff_error`.

        The error in p dominates the Frobenius norm of `sff_error`. q and ratio are NaN where |q| < 0.2 p; all are NaN
        where p = 0.
        """
        p, q = self.mean_stress().values, self.q().values
        with np.errstate(divide="ignore", invalid="ignore"):
            of_p = np.where(p != 0.0, self.mean_stress(name).values / p - 1.0, np.nan)
            of_q = np.where(np.abs(q) >= LEAST_RATIO * np.abs(p), self.q(name).values / q - 1.0, np.nan)
            of_ratio = (1.0 + of_q) / (1.0 + of_p) - 1.0
        errors = {"p": of_p, "q": of_q, "ratio": of_ratio}
        label = f"relative error of {EQUATIONS[name]} in"
        return xr.Dataset({of: self._scalar(e, "1", f"{label} {of}") for of, e in errors.items()})

    def mean_stress(self, name: str = "stress") -> xr.DataArray:
        """Return the mean stress p = tr(sigma)/3 of a recorded stress, DataArray (time), Pa."""
        return self.quantity("p", name)

    def friction_angle(self) -> xr.DataArray:
        """Return the mobilised friction angle arcsin((sigma_1 - sigma_3)/(sigma_1 + sigma_3)), (time), degrees."""
        return self.quantity("friction_angle")

    def volumetric_strain(self) -> xr.DataArray:
        """Return the volumetric strain, logarithmic and positive in compression, DataArray (time)."""
        return self.quantity("volumetric_strain")

    @for_each_run
    def dilation_angle(self, window: float = WINDOW) -> xr.DataArray:
        """Return the dilation angle psi, DataArray (time), degrees, positive if the volume grows.

        See labkit.quantities.scalars.dilation_angle; the increments are those over a `window` of accumulated strain.
        """
        values = dilation_angle(self._run["strain"].values, self.accumulated_strain().values, window)
        return self._scalar(values, "degree", "dilation angle")

    @for_each_run
    def deviatoric_stress(self, name: str = "stress") -> xr.DataArray:
        """Return q = sigma_zz - (sigma_xx + sigma_yy)/2 of a recorded stress, DataArray (time), Pa; see also `q`."""
        return self._scalar(deviatoric_stress(self._run[name].values), "Pa", "deviatoric stress q")

    def stress_ratio(self, name: str = "stress") -> xr.DataArray:
        """Return the stress ratio q/p of a recorded stress, DataArray (time); NaN where p and q are zero."""
        return self.quantity("stress_ratio", name)

    def peak(self) -> int:
        """Return the number of the record with the largest |q/p|; 0 if q/p has no finite value."""
        ratio = np.abs(self.stress_ratio().values)
        return int(np.nanargmax(np.where(np.isfinite(ratio), ratio, -1.0)))

    def _values(self, name: str) -> np.ndarray:
        """Return a recorded variable along the records, also that of a single record such as `run.isel(time=0)`."""
        values = self._run[name].values
        return values if "time" in self._run.dims else values[np.newaxis]

    def _scalar(self, values: np.ndarray, units: str, long_name: str) -> xr.DataArray:
        strain = self._run["axial_strain"]
        named = strain.copy(deep=False, data=np.reshape(values, strain.shape)).rename(None)
        return named.assign_attrs(units=units, long_name=long_name)
