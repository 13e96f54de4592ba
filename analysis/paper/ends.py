"""Which runs of the campaign are compared, and their starts and ends as tables."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping

import numpy as np
import pandas
import xarray as xr

from analysis.paper.estimates import BLOCKS
from labkit.dem import travelled
from labkit.io import RECORD
from labkit.runs import HELD_AFTER, SHEAR, TENSORS, WINDOW, critical_states

Runs = Mapping[str, xr.Dataset]  # name -> run, as labkit.open_run gives it

ENOUGH_STRAIN = 0.15  # from which the last quarter of a shear test is near the critical state
RELAXATIONS = np.geomspace(0.02, 0.2, 21)  # axial strains; slower than that the last half cannot tell from a line
HOLDS_A_STRESS = ("cr", "cp", "cyclic_cp")
OTHERS = ("share_", "full_")  # tests of the engines and the laws, not of the paper


def in_memory(runs: Runs) -> dict[str, xr.Dataset]:
    """The same runs with their records in memory, without contacts and grains; `grains` is an attribute."""
    found = {}
    for name, run in runs.items():
        found[name] = run[[one for one in RECORD if one in run]].drop_dims("snapshot", errors="ignore").load()
        found[name].attrs = {**run.attrs, "grains": run.sizes["grain"]}
    return found


def main(runs: Runs) -> dict[str, xr.Dataset]:
    """The tests of the paper, at full size, without those that compare engines and laws."""
    return {name: run for name, run in runs.items() if not name.startswith(OTHERS)}


def matching(runs: Runs, pattern: str) -> dict[str, xr.Dataset]:
    """The runs whose whole name the regular expression matches."""
    return {name: run for name, run in runs.items() if re.fullmatch(pattern, name)}


def sheared(runs: Runs, paths: Collection[str] = SHEAR) -> dict[str, xr.Dataset]:
    """The shear tests among the runs that went far enough to have a critical state."""
    return {
        name: run
        for name, run in runs.items()
        if run.attrs["path"] in paths and float(run["axial_strain"][-1]) >= ENOUGH_STRAIN
    }


def between(run: xr.Dataset, begin: float, end: float) -> xr.Dataset:
    """The records from one axial strain to another, of a monotonic test."""
    strain = run["axial_strain"].values
    return run.isel(time=(strain >= begin) & (strain <= end))


def ends(runs: Runs, begin: float = 1.0 - WINDOW, end: float = 1.0) -> pandas.DataFrame:
    """critical_states between two shares of the strain of each shear test."""
    parts = {}
    for name, run in runs.items():
        last = float(run["axial_strain"][-1])
        parts[name] = between(run, begin * last, end * last)
    return table(parts)


def table(parts: Runs) -> pandas.DataFrame:
    """critical_states over all records of some parts of runs; has its columns without any run too."""
    found = critical_states(parts, window=1.0)
    return found if len(found) else pandas.DataFrame(columns=COLUMNS, dtype=float)


COLUMNS = ("run", "path", "strain", "M", "M_scatter", "p_MPa", "e", "Z", "Lambda", "A_zz", "F_zz", "Ft_zz")


def extrapolated(runs: Runs) -> pandas.DataFrame:
    """What `ends` would be after endless strain: a + b exp(-strain/s) through the last half of the strain of each test.

    A table with the columns of `ends`, without M_scatter, and relaxation_strain, the s that all numbers of a test share
    (of RELAXATIONS, the most likely one when every number has a scatter of its own).
    """
    rows = []
    for name, run in runs.items():
        strain = run["axial_strain"].values
        late = strain >= 0.5 * strain[-1]
        values = _records(run)[late]
        fits = [_exponential(strain[late] - strain[-1], values, relaxation) for relaxation in RELAXATIONS]
        best = int(np.argmin([misfit for misfit, _ in fits]))
        rows.append(
            {
                "run": name,
                "path": run.attrs["path"],
                "strain": strain[-1],
                **dict(zip(values, fits[best][1], strict=True)),
                "relaxation_strain": RELAXATIONS[best],
            }
        )
    return pandas.DataFrame(rows, columns=[*COLUMNS, "relaxation_strain"]).drop(columns="M_scatter")


def _records(run):
    """The numbers of `ends` at every record, a pandas.DataFrame."""
    p, q = run.lab.mean_stress().values, run.lab.deviatoric_stress().values
    zz = {label: run[key].values[:, 2, 2] for key, label in TENSORS.items()}
    return pandas.DataFrame(
        {
            "M": q / p,
            "p_MPa": p / 1e6,
            "e": run["void_ratio"].values,
            "Z": run["coordination_number"].values,
            "Lambda": run["mean_normalised_force"].values,
            **zz,
        }
    ).astype(float)


def _exponential(strain, values, relaxation):
    """(minus the logarithm of the likelihood, the asymptotes) of a + b exp(-strain/relaxation), by least squares."""
    shape = np.stack([np.ones_like(strain), np.exp(-strain / relaxation)], axis=1).astype(float)
    found = np.linalg.lstsq(shape, values.to_numpy(), rcond=None)[0]
    left = np.sum((values.to_numpy() - shape @ found) ** 2, axis=0) / np.sum(values.to_numpy() ** 2, axis=0)
    return float(np.sum(np.log(left + 1e-16))), found[0]


def blocks(name: str, run: xr.Dataset, begin: float, end: float) -> pandas.DataFrame:
    """critical_states of BLOCKS equal parts between two axial strains, for a single test."""
    edges = begin + (end - begin) * np.linspace(0.0, 1.0, BLOCKS + 1)
    found = table({f"{name} {k + 1}": between(run, *edges[k : k + 2]) for k in range(BLOCKS)})
    found.attrs["runs"] = (name,)
    return found


def starts(runs: Runs) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per run: e (overlaps out), e_nominal, p0_MPa of the first record, Z, the void ratio
    that the specimen was made with (NaN: not recorded) and held_MPa, the mean of the stress that the path holds.
    """
    rows = []
    for name, run in runs.items():
        recipe = json.loads(run.attrs.get("recipe") or "{}")
        rows.append(
            {
                "run": name,
                "path": run.attrs["path"],
                "e": float(run["void_ratio"][0]),
                "e_nominal": float(run["void_ratio_nominal"][0]),
                "e_made": float(recipe.get("void_ratio", "nan")),
                "p0_MPa": float(run.lab.mean_stress()[0]) / 1e6,
                "Z": float(run["coordination_number"][0]),
                "held_MPa": _held(run),
            }
        )
    return pandas.DataFrame(rows, columns=["run", "path", "e", "e_nominal", "e_made", "p0_MPa", "Z", "held_MPa"])


def _held(run):
    if run.attrs["path"] not in HOLDS_A_STRESS:
        return float("nan")
    stress = run["stress"].values
    held = 0.5 * (stress[:, 0, 0] + stress[:, 1, 1]) if run.attrs["path"] == "cr" else run.lab.mean_stress().values
    later = travelled(run["axial_strain"].values) > HELD_AFTER
    return float(held[later].mean() / 1e6) if later.any() else float("nan")
