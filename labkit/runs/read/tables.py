"""Variables of a run as a pandas.DataFrame, with one column per component of vectors and tensors."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
import pandas
import xarray

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
