"""Verification of a run: stress-force-fabric equations against Love's stress, what the path holds, and limits."""

from __future__ import annotations

import dataclasses
import html
import json
import os
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas
import xarray

from labkit.errors import InputError, require_type
from labkit.files.netcdf import open_netcdf
from labkit.micro.cells import relative_width
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import equivalent_stress, mean_stress
from labkit.micro.tensors import symmetric, to_six
from labkit.micro.void_ratio import grain_volume
from labkit.paths.registry import path_of
from labkit.quantities.recorded import recorded_statistics
from labkit.records import limits
from labkit.records.checkpoint import ratcheting_of
from labkit.records.energy import BALANCE_LIMIT, relative_to_work
from labkit.results.dataset import open_run
from labkit.results.endings import LABORATORY
from labkit.results.run import Run
from labkit.sff.c0 import sff_stress, sff_stress_by_volume
from labkit.specimens.recipe import mean_grain_volume

SFF_TOLERANCE = 0.02  # relative to Love's stress, Frobenius norm
MEAN_STRESS_TOLERANCE = 1e-5  # of the equation by volume, exact for forces ft in the contact plane
FEW_GRAINS = 1_000  # with fewer grains, the equation by volume may exceed SFF_TOLERANCE
SFF_PRESSURE = 50e3  # Pa: the equations are not judged at lower mean stresses
BY_VOLUME, PRINTED = "stress_sff_by_volume", "stress_sff"
SFF_NAMES = {"p": "p", "q": "q", "ratio": "q/p"}
RECOMPUTED_TOLERANCE = 1e-9
VOLUME_TOLERANCE = 1e-10
STRAIN_TOLERANCE = 1e-10
LEAST_WIDTH = 2.0  # minimum width of the cell in diameters of the largest grain


@dataclasses.dataclass(frozen=True)
class Finding:
    """One line of the report; `decides` is True if the run fails with this check, False for a limit.

    The `limit` is text such as `< 0.02`, or a range, in the unit of the value; without a limit the value is
    informative. `shown_in` is the unit in which the line shows value and limit, % or MPa instead of a fraction or Pa.
    `failing` is the verdict of a failed check.
    """

    name: str
    value: float
    limit: str = ""
    holds: bool = True
    decides: bool = False
    shown_in: str = ""
    failing: str = "FAILED"

    def __str__(self) -> str:
        failing = self.failing if self.decides else "outside"
        verdict = ("-" if np.isnan(self.value) else "ok") if self.holds else failing
        if np.isnan(self.value) and not self.limit:
            return f"{self.name}: {verdict}" if verdict != "-" else self.name
        if not self.limit:
            return f"{self.name:<58} {self._format(self.value)}".rstrip()
        limit = f"< {self._format(float(self.limit[2:]), 0).strip()}" if self.limit.startswith("< ") else self.limit
        return f"{self.name:<58} {self._format(self.value)}   {limit:<16} {verdict}"

    def _format(self, value: float, width: int = 10) -> str:
        return f"{value * limits.SHOWN_IN[self.shown_in]:>{width}.4g} {self.shown_in:<3}"


class Findings(list[Finding]):
    """The lines of a report, a list that prints and appears in notebooks as a report."""

    def __str__(self) -> str:
        return "\n".join(map(str, self))

    def _repr_html_(self) -> str:
        """Return the report for notebooks."""
        return f"<pre>{html.escape(str(self))}</pre>"


def require_simulations(runs: Mapping[str, xarray.Dataset]) -> None:
    """Raise InputError if one of the runs, name -> run, has no grains: a prediction of the model or a measured test."""
    for name, run in runs.items():
        if run.attrs.get("engine") == LABORATORY:
            raise InputError(f"{name} was measured in a laboratory: labkit misfit compares a simulation with it")
        if run.attrs.get("engine") == "model":
            raise InputError(
                f"{name} is a prediction of the model (engine = model): it has no contacts and its stress is computed "
                "from C0, so there is nothing to verify; give simulations, or view it with labkit figure or critical"
            )


def verify(run: Run | xarray.Dataset | str | os.PathLike[str]) -> Findings:
    """Verify a run: compare the equation by volume and C0 with Love's stress, and check held quantities and limits.

    Give a Run, a Dataset of labkit.open_run, or the name of a run file. The run passes if every Finding with `decides`
    holds. Raises InputError for a prediction of the model.
    """
    if isinstance(run, (str, os.PathLike)):
        run = open_run(run)
    data = run.data if isinstance(run, Run) else run
    require_type(data, xarray.Dataset, "run", "a labkit.Run, or the name of a run file")
    require_simulations({"the run": data})
    return findings(data)


