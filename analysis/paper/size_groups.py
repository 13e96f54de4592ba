"""Fig. 2's data: the stresses of the grain size groups of a run, without its contacts."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from labkit.errors import InputError
from labkit.io import provenance_json, whole_file

FILE = "size_groups.nc"
GROUPS = 5  # as the paper has


def write_size_groups(run: xr.Dataset, folder: str | Path, command: str | None = None) -> None:
    """Writes what Fig. 2 shows of a run with snapshots, run.lab.size_groups and Love's stress `love`, into a folder.

    Raises InputError for a run without snapshots.
    """
    source, file = run.encoding["source"], Path(folder) / FILE
    if not run.sizes["snapshot"]:
        raise InputError(f"{source} holds no contacts: give a run with snapshots")
    found = run.lab.size_groups(GROUPS).assign(love=run.lab.love_stress())
    found.attrs = {"path": run.attrs["path"], "provenance": provenance_json(command, [source], file)}
    with whole_file(file) as temporary:
        found.to_netcdf(temporary, encoding={name: {"zlib": True} for name in found.data_vars})


def read_size_groups(folder: str | Path) -> xr.Dataset | None:
    """The Dataset of write_size_groups in a folder, or None if it is not there."""
    file = Path(folder) / FILE
    return xr.load_dataset(file) if file.exists() else None
