"""Reduced run files: all records in single precision, no contacts, and statistics of all snapshots.

A reduced file has the variables of a run file and opens with labkit.open_run. Its group `derived` holds, for every
snapshot of the full file, the stress according to each stress-force-fabric relationship and the error budget of C0.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import netCDF4
import xarray as xr

import labkit as lk
from analysis.netcdf import encoding
from labkit.files import CONTACTS, GRAINS, RECORD, create_variables, finish, open_netcdf, provenance_json, whole_file

LEFT_OUT = ("data_sha256", "seal", "history")


def condense(file: str | Path, output: str | Path, command: str) -> bool:
    """Writes the reduced file of a complete run file, unless it exists; returns True if it was written."""
    with open_netcdf(file, "run") as source:
        digest = source.data_sha256
        if Path(output).exists():
            with netCDF4.Dataset(output) as there:
                if there.source_sha256 == digest:
                    return False
    with whole_file(output) as temporary:
        with open_netcdf(file, "run") as source, netCDF4.Dataset(temporary, "w") as thin:
            _copy(source, thin)
            thin.source_sha256 = digest
            thin.source_provenance = re.sub(r"/\S*/yade_scripts/", "yade_scripts/", source.provenance)
            thin.provenance = provenance_json(command, output=output)  # source_sha256 identifies the input
        with lk.open_run(file) as run:
            statistics = derived(run)
            statistics.to_netcdf(temporary, mode="a", group="derived", encoding=encoding(statistics, single=True))
        finish(temporary)
    return True


def _copy(source: netCDF4.Dataset, thin: netCDF4.Dataset) -> None:
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


def _single(table: Mapping[str, Any]) -> dict[str, Any]:
    """The same variables in single precision."""
    return {name: dataclasses.replace(row, dtype=row.dtype.replace("f8", "f4")) for name, row in table.items()}


def derived(run: xr.Dataset) -> xr.Dataset:
    """Statistics derived from the contacts of all snapshots, an xarray.Dataset along `snapshot`.

    `record` is the index along time.
    """
    statistics = xr.Dataset({"stress_family": run.lab.sff_family(), "error_budget": run.lab.error_budget()})
    return statistics.assign_coords(record=run["record"]).drop_vars(["row_start", "i", "j"], errors="ignore")