def findings(run: xarray.Dataset) -> Findings:
    """Return the checks and limits of a run opened with labkit.open_run."""
    return Findings([*_checks(run), *_limits(run)])


def findings_csv(findings: Mapping[str, Sequence[Finding]]) -> str:
    """Format the findings of several runs, name -> list of Finding, as CSV text."""
    rows = [{"run": name, **dataclasses.asdict(finding)} for name, lines in findings.items() for finding in lines]
    return pandas.DataFrame(rows).drop(columns="shown_in").to_csv(index=False, float_format="%.5g")


def _checks(run: xarray.Dataset) -> Iterator[Finding]:
    invalid = int((~np.isfinite(run["stress"].values)).any(axis=(1, 2)).sum())
    yield Finding("records with a stress that is not finite", invalid, "0", invalid == 0, True)
    yield from _check_equations(run)
    formulas = {"stress": love_stress, PRINTED: sff_stress, BY_VOLUME: sff_stress_by_volume}
    if BY_VOLUME not in run:
        del formulas[BY_VOLUME]
    if run.lab.has_clumps and "contact_eccentricity" not in run:
        del formulas[PRINTED]
        yield Finding("C0 of clumps stored by an earlier version, without M and X: use run.lab.sff_stress()", np.nan)
    recomputed = run.lab.over_snapshots(
        lambda snapshot: {name: formula(snapshot) for name, formula in formulas.items()}
    )
    difference = np.max(
        [_difference(values.values, run.lab.at_snapshots(n).values) for n, values in recomputed.items()]
    )
    name = f"stored stress against its contacts, {run.sizes['snapshot']} snapshots"
    yield _below(name, difference, RECOMPUTED_TOLERANCE)
    yield from _check_statistics(run)
    yield from _check_end(run)
    yield from _check_held(run)


def _check_equations(run: xarray.Dataset) -> Iterator[Finding]:
    """Judge the equation by volume at the records, or at the snapshots of an older file; report C0 beside it."""
    pressed = run.lab.mean_stress().values > SFF_PRESSURE
    by_volume = run
    if BY_VOLUME not in run:
        stress = (("time", "i", "j"), run.lab.sff_stress_by_volume().values)
        by_volume = run.isel(time=run.lab.snapshot_records()).assign({BY_VOLUME: stress})
    judged = by_volume.lab.mean_stress().values > SFF_PRESSURE
    if judged.any():
        worst = float(by_volume.lab.sff_error(BY_VOLUME).values[judged].max())
        where = "" if by_volume is run else "snapshots, "
        yield _below(f"equation by volume: largest error, norm ({where}p > 50 kPa)", worst, SFF_TOLERANCE, "%")
        of_p = np.abs(by_volume.lab.sff_errors(BY_VOLUME)["p"].values[judged]).max()
        yield _below("equation by volume: largest error of p, which is exact", of_p, MEAN_STRESS_TOLERANCE)
        yield from _errors_of(by_volume, judged, BY_VOLUME, "equation by volume", ("q",))
        if worst >= SFF_TOLERANCE and (grains := run.lab.number_of_grains) < FEW_GRAINS:
            yield Finding(f"the equation averages over directions: {grains} grains may be too few", np.nan)
    elif pressed.any():
        yield Finding("equation by volume: not judged, an older file without snapshots", np.nan)
    else:
        name = "equation by volume: not judged, no record with p > 50 kPa"
        yield Finding(name, np.nan, f"< {SFF_TOLERANCE}", False)
    error = run.lab.sff_error().values[pressed]
    if np.isfinite(error).any():
        yield Finding("C0 as printed: largest error, norm", float(error.max()), shown_in="%")
        yield from _errors_of(run, pressed, PRINTED, "C0", tuple(SFF_NAMES))


