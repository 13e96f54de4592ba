"""Data sets of the studies as netCDF files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import xarray as xr

from labkit.files import provenance_json, whole_file

SINGLE = {"f": "f4", "i": "i4"}  # kind of a variable -> type


def write_data(
    file: str | Path, data: xr.Dataset, command: str | None, inputs: Iterable[str | Path] = (), single: bool = False
) -> None:
    """Writes a data set atomically, compressed, with its provenance as an attribute. `single`: see encoding."""
    data = data.assign_attrs(provenance=provenance_json(command, inputs, file))
    with whole_file(file) as temporary:
        data.to_netcdf(temporary, encoding=encoding(data, single))


def encoding(data: xr.Dataset, single: bool = False) -> dict[str, dict[str, Any]]:
    """Encoding of the variables of a data set: numbers are compressed, in single precision if `single`.

    Text is stored as characters: HDF5 fails on variable-length strings in a file that is opened twice.
    """
    numbers = {str(name): one.dtype.kind for name, one in data.data_vars.items() if one.dtype.kind in SINGLE}
    coding = {name: {"zlib": True, **({"dtype": SINGLE[kind]} if single else {})} for name, kind in numbers.items()}
    texts = [str(name) for name, one in data.variables.items() if one.dtype.kind in "UO"]
    return {**coding, **{name: {"dtype": "S1"} for name in texts}}
