"""Tables of the grains and of the contacts of a Snapshot, with names and units as in run files."""

from __future__ import annotations

import pandas
import xarray

from labkit.io.schema import CONTACTS, RECORD, STATE
from labkit.micro.snapshot import Snapshot, contacts_per_grain
from labkit.runs.tables import table


def grain_table(snapshot: Snapshot, units: bool = True) -> pandas.DataFrame:
    """One row per grain: position, radius, number of contacts, and velocity if it is known.

    `units` appends the unit to the column names, e.g. `radius [m]`.
    """
    columns = {"position": snapshot.position, "velocity": snapshot.velocity, "radius": snapshot.radius}
    variables = {
        name: xarray.DataArray(values, dims=STATE[name].dimensions, attrs={"units": STATE[name].units})
        for name, values in columns.items()
        if values is not None
    }
    count = contacts_per_grain(snapshot)
    variables["contacts"] = xarray.DataArray(count, dims="grain", attrs={"units": RECORD["coordination_number"].units})
    frame = table(variables, units)
    frame.insert(0, "grain", range(len(frame)))
    return frame


def contact_table(snapshot: Snapshot, units: bool = True) -> pandas.DataFrame:
    """One row per contact, as in `run.lab.contacts_table`; grains are counted from 0."""
    names = {"contact_grain": "grain"} | {
        name: name for name in ("normal", "overlap", "normal_force", "tangential_force", "rolling_moment")
    }
    variables = {
        name: xarray.DataArray(
            getattr(snapshot.contacts, field), dims=CONTACTS[name].dimensions, attrs={"units": CONTACTS[name].units}
        )
        for name, field in names.items()
    }
    return table(variables, units)
