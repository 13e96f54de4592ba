"""Run files without grains: predictions of the constitutive model, and laboratory tests.

They have the same variables as a simulation, so the same code reads and draws all three. Quantities that have no
meaning without grains are NaN; the groups `contacts` and `grains` are present but empty.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np
import xarray as xr

import labkit.results.dataset  # noqa: F401  (registers the accessor .lab)
from labkit.files.netcdf import create_variables, new_netcdf
from labkit.files.provenance import provenance_json
from labkit.files.schema import CONTACTS, GRAINS, RECORD, SIZES, Variable, description
from labkit.results.tables import with_axes
from labkit.version import __version__

Records = Mapping[str, np.ndarray]
MEASURED = {  # in a test whose laboratory measured it
    "measured_pore_pressure": Variable("measured_pore_pressure", ("time",), "f8", "Pa", "measured pore pressure")
}


def complete_records(records: Records, length: int) -> dict[str, np.ndarray]:
    """Return the variables of labkit.files.schema.RECORD, name -> array along time; NaN for unknown variables."""
    size = {"time": length, "i": 3, "j": 3}
    absent = {
        name: np.full([size[d] for d in variable.dimensions], np.nan)
        for name, variable in RECORD.items()
        if name not in records
    }
    return {**records, **absent}


def records_as_run(
    records: Records, attributes: Mapping[str, object], more: Mapping[str, Variable] | None = None
) -> xr.Dataset:
    """Return the Dataset that labkit.open_run would return for a run file with these records; no file is written.

    Args:
        records: Values of every variable of labkit.files.schema.RECORD, and of `more`.
        attributes: Attributes of the file.
        more: Variables in addition to RECORD, by name.
    """
    every = {**RECORD, **(more or {})}
    variables = {name: (v.dimensions, records[name], v.attributes) for name, v in every.items()}
    for name, v in {**CONTACTS, **GRAINS}.items():
        variables[name] = (v.dimensions, np.zeros([SIZES.get(dimension, 0) for dimension in v.dimensions], v.dtype), {})
    return with_axes(xr.Dataset(variables, attrs=dict(attributes)).set_coords(["time", "axial_strain"]))


def write_records(
    file: str | os.PathLike[str],
    records: Records,
    attributes: Mapping[str, object],
    title: str,
    history: str = "",
    more: Mapping[str, Variable] | None = None,
) -> None:
    """Write a run file atomically; `title` says what it contains, `history` is the command. Raises OSError."""
    variables = {**RECORD, **(more or {})}
    with new_netcdf(file, 200_000 + 1_000 * len(records["time"])) as dataset:
        dataset.setncatts(
            {
                **description(title, history),
                "labkit_file": "run",
                "labkit_version": __version__,
                "engine_version": __version__,
                **attributes,
                "provenance": provenance_json(history or None, output=file),
            }
        )
        create_variables(dataset, variables, {})
        dataset.createDimension("snapshot", None)
        create_variables(dataset.createGroup("contacts"), CONTACTS, {})
        create_variables(dataset.createGroup("grains"), GRAINS, {"grain": 0})
        for name in variables:
            dataset[name][:] = records[name]
