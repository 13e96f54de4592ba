"""What the paper bounds, as rows of the table of fidelity: grains, restitution, inertial number, overlap, pressure, C0,
reversals.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator

import numpy as np

import labkit as lk
from analysis.paper.ends import Runs, main, matching
from analysis.paper.estimates import Estimate
from analysis.speed_error.collisions import Collision, restitution, sampled_outcomes
from analysis.turns import turns
from labkit.dem import GRAINS_LIMIT, INERTIAL_LIMIT, OVERLAP_LIMIT, REVERSALS, pressure_limit
from labkit.model import ROOT_3_2
from labkit.runs import SFF_PRESSURE, SFF_TOLERANCE, SHEAR

MPA = 1e6
NO_RUNS = "no runs"
MOST_NAMED = 4  # runs beyond a limit


def limits(runs: Runs) -> Iterator[dict]:
    """The rows of what the paper bounds: grains, restitution, inertial number, overlap, pressure, C0."""
    own = main(runs)
    yield _grains(matching(runs, "cv-.*"))
    yield _restitution(own)
    yield from _inertial(own)
    yield _bound(
        "overlap",
        "mean overlap delta/D, worst record",
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
        "C0 against Love, worst record with p > 50 kPa",
        monotonic,
        _sff_error,
        SFF_TOLERANCE,
        "(labkit: below 2 %)",
    )
    row["explanation"] = row.get("explanation") and f"{row['explanation']}; sff.csv has what the error is made of"
    yield row
    yield _reversals(matching(runs, "cyclic-.*"))


def _sff_error(run):
    return np.where(run.lab.mean_stress().values > SFF_PRESSURE, run.lab.sff_error().values, np.nan)


def _grains(cubes):
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
        "uncertainty_of": f"{fewest} to {most} over the CV tests: exact counts",
        "runs": " ".join(counts),
        "explanation": ""
        if inside
        else f"Other numbers in {', '.join(outside)}: the seed's diameters and the volume of the cube decide it",
    }


def _restitution(own):
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
        [one["restitution"] for one in sampled_outcomes(Collision(scene, 0.0, {}), scene.time_step / scene.time_unit)]
    )
    found = Estimate(float(measured.mean()), float(1.96 * measured.std()), len(measured))
    difference = found.value - 0.5
    agrees = abs(difference) <= found.within + 0.05
    return {
        **row,
        "ours": found.value,
        "within": found.within,
        "tests": found.n,
        "difference": difference,
        "uncertainty_of": f"{found.n} collisions at the time step of the tests",
        "agrees": "yes" if agrees else "no",
        "in_units": abs(difference) / found.within if found.within else math.nan,
        "explanation": "" if agrees else f"The closed form of beta_n = {scene.beta_n:g} is {restitution(scene):.3f}",
    }


def _inertial(own):
    def inertial(run):
        return run["inertial_number"].values[1:]  # the first record is of a specimen at rest

    sheared_ = {name: run for name, run in own.items() if run.attrs["path"] in SHEAR}
    row = _bound(
        "inertial number",
        "inertial number I, worst record of shear tests",
        sheared_,
        inertial,
        INERTIAL_LIMIT,
        "below 3e-4",
    )
    if row["agrees"] == "no":
        above = {name: inertial(run) > INERTIAL_LIMIT for name, run in sheared_.items()}
        by_rate = sum(
            int(np.sum(above[name] & (run.lab.mean_stress().values[1:] < _pressure_of_limit(run))))
            for name, run in sheared_.items()
        )
        row["explanation"] += (
            f"; at {by_rate} of these {sum(map(np.sum, above.values()))} records the axial rate alone makes it, as p "
            f"is below {max(map(_pressure_of_limit, sheared_.values())) / MPA:.2g} MPa"
        )
    yield row
    yield _bound(
        "inertial number, p > 0.1 MPa",
        "inertial number I, worst record with p > 0.1 MPa",
        sheared_,
        lambda run: np.where(run.lab.mean_stress().values[1:] > 0.1 * MPA, inertial(run), np.nan),
        INERTIAL_LIMIT,
        "below 3e-4",
    )


def _pressure_of_limit(run):
    """p (Pa) at which the axial rate of a CV test makes I = |rate| D sqrt(rho/p) the limit."""
    scene = run.lab.scene
    rate = ROOT_3_2 * abs(json.loads(run.attrs["path_parameters"])["rate"])
    return scene.density * (rate * scene.mean_diameter / INERTIAL_LIMIT) ** 2


def _bound(name, label, runs, values, limit, says):
    """The row of something that stays below a limit; the explanation says where it does not."""
    row = {"number": name, "label": label, "paper_says": says, "runs": " ".join(runs)}
    worst = {k: v for k, v in ((k, values(run)) for k, run in runs.items()) if np.isfinite(v).any()}
    if not worst:
        return {**row, "agrees": NO_RUNS}
    highest = {k: float(np.nanmax(v)) for k, v in worst.items()}
    beyond = {k: int(np.sum(v > limit)) for k, v in worst.items() if highest[k] > limit}
    named = sorted(beyond, key=highest.get, reverse=True)[:MOST_NAMED]
    where = ", ".join(f"{k} (at most {highest[k]:.3g}, {beyond[k]} of {len(worst[k])} records)" for k in named)
    where += f" and {len(beyond) - len(named)} more" if len(beyond) > len(named) else ""
    return {
        **row,
        "ours": max(highest.values()),
        "tests": len(worst),
        "uncertainty_of": "exact: the worst of all records",
        "difference": max(highest.values()) - limit,
        "agrees": "no" if beyond else "yes",
        "explanation": f"Beyond the limit: {where}" if beyond else "",
    }


def _reversals(cyclic):
    row = {
        "number": "reversals",
        "label": "cyclic CP: largest miss of a reversal (axial strain)",
        "paper": 0.0,
        "paper_rounding": 1e-3,
        "paper_says": "1, -1, 2, -2, 3, -3, 4 %",
    }
    if not cyclic:
        return {**row, "agrees": NO_RUNS}
    misses = []
    for run in cyclic.values():
        strain = run["axial_strain"].values
        found = np.append(strain[turns(strain)], strain[-1])
        misses.append(np.abs(found - REVERSALS).max() if len(found) == len(REVERSALS) else math.inf)
    worst = float(max(misses))
    return {
        **row,
        "ours": worst,
        "tests": len(cyclic),
        "uncertainty_of": "exact",
        "difference": worst,
        "agrees": "yes" if worst <= 1e-3 else "no",
        "runs": " ".join(cyclic),
        "explanation": "" if worst <= 1e-3 else "The tests turn elsewhere, or are not finished",
    }
