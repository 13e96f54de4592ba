"""Data of Fig. 2: the stresses of the grain size groups of a run, without its contacts."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from analysis.netcdf import write_data
from labkit.errors import InputError

FILE = "size_groups.nc"
GROUPS = 5  # as in the paper


def write_size_groups(run: xr.Dataset, folder: str | Path, command: str | None = None) -> None:
    """Writes the data of Fig. 2 for a run with snapshots into a folder: run.lab.size_groups and Love's stress `love`.

    Raises InputError for a run without snapshots.
    """
    source, file = run.encoding["source"], Path(folder) / FILE
    if not run.sizes["snapshot"]:
        raise InputError(f"{source} contains no contacts: use a run with snapshots")
    groups = run.lab.size_groups(GROUPS).assign(love=run.lab.love_stress()).drop_vars(["i", "j"])
    groups.attrs = {"path": run.attrs["path"]}
    write_data(file, groups, command, [source])


def read_size_groups(folder: str | Path) -> xr.Dataset | None:
    """Dataset written by write_size_groups in a folder, or None if the file is missing."""
    file = Path(folder) / FILE
    return xr.load_dataset(file) if file.exists() else None
