"""How the studies write labelled data sets."""

from __future__ import annotations

from typing import Any

import xarray as xr


def characters(data: xr.Dataset) -> dict[str, dict[str, Any]]:
    """The encoding of the variables of a data set that hold text: characters, as HDF5 breaks on the strings of a file
    that is opened twice.
    """
    return {str(name): {"dtype": "S1"} for name, one in data.variables.items() if one.dtype.kind in "UO"}
