"""Thin run files: all records in single precision, few contacts, and what the contacts of all snapshots told.

A thin file has the names of a run file and opens with labkit.open_run. Its group `derived` holds, along the snapshots
of the whole file, the stress after each stress-force-fabric relationship and the error budget of C0. Of one run the
stresses of grain size groups go into a file of their own.
"""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import netCDF4
import numpy as np
import xarray as xr

import labkit as lk
from analysis.netcdf import characters
from analysis.paper.size_groups import write_size_groups
from labkit.io import CONTACTS, GRAINS, RECORD, create_variables, data_sha256, open_netcdf, provenance_json, whole_file

PICTURES = {"cv-dense": (0, 2, -1), "cp_500kPa-loose": (-1,)}  # run -> the snapshots whose contacts are kept
FIG_2 = "cv-dense"
LEFT_OUT = ("data_sha256", "history")


def condense(file: str | Path, output: str | Path, command: str) -> bool:
    """Writes the thin file of a complete run file, unless it is there; returns whether it was written."""
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
                thin.provenance = provenance_json(command, output=output)  # its input is told by the hash of its data
            with lk.open_run(file) as run:
                if Path(file).name == f"{FIG_2}.run.nc":
                    write_size_groups(run, Path(output).parent.parent, command)
                told = derived(run)
                coding = {name: {"dtype": "f4", "zlib": True} for name in told.data_vars}
                told.to_netcdf(temporary, mode="a", group="derived", encoding=coding | characters(told))
            with netCDF4.Dataset(temporary, "a") as thin:
                thin.data_sha256 = data_sha256(thin)
    return True


def _copy(source, thin, chosen):
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


def _single(table):
    """The same variables in single precision."""
    return {name: dataclasses.replace(row, dtype=row.dtype.replace("f8", "f4")) for name, row in table.items()}


def derived(run: xr.Dataset) -> xr.Dataset:
    """What the contacts of all snapshots tell, an xarray.Dataset along `snapshot`; `record` is the index along time."""
    found = xr.Dataset({"stress_family": run.lab.sff_family(), "error_budget": run.lab.error_budget()})
    return found.assign_coords(record=run["record"]).drop_vars(["row_start"], errors="ignore")
