"""Reduced run files: all records in single precision, few contacts, and statistics of all snapshots.

A reduced file has the variables of a run file and opens with labkit.open_run. Its group `derived` holds, for every
snapshot of the full file, the stress according to each stress-force-fabric relationship and the error budget of C0.
For one run the stresses of the grain size groups are written to a separate file.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

import labkit as lk
from analysis.netcdf import encoding, write_data
from labkit.errors import InputError
from labkit.io import CONTACTS, GRAINS, RECORD, create_variables, finish, open_netcdf, provenance_json, whole_file

PICTURES = {"cv-dense": (0, 2, -1), "cp_500kPa-loose": (-1,)}  # run -> snapshots whose contacts are kept
FIG_2, SIZE_GROUPS = "cv-dense", "size_groups.nc"
GROUPS = 5  # of grain sizes, as in the paper
LEFT_OUT = ("data_sha256", "seal", "history")


def condense(file: str | Path, output: str | Path, command: str) -> bool:
    """Writes the reduced file of a complete run file, unless it exists; returns True if it was written."""
    with open_netcdf(file, "run") as source:
        digest = source.data_sha256
        if Path(output).exists():
            with netCDF4.Dataset(output) as there:
                if there.source_sha256 == digest:
                    return False
        chosen = PICTURES.get(Path(file).name.removesuffix(".run.nc"), ())
        with whole_file(output) as temporary:
            with netCDF4.Dataset(temporary, "w") as thin:
                _copy(source, thin, chosen)
                thin.source_sha256 = digest
                thin.source_provenance = re.sub(r"/\S*/yade_scripts/", "yade_scripts/", source.provenance)
                thin.provenance = provenance_json(command, output=output)  # source_sha256 identifies the input
            with lk.open_run(file) as run:
                if Path(file).name == f"{FIG_2}.run.nc":
                    write_size_groups(run, Path(output).parent.parent, command)
                statistics = derived(run)
                statistics.to_netcdf(temporary, mode="a", group="derived", encoding=encoding(statistics, single=True))
            finish(temporary)
    return True


def _copy(source: netCDF4.Dataset, thin: netCDF4.Dataset, chosen: Sequence[int]) -> None:
    thin.setncatts({name: source.getncattr(name) for name in source.ncattrs() if name not in LEFT_OUT})
    create_variables(thin, _single({name: RECORD[name] for name in RECORD if name in source.variables}), {})
    for name in set(RECORD) & set(source.variables):
        thin[name][:] = source[name][...]
    contacts, grains = thin.createGroup("contacts"), thin.createGroup("grains")
    thin.createDimension("snapshot", None)
    create_variables(contacts, _single(CONTACTS), {})
    contacts["row_size"].sample_dimension = "contact"
    create_variables(grains, _single(GRAINS), {"grain": len(source["grains"].dimensions["grain"])})
    grains["radius"][:] = source["grains"]["radius"][...]
    sizes = source["contacts"]["row_size"][...].filled()
    starts = np.concatenate([[0], np.cumsum(sizes)])
    for k, snapshot in enumerate(sorted(range(len(sizes))[j] for j in chosen)):
        rows, first = slice(starts[snapshot], starts[snapshot + 1]), len(contacts.dimensions["contact"])
        for name in ("record", "row_size"):
            contacts[name][k] = source["contacts"][name][snapshot]
        for name in set(CONTACTS) - {"record", "row_size"}:
            contacts[name][first : first + sizes[snapshot]] = source["contacts"][name][rows]
        grains["position"][k] = source["grains"]["position"][snapshot]


def _single(table: Mapping[str, Any]) -> dict[str, Any]:
    """The same variables in single precision."""
    return {name: dataclasses.replace(row, dtype=row.dtype.replace("f8", "f4")) for name, row in table.items()}


def derived(run: xr.Dataset) -> xr.Dataset:
    """Statistics derived from the contacts of all snapshots, an xarray.Dataset along `snapshot`.

    `record` is the index along time.
    """
    statistics = xr.Dataset({"stress_family": run.lab.sff_family(), "error_budget": run.lab.error_budget()})
    return statistics.assign_coords(record=run["record"]).drop_vars(["row_start", "i", "j"], errors="ignore")


def write_size_groups(run: xr.Dataset, folder: str | Path, command: str | None = None) -> None:
    """Writes the data of Fig. 2 for a run with snapshots into a folder: run.lab.size_groups and Love's stress `love`.

    Raises InputError for a run without snapshots.
    """
    source, file = run.encoding["source"], Path(folder) / SIZE_GROUPS
    if not run.sizes["snapshot"]:
        raise InputError(f"{source} contains no contacts: use a run with snapshots")
    groups = run.lab.size_groups(GROUPS).assign(love=run.lab.love_stress()).drop_vars(["i", "j"])
    groups.attrs = {"path": run.attrs["path"]}
    write_data(file, groups, command, [source])


def read_size_groups(folder: str | Path) -> xr.Dataset | None:
    """Dataset written by write_size_groups in a folder, or None if the file is missing."""
    file = Path(folder) / SIZE_GROUPS
    return xr.load_dataset(file) if file.exists() else None
