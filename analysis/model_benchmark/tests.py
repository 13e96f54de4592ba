"""The stored tests as one data set, and its split into a training and a held-out part."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas
import xarray as xr

import labkit as lk
from analysis.critical_state.ends import TENSORS, packing
from analysis.curves import POINTS, each_run, turns
from analysis.netcdf import write_data
from analysis.places import results_folder, texts
from labkit.micro import symmetric
from labkit.paths import accumulated_strain
from labkit.plugins.campaigns import read_campaign

SCALARS = {"Z": "coordination_number", "Lambda": "mean_normalised_force", "e": "void_ratio_nominal"}
RELOADED = np.linspace(0.0, 0.15, 151)  # axial strains at which results/initial_fabric holds the curves of its CR tests
STATE = {"strain": "strain", "stress": "stress", **TENSORS}
GROUPS: dict[str, str] = texts(__file__)["groups"]
HIDDEN = ("sheared00", "sheared45", "sheared90")
LEFT_OUT = ("series", "full")  # runs with another stiffness rule or another number of grains


def group_of(run: str) -> str:
    """The group of a run of the benchmark, from its name."""
    if run.startswith(HIDDEN):
        return "hidden fabric"
    return next((group for start, group in GROUPS.items() if run.startswith(start)), "compression")


def specimen_of(run: str) -> str:
    """The packing of a run of results/initial_fabric, e.g. `loose-s1` for `sheared45-loose_500-s1`."""
    return run.partition("-")[2].replace("_500", "")


def stored_tests() -> Iterator[tuple[str, xr.Dataset]]:
    """(name, test) of all stored tests; a test has STATE, SCALARS, `along` (accumulated strain) and attributes."""
    results = Path(results_folder())
    for name, one in each_run(xr.load_dataset(results / "critical_state" / "statistics.nc")):
        if not any(word in name for word in LEFT_OUT):
            path = {"path": str(one["path"].values), "parameters": str(one["path_parameters"].values)}
            yield name, _reduced(one, one["accumulated_strain"].values, packing(name.partition("-")[2]), **path)
    planned = {run.name: run for run in read_campaign(Path(__file__).with_name("other_paths.yaml")).runs}
    for name, one in each_run(xr.load_dataset(results / "other_paths" / "statistics.nc")):
        test = planned[name]
        path = {"path": test.loading.name, "parameters": json.dumps(dataclasses.asdict(test.loading))}
        yield name, _reduced(one, one["accumulated_strain"].values, "other-" + name.partition("-")[2], **path)
    for name, one in each_run(xr.load_dataset(results / "initial_fabric" / "loading.nc")):
        yield name, _reloaded(one, specimen_of(name))
    for file in sorted((results / "paper" / "runs").glob("cyclic-*.run.nc")):
        with lk.open_run(file) as opened:
            run = opened.load()
        along = accumulated_strain(run["axial_strain"].values)
        reversals = turns(run["axial_strain"].values)
        chosen = np.abs(along[:, None] - np.linspace(0.0, along[-1], POINTS - reversals.size)).argmin(axis=0)
        chosen = np.union1d(chosen, reversals)
        chosen = np.pad(chosen, (0, POINTS - chosen.size), mode="edge")
        one = run.isel(time=chosen).rename(time="point")
        path = {"path": run.attrs["path"], "parameters": run.attrs["path_parameters"]}
        yield file.name.removesuffix(".run.nc"), _reduced(one, along[chosen], file.name.partition(".")[0], **path)


def _reduced(one: xr.Dataset, along: np.ndarray, packing: str, path: str, parameters: str) -> xr.Dataset:
    tensors = {name: (("point", "i", "j"), symmetric(one[key].values.astype(float))) for name, key in STATE.items()}
    scalars = {name: ("point", one[key].values.astype(float)) for name, key in SCALARS.items()}
    attributes = {"packing": packing, "path": path, "parameters": parameters}
    return xr.Dataset({**tensors, **scalars, "along": ("point", along.astype(float))}, attrs=attributes)


def _reloaded(one: xr.Dataset, specimen: str) -> xr.Dataset:
    """The CR test of initial_fabric: lateral stress held, lateral strains taken as equal; A, F, F^t at its start."""
    along = np.linspace(0.0, RELOADED[-1], POINTS)
    ratio, volumetric, e, Z, Lam = (
        np.interp(along, RELOADED, one[key].values.astype(float)) for key in ("ratio", "volumetric", "e", "Z", "Lambda")
    )
    start = symmetric(one["stress"].values.astype(float))
    lateral = 0.5 * (start[0, 0] + start[1, 1])
    strain, stress = np.zeros((POINTS, 3, 3)), np.zeros((POINTS, 3, 3))
    strain[:, 0, 0] = strain[:, 1, 1] = 0.5 * (volumetric - along)
    strain[:, 2, 2], stress[:, 2, 2] = along, lateral * (1.0 + ratio / (1.0 - ratio / 3.0))
    stress[:, 0, 0] = stress[:, 1, 1] = lateral
    columns = {"strain": (("point", "i", "j"), strain), "stress": (("point", "i", "j"), stress)}
    for name in TENSORS:
        values = np.full((POINTS, 3, 3), np.nan)
        values[0] = symmetric(one[name].values.astype(float))
        columns[name] = (("point", "i", "j"), values)
    scalars = {"e": e, "Z": Z, "Lambda": Lam, "along": along}
    attributes = {"packing": f"fabric-{specimen}", "path": "reload", "parameters": "{}"}
    return xr.Dataset({**columns, **{k: ("point", v) for k, v in scalars.items()}}, attrs=attributes)


def write_tests(file: Path, split: Path, command: str) -> None:
    """Write all tests as one data set in single precision; `split` names the part of each (columns run, part)."""
    tests = dict(stored_tests())
    parts = pandas.read_csv(split).set_index("run")["part"]
    coordinates = {
        "group": [group_of(name) for name in tests],
        "part": [str(parts[name]) for name in tests],
        **{key: [test.attrs[key] for test in tests.values()] for key in ("packing", "path", "parameters")},
    }
    data = xr.concat([test.drop_attrs() for test in tests.values()], dim="run").astype("f4")
    data = data.assign_coords({"run": list(tests), **{key: ("run", value) for key, value in coordinates.items()}})
    data.attrs = {
        "title": "Benchmark of constitutive models: tests on spheres with rolling friction",
        "license": "CC BY 4.0",
        "units": "stress Pa, all else 1; compression positive, z axial; strain is logarithmic, e nominal",
    }
    write_data(file, data, command)
