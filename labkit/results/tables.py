"""Variables of a run: labels of their components, and tables with one column per component."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
import pandas
import xarray

from labkit.files.schema import AXES

LABELS = {"i": "xyz", "j": "xyz", "side": "12"}  # dimension -> label of each component in a column name


def table(variables: Mapping[str, xarray.DataArray], units: bool = False) -> pandas.DataFrame:
    """Return a DataFrame of variables that share their first dimension, with rows along that dimension.

    A variable whose additional dimensions are all in LABELS has one column per component, e.g. `stress_xz` or
    `contact_grain_1`; a variable with any other dimension is left out. `units` appends the unit to the column names,
    e.g. `p [Pa]`.
    """
    columns: dict[str, np.ndarray] = {}
    for name, variable in variables.items():
        further = [str(dimension) for dimension in variable.dims[1:]]
        if not set(further) <= set(LABELS):
            continue
        unit = variable.attrs.get("units", "1")
        ending = f" [{unit}]" if units and unit not in ("", "1") else ""
        labels = ["".join(letters) for letters in itertools.product(*(LABELS[dimension] for dimension in further))]
        components = variable.values.reshape(variable.shape[0], len(labels))
        for k, label in enumerate(labels):
            columns[f"{name}_{label}{ending}" if label else f"{name}{ending}"] = components[:, k]
    return pandas.DataFrame(columns)


def with_axes(data: xarray.Dataset) -> xarray.Dataset:
    """Add the coordinate labels x, y, z to the dimensions `i` and `j` of a Dataset, if it has them."""
    return data.assign_coords({name: labels for name, labels in AXES.items() if name in data.dims})


def in_double(values: np.ndarray) -> np.ndarray:
    """Convert values stored in single precision to double, so that sums over contacts are exact to rounding."""
    return values.astype(float) if values.dtype == np.float32 else values
