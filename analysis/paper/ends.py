"""Selection of the runs to compare, and tables of their initial and final states."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping

import numpy as np
import pandas
import xarray as xr

from labkit.files import RECORD
from labkit.paths import accumulated_strain
from labkit.results import HELD_AFTER, SHEAR, TENSORS, WINDOW, critical_states

Runs = Mapping[str, xr.Dataset]  # name -> run, as returned by labkit.open_run

BLOCKS = 5  # blocks of the averaging window of a test
ENOUGH_STRAIN = 0.15  # axial strain above which the last quarter of a shear test is near the critical state
RELAXATIONS = np.geomspace(0.02, 0.2, 21)  # axial strains; over half a test, a slower decay looks like a straight line
HOLDS_A_STRESS = ("cr", "cp", "cyclic_cp")
OTHERS = ("share_", "full_")  # tests that compare engines and contact laws


def in_memory(runs: Runs) -> dict[str, xr.Dataset]:
    """The same runs with their records in memory, without contacts and grains; `grains` holds the number of grains."""
    loaded = {}
    for name, run in runs.items():
        loaded[name] = run[[key for key in RECORD if key in run]].drop_dims("snapshot", errors="ignore").load()
        loaded[name].attrs = {**run.attrs, "grains": run.sizes["grain"]}
    return loaded


def main(runs: Runs) -> dict[str, xr.Dataset]:
    """The paper's tests at full size, without those that compare engines and contact laws."""
    return {name: run for name, run in runs.items() if not name.startswith(OTHERS)}


def matching(runs: Runs, pattern: str) -> dict[str, xr.Dataset]:
    """Runs whose full name matches the regular expression."""
    return {name: run for name, run in runs.items() if re.fullmatch(pattern, name)}


def sheared(runs: Runs, paths: Collection[str] = SHEAR) -> dict[str, xr.Dataset]:
    """Shear tests with enough strain to approach the critical state."""
    return {
        name: run
        for name, run in runs.items()
        if run.attrs["path"] in paths and float(run["axial_strain"][-1]) >= ENOUGH_STRAIN
    }


def between(run: xr.Dataset, begin: float, end: float) -> xr.Dataset:
    """Records of a monotonic test between two axial strains."""
    strain = run["axial_strain"].values
    return run.isel(time=(strain >= begin) & (strain <= end))


def ends(runs: Runs, begin: float = 1.0 - WINDOW, end: float = 1.0) -> pandas.DataFrame:
    """Table of critical_states between two fractions of the strain of each shear test."""
    parts = {}
    for name, run in runs.items():
        last = float(run["axial_strain"][-1])
        parts[name] = between(run, begin * last, end * last)
    return table(parts)


def table(parts: Runs) -> pandas.DataFrame:
    """Table of critical_states over all records of the given parts of runs.

    All columns are present even if there are no runs.
    """
    states = critical_states(parts, window=1.0)
    return states if len(states) else pandas.DataFrame(columns=list(COLUMNS), dtype=float)


COLUMNS = ("run", "path", "strain", "M", "M_scatter", "p_MPa", "e", "Z", "Lambda", "A_zz", "F_zz", "Ft_zz")


def extrapolated(runs: Runs) -> pandas.DataFrame:
    """The values of `ends` at infinite strain: a + b exp(-strain/s) fitted to the last half of the strain of each test.

    A table with the columns of `ends` except M_scatter, plus relaxation_strain: the value of s shared by all
    quantities of a test, chosen from RELAXATIONS by maximum likelihood with a separate scatter for each quantity.
    """
    rows = []
    for name, run in runs.items():
        strain = run["axial_strain"].values
        late = strain >= 0.5 * strain[-1]
        values = recorded_numbers(run)[late]
        fits = [_exponential(strain[late] - strain[-1], values, relaxation) for relaxation in RELAXATIONS]
        best = int(np.argmin([misfit for misfit, _ in fits]))
        row = {"run": name, "path": run.attrs["path"], "strain": strain[-1], "relaxation_strain": RELAXATIONS[best]}
        rows.append(row | dict(zip(values, fits[best][1], strict=True)))
    return pandas.DataFrame(rows, columns=[*COLUMNS, "relaxation_strain"]).drop(columns="M_scatter")


def recorded_numbers(run: xr.Dataset) -> pandas.DataFrame:
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


def _exponential(strain: np.ndarray, values: pandas.DataFrame, relaxation: float) -> tuple[float, np.ndarray]:
    """(negative log-likelihood, asymptotes) of a + b exp(-strain/relaxation), by least squares."""
    shape = np.stack([np.ones_like(strain), np.exp(-strain / relaxation)], axis=1).astype(float)
    fitted = np.linalg.lstsq(shape, values.to_numpy(), rcond=None)[0]
    misfit = np.sum((values.to_numpy() - shape @ fitted) ** 2, axis=0) / np.sum(values.to_numpy() ** 2, axis=0)
    return float(np.sum(np.log(misfit + 1e-16))), fitted[0]


def blocks(name: str, run: xr.Dataset, begin: float, end: float) -> pandas.DataFrame:
    """Table of critical_states of BLOCKS equal parts between two axial strains of one test."""
    edges = begin + (end - begin) * np.linspace(0.0, 1.0, BLOCKS + 1)
    return table({f"{name} {k + 1}": between(run, edges[k], edges[k + 1]) for k in range(BLOCKS)})


def starts(runs: Runs) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per run, from its first record.

    e (corrected for overlaps), e_nominal, p0_MPa, Z; e_made, the void ratio of the specimen as generated (NaN if not
    recorded); held_MPa, the mean over the test of the stress that the path holds.
    """
    rows = []
    for name, run in runs.items():
        made = float(json.loads(run.attrs.get("recipe") or "{}").get("void_ratio", "nan"))
        e, nominal, Z = (float(run[key][0]) for key in ("void_ratio", "void_ratio_nominal", "coordination_number"))
        p0 = float(run.lab.mean_stress()[0]) / 1e6
        rows.append((name, run.attrs["path"], e, nominal, made, p0, Z, _held(run)))
    return pandas.DataFrame(rows, columns=["run", "path", "e", "e_nominal", "e_made", "p0_MPa", "Z", "held_MPa"])


def _held(run: xr.Dataset) -> float:
    if run.attrs["path"] not in HOLDS_A_STRESS:
        return float("nan")
    stress = run["stress"].values
    held = 0.5 * (stress[:, 0, 0] + stress[:, 1, 1]) if run.attrs["path"] == "cr" else run.lab.mean_stress().values
    later = accumulated_strain(run["axial_strain"].values) > HELD_AFTER
    return float(held[later].mean() / 1e6) if later.any() else float("nan")
