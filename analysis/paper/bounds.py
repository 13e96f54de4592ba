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
from analysis.paper.ends import Runs, main, matching
from analysis.speed_error.collisions import Collision, restitution, sampled_outcomes
from analysis.statistics import Estimate
from analysis.turns import turns
from labkit.model import ROOT_3_2
from labkit.paths import REVERSALS
from labkit.records import GRAINS_LIMIT, INERTIAL_LIMIT, OVERLAP_LIMIT, pressure_limit
from labkit.runs import SFF_PRESSURE, SFF_TOLERANCE, SHEAR

MPA = 1e6
NO_RUNS = "no runs"
MOST_NAMED = 4  # runs that exceed a limit
Row = dict[str, Any]


def limits(runs: Runs) -> Iterator[Row]:
    """Yields one row per quantity that the paper bounds; `kind` is `limit`, or `input` for what was put in."""
    for row in _limits(runs):
        yield {"kind": "input" if row["number"] in PUT_IN else "limit", **row}


PUT_IN = ("grains", "restitution", "reversals")


def _limits(runs: Runs) -> Iterator[Row]:
    own = main(runs)
    yield _grains(matching(runs, "cv-.*"))
    yield _restitution(own)
    yield from _inertial(own)
    yield _bound(
        "overlap",
        "mean overlap relative to the diameter, worst record",
        own,
        lambda run: run["overlap_ratio"].values,
        OVERLAP_LIMIT,
        "below 2 %",
    )
    yield _bound(
        "pressure",
        "mean stress p, worst record (MPa)",
        own,
        lambda run: run.lab.mean_stress().values / MPA,
        pressure_limit(lk.Scene()) / MPA,
        "below 3 MPa",
    )
    monotonic = {name: run for name, run in own.items() if run.attrs["path"] != "cyclic_cp"}
    row = _bound(
        "C0",
        "error of C0 against Love's stress, worst record with p > 50 kPa",
        monotonic,
        _sff_error,
        SFF_TOLERANCE,
        "below 2 % (labkit's own limit)",
    )
    row["explanation"] = row.get("explanation") and f"{row['explanation']}; sff.csv splits the error into its causes"
    yield row
    yield _reversals(matching(runs, "cyclic-.*"))


def _sff_error(run: xr.Dataset) -> np.ndarray:
    return np.where(run.lab.mean_stress().values > SFF_PRESSURE, run.lab.sff_error().values, np.nan)


def _grains(cubes: Runs) -> Row:
    counts = {name: run.attrs["grains"] for name, run in cubes.items() if run.attrs["grains"]}
    low, high = GRAINS_LIMIT
    row = {"number": "grains", "label": "grains in a cube of 4 mm, fewest and most", "paper_says": f"{low} to {high}"}
    if not counts:
        return {**row, "agrees": NO_RUNS}
    fewest, most = min(counts.values()), max(counts.values())
    inside = low <= fewest and most <= high
    outside = [name for name, count in counts.items() if not low <= count <= high]
    return {
        **row,
        "ours": most,
        "within": math.nan,
        "tests": len(counts),
        "agrees": "yes" if inside else "no",
        "uncertainty_of": f"exact counts: {fewest} to {most} in the CV tests",
        "runs": " ".join(counts),
        "explanation": ""
        if inside
        else f"Outside the range: {', '.join(outside)}; the count follows from the random diameters and the cube",
    }


def _restitution(own: Runs) -> Row:
    scenes = {run.lab.scene for run in own.values() if run.lab.scene.law == "spring_dashpot"}
    row = {
        "number": "restitution",
        "label": "restitution of a head-on pair",
        "paper": 0.5,
        "paper_rounding": 0.05,
        "paper_says": "about 0.5",
    }
    if not scenes:
        return {**row, "agrees": NO_RUNS}
    scene = max(scenes, key=lambda scene: scene.time_step)
    measured = np.array(
        [
            outcome["restitution"]
            for outcome in sampled_outcomes(Collision(scene, 0.0, {}), scene.time_step / scene.time_unit)
        ]
    )
    ours = Estimate(float(measured.mean()), float(1.96 * measured.std()), len(measured))
    difference = ours.value - 0.5
    agrees = abs(difference) <= ours.within + 0.05
    return {
        **row,
        "ours": ours.value,
        "within": ours.within,
        "tests": ours.n,
        "difference": difference,
        "uncertainty_of": f"{ours.n} collisions at the time step of the tests",
        "agrees": "yes" if agrees else "no",
        "in_units": abs(difference) / ours.within if ours.within else math.nan,
        "explanation": ""
        if agrees
        else f"The closed-form restitution for beta_n = {scene.beta_n:g} is {restitution(scene):.3f}",
    }


