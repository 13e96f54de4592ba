"""Encoding of the labelled data sets that the studies write."""

from __future__ import annotations

from typing import Any

import xarray as xr


def characters(data: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Encoding of the text variables of a data set as characters.

    HDF5 fails on variable-length strings in a file that is opened twice.
    """
    return {str(name): {"dtype": "S1"} for name, variable in data.variables.items() if variable.dtype.kind in "UO"}