def _errors_of(
    run: xarray.Dataset, judged: np.ndarray, stress: str, equation: str, names: Sequence[str]
) -> Iterator[Finding]:
    """Report the errors of an equation in some of p, q and q/p, which the Frobenius norm does not distinguish."""
    errors = run.lab.sff_errors(stress)
    for name in names:
        values = errors[name].values
        values = values[judged & np.isfinite(values)]
        if len(values):
            label = f"{equation} in {SFF_NAMES[name]}"
            yield Finding(f"{label}, mean relative error", float(values.mean()), shown_in="%")
            yield Finding(f"{label}, RMS relative error", float(np.sqrt(np.mean(values**2))), shown_in="%")


def _check_end(run: xarray.Dataset) -> Iterator[Finding]:
    """Say what ended a run, and what did not; the run fails if a held stress did not reach its target."""
    complete = bool(run.attrs["complete"])
    for clause in Run(run).met_conditions:
        yield Finding(clause, np.nan)
    if reason := run.attrs.get("ended_because", ""):
        yield Finding(f"ended: {reason}", np.nan, holds=complete, decides=not complete)


def _check_statistics(run: xarray.Dataset) -> Iterator[Finding]:
    """Compare the registered statistics that the run recorded with values recomputed from its contacts."""
    for statistic in recorded_statistics():
        if statistic.name in run and run.sizes["snapshot"]:
            recomputed = np.array([statistic(snapshot) for snapshot in run.lab.snapshots()])
            stored = run.lab.at_snapshots(statistic.name).values
            size = np.maximum(np.abs(stored).max(initial=0.0), np.finfo(float).tiny)
            difference = float(np.nanmax(np.abs(recomputed - stored), initial=0.0) / size)
            yield _below(f"stored {statistic.name} against its contacts", difference, RECOMPUTED_TOLERANCE)


def _check_held(run: xarray.Dataset) -> Iterator[Finding]:
    """Check the quantities that the path declares as held; stresses are checked after the first 0.5 % strain."""
    path = path_of(run.attrs["path"], json.loads(run.attrs["path_parameters"]))
    if path is None:
        name = f"held: path {run.attrs['path']} is unknown here, give --use FILE"
        yield Finding(name, np.nan, holds=False, decides=True, failing="NOT CHECKED")
        return
    for condition in path.held():
        if condition.kind == "volume":
            volume = run["volume"].values
            yield _below(f"held: {condition.name}, drift", np.abs(volume / volume[0] - 1.0).max(), VOLUME_TOLERANCE)
        elif condition.kind == "strain" and condition.measure is not None:
            strains = to_six(symmetric(run["strain"].values)) @ np.transpose(condition.measure)
            yield _below(f"held: {condition.name}, difference", np.abs(strains).max(), STRAIN_TOLERANCE)
    for name, error in limits.held_errors(path, run.lab.scene, run.lab.records_with_limits()):
        judged = error[np.isfinite(error)]
        if not judged.size:
            yield Finding(f"{name}, not checked below {limits.HELD_AFTER:.1%} strain", np.nan)
        else:
            yield _below(f"{name}, error RMS", np.sqrt(np.mean(judged**2)), limits.HELD_RMS, "%")
            yield _below(f"{name}, largest error", np.abs(judged).max(), limits.HELD_WORST, "%")


def _below(name: str, value: float, limit: float, shown_in: str = "", decides: bool = True) -> Finding:
    return Finding(name, float(value), f"< {limit:g}", bool(value < limit), decides, shown_in)


def _difference(recomputed: np.ndarray, stored: np.ndarray) -> float:
    """Return the largest relative difference between tensors: 0 if both are zero, NaN if one of them is NaN."""
    size = np.maximum(np.linalg.norm(stored, axis=(-2, -1)), np.finfo(float).tiny)
    return float(np.max(np.linalg.norm(recomputed - stored, axis=(-2, -1)) / size, initial=0.0))