def _inertial(own: Runs) -> Iterator[Row]:
    def inertial(run: xr.Dataset) -> np.ndarray:
        return run["inertial_number"].values[1:]  # at the first record the specimen is at rest

    shear_tests = {name: run for name, run in own.items() if run.attrs["path"] in SHEAR}
    row = _bound(
        "inertial number",
        "inertial number I, worst record of shear tests",
        shear_tests,
        inertial,
        INERTIAL_LIMIT,
        "below 3e-4",
    )
    if row["agrees"] == "no":
        above = {name: inertial(run) > INERTIAL_LIMIT for name, run in shear_tests.items()}
        by_rate = sum(
            int(np.sum(above[name] & (run.lab.mean_stress().values[1:] < _pressure_of_limit(run))))
            for name, run in shear_tests.items()
        )
        row["explanation"] += (
            f"; at {by_rate} of these {sum(int(np.sum(records)) for records in above.values())} records the axial "
            f"rate is enough to exceed it, as p is below "
            f"{max(map(_pressure_of_limit, shear_tests.values())) / MPA:.2g} MPa"
        )
    yield row
    yield _bound(
        "inertial number, p > 0.1 MPa",
        "inertial number I, worst record with p > 0.1 MPa",
        shear_tests,
        lambda run: np.where(run.lab.mean_stress().values[1:] > 0.1 * MPA, inertial(run), np.nan),
        INERTIAL_LIMIT,
        "below 3e-4",
    )


def _pressure_of_limit(run: xr.Dataset) -> float:
    """p (Pa) at which I = |rate| D sqrt(rho/p) of a CV test reaches the limit."""
    scene = run.lab.scene
    rate = ROOT_3_2 * abs(json.loads(run.attrs["path_parameters"])["rate"])
    return scene.density * (rate * scene.mean_diameter / INERTIAL_LIMIT) ** 2


def _bound(
    name: str, label: str, runs: Runs, values: Callable[[xr.Dataset], np.ndarray], limit: float, says: str
) -> Row:
    """Row of a quantity that should stay below a limit; the explanation names the runs in which it does not."""
    row = {"number": name, "label": label, "paper_says": says, "runs": " ".join(runs)}
    worst = {k: v for k, v in ((k, values(run)) for k, run in runs.items()) if np.isfinite(v).any()}
    if not worst:
        return {**row, "agrees": NO_RUNS}
    highest = {k: float(np.nanmax(v)) for k, v in worst.items()}
    above = {k: int(np.sum(v > limit)) for k, v in worst.items() if highest[k] > limit}
    named = sorted(above, key=lambda k: highest[k], reverse=True)[:MOST_NAMED]
    where = ", ".join(f"{k} ({above[k]} of {len(worst[k])} records, largest {highest[k]:.4g})" for k in named)
    where += f" and {len(above) - len(named)} more" if len(above) > len(named) else ""
    return {
        **row,
        "ours": max(highest.values()),
        "tests": len(worst),
        "uncertainty_of": "exact: worst of all records",
        "difference": max(highest.values()) - limit,
        "agrees": "no" if above else "yes",
        "explanation": f"Exceeds the limit: {where}" if above else "",
    }


def _reversals(cyclic: Runs) -> Row:
    row = {
        "number": "reversals",
        "label": "cyclic CP: largest error of a reversal (axial strain)",
        "paper": 0.0,
        "paper_rounding": 1e-3,
        "paper_says": "1, -1, 2, -2, 3, -3, 4 %",
    }
    if not cyclic:
        return {**row, "agrees": NO_RUNS}
    errors = []
    for run in cyclic.values():
        strain = run["axial_strain"].values
        reversals = np.append(strain[turns(strain)], strain[-1])
        errors.append(np.abs(reversals - REVERSALS).max() if len(reversals) == len(REVERSALS) else math.inf)
    worst = float(max(errors))
    return {
        **row,
        "ours": worst,
        "tests": len(cyclic),
        "uncertainty_of": "exact",
        "difference": worst,
        "agrees": "yes" if worst <= 1e-3 else "no",
        "runs": " ".join(cyclic),
        "explanation": "" if worst <= 1e-3 else "The tests reverse at other strains, or are unfinished",
    }
