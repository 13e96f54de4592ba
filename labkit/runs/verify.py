"""SFF against Love for a run: a table, checks, limits and a figure."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas
import xarray

from labkit.dem.energy import BALANCE_LIMIT
from labkit.dem.limits import DRIFT_LIMIT, GRAINS_LIMIT, INERTIAL_LIMIT, OVERLAP_LIMIT, pressure_limit
from labkit.dem.paths import Held, path_of, travelled
from labkit.dem.recorded import recorded
from labkit.dem.specimen import mean_grain_volume
from labkit.errors import InputError
from labkit.micro.void_ratio import grain_volume
from labkit.runs.dataset import open_run
from labkit.runs.run import Run

SFF_TOLERANCE = 0.02  # of Love, Frobenius norm
SFF_PRESSURE = 50e3  # Pa: below it C0 is not judged
RECOMPUTED_TOLERANCE = 1e-9
VOLUME_TOLERANCE = 1e-10
STRAIN_TOLERANCE = 1e-10
HELD_RMS, HELD_WORST = 0.005, 0.02  # of the stress that a path holds
HELD_AFTER = 0.005  # axial strain travelled until then


@dataclasses.dataclass(frozen=True)
class Finding:
    """One line of the report; `decides` tells a check, which fails a verification, from a limit."""

    name: str
    value: float
    limit: str
    holds: bool
    decides: bool

    def __str__(self) -> str:
        verdict = ("-" if np.isnan(self.value) else "ok") if self.holds else ("FAILED" if self.decides else "outside")
        return f"{self.name:<52} {self.value:>11.4g}   {self.limit:<22} {verdict}"


def require_contacts(runs: Mapping[str, xarray.Dataset]) -> None:
    """Raises InputError for a run without grains, a prediction of the model. `runs`: name -> run."""
    for name, run in runs.items():
        if run.attrs.get("engine") == "model":
            raise InputError(
                f"{name} is a prediction of the model (engine = model): it has no contacts, its stress is C0 itself "
                "and there is nothing to verify; give runs of grains, or look at it with labkit watch or critical"
            )


def verify(run: Run | xarray.Dataset | str | os.PathLike[str]) -> list[Finding]:
    """The checks and limits of a run, an open one or a file: C0 against Love, what the path holds, the limits.

    It passes if every Finding that `decides` holds. Raises InputError for a run without grains.
    """
    if isinstance(run, (str, os.PathLike)):
        run = open_run(run)
    data = run.data if isinstance(run, Run) else run
    require_contacts({"the run": data})
    return findings(data)


def findings(run: xarray.Dataset) -> list[Finding]:
    """The checks and limits of a run opened with labkit.open_run, a list of Finding."""
    return [*_checks(run), *_limits(run)]


def findings_csv(found: Mapping[str, Sequence[Finding]]) -> str:
    """All findings of some runs as CSV text; `found`: name of the run -> list of Finding."""
    rows = [{"run": name, **dataclasses.asdict(finding)} for name, lines in found.items() for finding in lines]
    return pandas.DataFrame(rows).to_csv(index=False, float_format="%.5g")


def _checks(run):
    judged = run.lab.mean_stress().values > SFF_PRESSURE
    error = run.lab.sff_error().values
    worst = float(error[judged].max()) if judged.any() else np.nan
    recomputed = np.max(
        [
            _difference(run.lab.love_stress().values, run.lab.at_snapshots("stress").values),
            _difference(run.lab.sff_stress().values, run.lab.at_snapshots("stress_sff").values),
        ]
    )
    unknown = int((~np.isfinite(run["stress"].values)).any(axis=(1, 2)).sum())
    yield Finding("records whose stress is no number", unknown, "0", unknown == 0, True)
    if judged.any():
        name = f"C0 against Love, worst of {judged.sum()} records, p > 50 kPa"
        yield Finding(name, worst, f"< {SFF_TOLERANCE}", worst < SFF_TOLERANCE, True)
    else:
        name = "C0 against Love: not judged, no record with p > 50 kPa"
        yield Finding(name, np.nan, f"< {SFF_TOLERANCE}", False, False)
    yield Finding(
        f"stored stress against its contacts, {run.sizes['snapshot']} snapshots",
        recomputed,
        f"< {RECOMPUTED_TOLERANCE:g}",
        recomputed < RECOMPUTED_TOLERANCE,
        True,
    )
    yield from _recorded(run)
    yield from _held(run)


def _recorded(run: xarray.Dataset) -> Iterator[Finding]:
    """The statistics of one's own that the run holds, against its contacts."""
    for statistic in recorded():
        if statistic.name in run and run.sizes["snapshot"]:
            found = np.array([statistic(snapshot) for snapshot in run.lab.snapshots()])
            stored = run.lab.at_snapshots(statistic.name).values
            size = np.maximum(np.abs(stored).max(initial=0.0), np.finfo(float).tiny)
            difference = float(np.nanmax(np.abs(found - stored), initial=0.0) / size)
            yield _below(f"stored {statistic.name} against its contacts", difference, RECOMPUTED_TOLERANCE)


