"""Zarr stores: the variables of a state, or of a whole run, as a folder that xarray.open_zarr reads."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import xarray as xr

from labkit.errors import InputError
from labkit.files.atomic import name_file_in_errors, require_no_link, reserve
from labkit.grains.state import State
from labkit.plugins.exchange.formats import Format
from labkit.process.extras import require_library
from labkit.results.dataset import dataset_of_state

WHAT = "Zarr stores"
BLOCK, FILES = 4096, 3  # bytes per disk block; number of files per variable in addition to its values


class ZarrStore(Format):
    """A folder in the format Zarr, version 2, which labkit writes and xarray reads (`xarray.open_zarr`)."""

    name = "zarr"
    description = "Zarr store, for xarray"
    endings = (".zarr",)
    keeps_clumps = keeps_contacts = True

    def write(self, state: State, file: Path) -> None:
        """Write the variables and attributes that a state file has."""
        write_dataset(dataset_of_state(state), file)


def write_dataset(data: xr.Dataset, file: Path) -> None:
    """Write a Dataset; an older store with the same name is replaced.

    Raises InputError if a file or an ordinary folder has this name, and OSError with the name if the disk is full.
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
    """Raise OSError with the name of the store if it does not fit on the disk: zarr's threads would not say why."""
    with name_file_in_errors(file, trial):
        try:
            reserve(trial, data.nbytes + BLOCK * FILES * (len(data.variables) + 1))
        finally:
            trial.unlink(missing_ok=True)