def _limits(run: xarray.Dataset) -> Iterator[Finding]:
    scene = run.lab.scene
    radius = run.lab.body_radius
    most = {
        "highest mean stress p": (run.lab.mean_stress().values, limits.pressure_limit(scene), "MPa"),
        "largest mean overlap, delta/D": (run["overlap_ratio"].values, limits.OVERLAP_LIMIT, "%"),
        "largest inertial number": (run["inertial_number"].values, limits.INERTIAL_LIMIT, ""),
    }
    if _has_values(run, "drift_velocity"):
        most["momentum: mean motion, share of the kinetic energy"] = drift_share(run), limits.DRIFT_LIMIT, "%"
    if _has_values(run, "energy_balance_error"):
        most["energy balance, error relative to the work"] = np.abs(_balance_error(run)), BALANCE_LIMIT, "%"
    for name, (values, limit, shown_in) in most.items():
        largest = float(np.max(np.asarray(values), initial=0.0))  # NaN and inf remain, and exceed every limit
        yield _below(name, largest, limit, shown_in, decides=False)
    low, high = limits.GRAINS_LIMIT
    ratio = len(radius) / (grain_volume(radius) / mean_grain_volume(scene))
    if scene.of_the_paper:
        cube = len(radius) * 64e-9 / float(run["volume"][0])
        name = f"grains per cube of 4 mm, as in the paper (here {len(radius)})"
        yield Finding(name, cube, f"{low} to {high}", low <= cube <= high)
    stress = run["stress"].values[:1]
    if len(stress) and mean_stress(stress)[0] > 0.0:
        start = float((equivalent_stress(stress) / mean_stress(stress))[0])
        yield Finding("q (invariant)/p at the first record", start, shown_in="%")
    width = relative_width(run["cell"].values, radius)
    yield Finding("least width of the cell, in largest grains", width, "> 2", width > LEAST_WIDTH)
    yield Finding("grains / (solid volume / mean grain volume)", ratio, "0.97 to 1.03", abs(ratio - 1.0) < 0.03)


def _balance_error(run: xarray.Dataset) -> np.ndarray:
    """Return the error of the energy balance at the records, including energy that the contact law creates."""
    error, file = run["energy_balance_error"].values, run.encoding.get("source")
    if file is None or run.sizes["time"] == 0 or "ledger" not in run.attrs:
        return error
    with open_netcdf(file, "run") as dataset:
        if "checkpoint" not in dataset.groups or len(dataset.dimensions["time"]) != len(error):
            return error
        created = np.array(ratcheting_of(dataset["checkpoint"], len(error)).work)
    return error + relative_to_work(created, run["cell_work"].values, float(run.attrs["ledger"][0]))


def _has_values(run: xarray.Dataset, name: str) -> bool:
    """Return True if a variable has values; runs of earlier versions, or of engines without losses, may lack it."""
    return not bool(np.isnan(run[name].values[-1:]).all())


def drift_share(run: xarray.Dataset) -> np.ndarray:
    """Return the fraction of kinetic energy due to motion of the centre of mass, (time,); 0 where nothing moves."""
    mass = run.lab.scene.mass(run.lab.body_radius).sum()
    drift = 0.5 * mass * (run["drift_velocity"].values ** 2).sum(axis=1)
    kinetic = run["kinetic_energy"].values
    return np.divide(drift, kinetic, out=np.zeros_like(drift), where=kinetic > 0.0)


def findings_table(run: xarray.Dataset, rows: int = 20) -> str:
    """Tabulate approximately `rows` records of a run as text, including the first and the last.

    The strain is the strain measure of the path. A_s, F_s and Ft_s are components along the stress deviator. `by
    volume` is the error of the equation by volume, NaN in older files.
    """
    heading = "{:>8} {:>9} {:>9} {:>7} {:>9} {:>7} {:>7} {:>7} {:>9} {:>9}"
    names = [f"{name}_{'zz' if run.lab.axisymmetric else 's'}" for name in ("A", "F", "Ft")]
    header = heading.format("strain", "p", "q", "Z", "Lambda", *names, "C0 error", "by volume")
    units = heading.format("%", "MPa", "MPa", "", "", "", "", "", "%", "%")
    lab, tensors = run.lab, ("contact_anisotropy", "normal_force_anisotropy", "mobilisation")
    stresses = lab.strain() * 100, lab.mean_stress() / 1e6, lab.q() / 1e6
    fabric = run["coordination_number"], run["mean_normalised_force"], *map(lab.component, tensors)
    by_volume = lab.sff_error(BY_VOLUME) if BY_VOLUME in run else np.nan * lab.sff_error()
    table = np.transpose([column.values for column in (*stresses, *fabric, lab.sff_error() * 100, by_volume * 100)])
    style = "{:8.3f} {:9.4f} {:9.4f} {:7.3f} {:9.6f} {:7.3f} {:7.3f} {:7.4f} {:9.3f} {:9.3f}"
    shown = np.unique(np.linspace(0, len(table) - 1, min(rows, len(table))).round().astype(int))
    return "\n".join([header, units, *(style.format(*table[k]) for k in shown)])
