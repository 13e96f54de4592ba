"""Quantities that the paper bounds, as rows of the fidelity table.

These are the number of grains, the restitution, the inertial number, the overlap, the pressure, the error of C0 and
the reversals of the cyclic tests.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import xarray as xr

import labkit as lk
from analysis.curves import turns
from analysis.paper.ends import Runs, main, matching
from analysis.speed_error.collisions import Collision, restitution, sampled_outcomes
from labkit.model import ROOT_3_2
from labkit.paths import REVERSALS
from labkit.records import GRAINS_LIMIT, INERTIAL_LIMIT, OVERLAP_LIMIT, pressure_limit
from labkit.results import SFF_PRESSURE, SFF_TOLERANCE, SHEAR

MPA = 1e6
NO_RUNS = "no runs"
MOST_NAMED = 4  # at most this many runs above a limit are named
Row = dict[str, Any]


def limits(runs: Runs) -> Iterator[Row]:
    """Yields one row per quantity that the paper bounds; `kind` is `limit`, or `input` for values that were chosen."""
    own = main(runs)
    yield _grains(matching(runs, "cv-.*"))
    yield _restitution(own)
    yield from _inertial(own)
    label = "mean overlap relative to the diameter, worst record"
    yield _bound("overlap", label, own, lambda run: run["overlap_ratio"].values, OVERLAP_LIMIT, "below 2 %")
    label, limit = "mean stress p, worst record (MPa)", pressure_limit(lk.Scene()) / MPA
    yield _bound("pressure", label, own, lambda run: run.lab.mean_stress().values / MPA, limit, "below 3 MPa")
    monotonic = {name: run for name, run in own.items() if run.attrs["path"] != "cyclic_cp"}
    label = "error of C0 against Love's stress, worst record with p > 50 kPa"
    row = _bound("C0", label, monotonic, _sff_error, SFF_TOLERANCE, "below 2 % (labkit's own limit)")
    row["explanation"] = row.get("explanation") and f"{row['explanation']}; sff.csv splits the error into its causes"
    yield row
    yield _reversals(matching(runs, "cyclic-.*"))


def _row(number: str, label: str, says: str, kind: str = "limit", **measured: Any) -> Row:
    """A row of the table; if nothing was measured, the verdict is that there are no runs."""
    return {"kind": kind, "number": number, "label": label, "paper_says": says, "agrees": NO_RUNS, **measured}


def _verdict(agrees: bool, explanation: str) -> Row:
    return {"agrees": "yes" if agrees else "no", "explanation": "" if agrees else explanation}


def _sff_error(run: xr.Dataset) -> np.ndarray:
    return np.where(run.lab.mean_stress().values > SFF_PRESSURE, run.lab.sff_error().values, np.nan)


def _grains(cubes: Runs) -> Row:
    counts = {name: run.attrs["grains"] for name, run in cubes.items() if run.attrs["grains"]}
    low, high = GRAINS_LIMIT
    row = _row("grains", "grains in a cube of 4 mm, fewest and most", f"{low} to {high}", "input")
    if not counts:
        return row
    fewest, most = min(counts.values()), max(counts.values())
    outside = ", ".join(name for name, count in counts.items() if not low <= count <= high)
    why = f"Outside the range: {outside}; the count follows from the random diameters and the cube"
    basis = f"exact counts: {fewest} to {most} in the CV tests"
    ours = {"ours": most, "tests": len(counts), "uncertainty_of": basis, "runs": " ".join(counts)}
    return row | ours | _verdict(not outside, why)


def _restitution(own: Runs) -> Row:
    scenes = {run.lab.scene for run in own.values() if run.lab.scene.law == "spring_dashpot"}
    row = _row("restitution", "restitution of a head-on pair", "about 0.5", "input", paper=0.5, paper_rounding=0.05)
    if not scenes:
        return row
    scene = max(scenes, key=lambda scene: scene.time_step)
    outcomes = sampled_outcomes(Collision(scene, 0.0, {}), scene.time_step / scene.time_unit)
    measured = np.array([outcome["restitution"] for outcome in outcomes])
    ours, within = float(measured.mean()), float(1.96 * measured.std())
    difference = ours - 0.5
    row |= {"ours": ours, "within": within, "tests": len(measured), "difference": difference}
    row["uncertainty_of"] = f"{len(measured)} collisions at the time step of the tests"
    row["in_units"] = abs(difference) / within if within else math.nan
    why = f"The closed-form restitution for beta_n = {scene.beta_n:g} is {restitution(scene):.3f}"
    return row | _verdict(abs(difference) <= within + 0.05, why)


def _inertial(own: Runs) -> Iterator[Row]:
    def inertial(run: xr.Dataset) -> np.ndarray:
        return run["inertial_number"].values[1:]  # the specimen is at rest at the first record

    def pressure(run: xr.Dataset) -> np.ndarray:
        return run.lab.mean_stress().values[1:]

    tests = {name: run for name, run in own.items() if run.attrs["path"] in SHEAR}
    label = "inertial number I, worst record of shear tests"
    row = _bound("inertial number", label, tests, inertial, INERTIAL_LIMIT, "below 3e-4")
    if row["agrees"] == "no":
        above = {name: inertial(run) > INERTIAL_LIMIT for name, run in tests.items()}
        low = {name: pressure(run) < _pressure_of_limit(run) for name, run in tests.items()}
        by_rate = sum(int((above[name] & low[name]).sum()) for name in tests)
        row["explanation"] += (
            f"; at {by_rate} of these {sum(int(records.sum()) for records in above.values())} records the axial "
            f"rate is enough to exceed it, as p is below {max(map(_pressure_of_limit, tests.values())) / MPA:.2g} MPa"
        )
    yield row
    name, label = "inertial number, p > 0.1 MPa", "inertial number I, worst record with p > 0.1 MPa"

    def pressed(run: xr.Dataset) -> np.ndarray:
        return np.where(pressure(run) > 0.1 * MPA, inertial(run), np.nan)

    yield _bound(name, label, tests, pressed, INERTIAL_LIMIT, "below 3e-4")


def _pressure_of_limit(run: xr.Dataset) -> float:
    """p (Pa) at which I = |rate| D sqrt(rho/p) of a CV test reaches the limit."""
    scene = run.lab.scene
    rate = ROOT_3_2 * abs(json.loads(run.attrs["path_parameters"])["rate"])
    return scene.density * (rate * scene.mean_diameter / INERTIAL_LIMIT) ** 2


def _bound(
    name: str, label: str, runs: Runs, values: Callable[[xr.Dataset], np.ndarray], limit: float, says: str
) -> Row:
    """Row of a quantity that should stay below a limit; the explanation names the runs in which it does not."""
    row = _row(name, label, says, runs=" ".join(runs))
    worst = {k: v for k, v in ((k, values(run)) for k, run in runs.items()) if np.isfinite(v).any()}
    if not worst:
        return row
    highest = {k: float(np.nanmax(v)) for k, v in worst.items()}
    above = {k: int(np.sum(v > limit)) for k, v in worst.items() if highest[k] > limit}
    named = sorted(above, key=lambda k: highest[k], reverse=True)[:MOST_NAMED]
    where = ", ".join(f"{k} ({above[k]} of {len(worst[k])} records, largest {highest[k]:.4g})" for k in named)
    where += f" and {len(above) - len(named)} more" if len(above) > len(named) else ""
    largest = max(highest.values())
    row |= {"ours": largest, "tests": len(worst), "difference": largest - limit}
    return row | {"uncertainty_of": "exact: worst of all records"} | _verdict(not above, f"Exceeds the limit: {where}")


def _reversals(cyclic: Runs) -> Row:
    label, says = "cyclic CP: largest error of a reversal (axial strain)", "1, -1, 2, -2, 3, -3, 4 %"
    row = _row("reversals", label, says, "input", paper=0.0, paper_rounding=1e-3)
    if not cyclic:
        return row
    errors = []
    for run in cyclic.values():
        strain = run["axial_strain"].values
        reversals = np.append(strain[turns(strain)], strain[-1])
        errors.append(np.abs(reversals - REVERSALS).max() if len(reversals) == len(REVERSALS) else math.inf)
    worst = float(max(errors))
    row |= {"ours": worst, "tests": len(cyclic), "uncertainty_of": "exact", "difference": worst}
    row["runs"] = " ".join(cyclic)
    return row | _verdict(worst <= 1e-3, "The tests reverse at other strains, or are unfinished")