def _held(run: xarray.Dataset) -> Iterator[Finding]:
    """Whether the run kept what its path says that it holds; stresses after the first half per cent of strain."""
    path = path_of(run.attrs["path"], json.loads(run.attrs["path_parameters"]))
    if path is None:
        name = f"held: path {run.attrs['path']} is unknown here, give --use FILE"
        yield Finding(name, np.nan, "", False, True)
        return
    for held in path.held():
        if held.kind == "volume":
            volume = run["volume"].values
            yield _below(f"held: {held.name}, drift", np.abs(volume / volume[0] - 1.0).max(), VOLUME_TOLERANCE)
        elif held.kind == "strain":
            strains = np.diagonal(run["strain"].values, axis1=1, axis2=2) @ np.transpose(held.measure)
            yield _below(f"held: {held.name}, difference", np.abs(strains).max(), STRAIN_TOLERANCE)
        else:
            yield from _held_stress(run, held)


def _held_stress(run: xarray.Dataset, held: Held) -> Iterator[Finding]:
    stress = np.diagonal(run["stress"].values, axis1=1, axis2=2) @ np.transpose(held.measure)
    error = stress[travelled(run["axial_strain"].values) > HELD_AFTER] / held.target - 1.0
    if not error.size:
        yield Finding(f"held: {held.name}, not checked below {HELD_AFTER:.1%} strain", np.nan, "", True, False)
    else:
        yield _below(f"held: {held.name}, error RMS", np.sqrt(np.mean(error**2)), HELD_RMS)
        yield _below(f"held: {held.name}, error at worst", np.abs(error).max(), HELD_WORST)


def _below(name, value, limit):
    return Finding(name, float(value), f"< {limit:g}", bool(value < limit), True)


def _difference(found, stored):
    """Largest relative difference of tensors; 0 where both are zero, NaN where one is no number."""
    size = np.maximum(np.linalg.norm(stored, axis=(-2, -1)), np.finfo(float).tiny)
    return float(np.max(np.linalg.norm(found - stored, axis=(-2, -1)) / size, initial=0.0))


def _limits(run):
    scene = run.lab.scene
    radius = run["radius"].values
    most = {
        "highest mean stress p, Pa": (run.lab.mean_stress().values, pressure_limit(scene)),
        "largest mean overlap, delta/D": (run["overlap_ratio"].values, OVERLAP_LIMIT),
        "largest inertial number": (run["inertial_number"].values, INERTIAL_LIMIT),
    }
    if _known(run, "drift_velocity"):
        most["momentum: share of drift in the kinetic energy"] = drift_share(run), DRIFT_LIMIT
    if _known(run, "energy_balance_error"):
        most["energy balance, error over the work"] = np.abs(run["energy_balance_error"].values), BALANCE_LIMIT
    for name, (values, limit) in most.items():
        value = _largest(values)
        yield Finding(name, value, f"< {limit:g}", value < limit, False)
    low, high = GRAINS_LIMIT
    expected = grain_volume(radius) / mean_grain_volume(scene)
    cube = len(radius) * 64e-9 / float(run["volume"][0])
    yield Finding(f"grains per cube of 4 mm (here {len(radius)})", cube, f"{low} to {high}", low <= cube <= high, False)
    yield Finding(
        "grains over what the mean grain makes of the solid",
        len(radius) / expected,
        "0.97 to 1.03",
        abs(len(radius) / expected - 1.0) < 0.03,
        False,
    )


def _known(run: xarray.Dataset, name: str) -> bool:
    """Whether the file holds the variable; an earlier version may not have recorded it."""
    return not bool(np.isnan(run[name].values).all())


def drift_share(run: xarray.Dataset) -> np.ndarray:
    """Share of the moving centre of mass in the kinetic energy at each record, shape (time,); 0 where nothing moves."""
    mass = run.lab.scene.mass(run["radius"].values).sum()
    drift = 0.5 * mass * (run["drift_velocity"].values ** 2).sum(axis=1)
    kinetic = run["kinetic_energy"].values
    return np.divide(drift, kinetic, out=np.zeros_like(drift), where=kinetic > 0.0)


def _largest(values):
    """The largest value; NaN and inf count, and are within no limit."""
    return float(np.max(np.asarray(values), initial=0.0))


def table(run: xarray.Dataset, rows: int = 20) -> str:
    """The table of a run as text: about so many records, the first and the last among them."""
    heading = "{:>8} {:>9} {:>9} {:>7} {:>9} {:>7} {:>7} {:>7} {:>9}"
    header = heading.format("strain", "p", "q", "Z", "Lambda", "A_zz", "F_zz", "Ft_zz", "C0 error")
    units = heading.format("%", "MPa", "MPa", "", "", "", "", "", "%")
    p, q, error = run.lab.mean_stress().values, run.lab.deviatoric_stress().values, run.lab.sff_error().values
    zz = {"i": 2, "j": 2}
    columns = (
        run["axial_strain"].values * 100,
        p / 1e6,
        q / 1e6,
        run["coordination_number"].values,
        run["mean_normalised_force"].values,
        run["contact_anisotropy"].isel(zz).values,
        run["normal_force_anisotropy"].isel(zz).values,
        run["mobilisation"].isel(zz).values,
        error * 100,
    )
    style = "{:8.3f} {:9.4f} {:9.4f} {:7.3f} {:9.6f} {:7.3f} {:7.3f} {:7.4f} {:9.3f}"
    shown = np.unique(np.linspace(0, len(p) - 1, min(rows, len(p))).round().astype(int))
    return "\n".join([header, units, *(style.format(*(column[k] for column in columns)) for k in shown)])
