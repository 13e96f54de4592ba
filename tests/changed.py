"""Files whose content a test changes, with the hashes that labkit would give to the new content."""

import contextlib
from pathlib import Path

import netCDF4

from labkit.files.netcdf import close_with_seal, set_hashes


@contextlib.contextmanager
def changed(file):
    """Context with a netCDF file open for changes, or a new one; afterwards its hashes are those of its content."""
    with netCDF4.Dataset(file, "a" if Path(file).exists() else "w") as dataset:
        yield dataset
        set_hashes(dataset, "data_sha256" in dataset.ncattrs())
    close_with_seal(Path(file))
