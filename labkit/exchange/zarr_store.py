"""Zarr stores: the variables of a state, or of a whole run, as a folder that xarray.open_zarr reads."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import xarray as xr

from labkit.errors import InputError
from labkit.exchange.formats import Format
from labkit.grains.state import State
from labkit.io.atomic import name_file_in_errors, require_no_link, reserve
from labkit.io.extras import require_library
from labkit.runs.read.dataset import dataset_of_state

WHAT = "Zarr stores"
BLOCK, FILES = 4096, 3  # bytes per disk block, and files per variable besides its values


class ZarrStore(Format):
    """A folder in the format Zarr, version 2. labkit writes it; xarray reads it (`xarray.open_zarr`)."""

    name = "zarr"
    description = "Zarr store, for xarray"
    endings = (".zarr",)
    keeps_clumps = True

    def write(self, state: State, file: Path) -> None:
        """Write the variables and attributes of a state file."""
        write_dataset(dataset_of_state(state), file)


def write_dataset(data: xr.Dataset, file: Path) -> None:
    """Write a Dataset, replacing an older store.

    Raises InputError if a file or another folder has that name, and OSError with it if the disk is full.
    """
    require_library("zarr", WHAT, "formats")
    if file.exists() and not (file / ".zgroup").is_file():
        raise InputError(f"{file} is not a Zarr store: it would be overwritten; choose another -o")
    require_no_link(file)
    with name_file_in_errors(file), tempfile.TemporaryDirectory(dir=file.parent, prefix=f".{file.name}.") as folder:
        temporary = Path(folder) / file.name
        _require_space(Path(folder) / "space", data, file)
        data.drop_encoding().to_zarr(temporary, mode="w", zarr_format=2, consolidated=True)
        if file.exists():
            shutil.rmtree(file)
        temporary.rename(file)


def _require_space(trial: Path, data: xr.Dataset, file: Path) -> None:
    """Raise OSError with the name of the store if the disk has no room for it: zarr's own threads report no cause."""
    with name_file_in_errors(file, trial):
        try:
            reserve(trial, data.nbytes + BLOCK * FILES * (len(data.variables) + 1))
        finally:
            trial.unlink(missing_ok=True)
