"""Tables of one Snapshot: grains, contacts, and statistics (Z, A, Lambda, F, F^t, Love's stress and C0)."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
import pandas
import xarray

from labkit.files.schema import BY_VOLUME, CONTACTS, ECCENTRICITY, RECORD, STATE, Variable
from labkit.micro.fabric import statistics, statistics_by_volume
from labkit.micro.snapshot import Snapshot, contacts_per_grain, love_stress
from labkit.micro.stress import relative_error
from labkit.micro.void_ratio import void_ratio, void_ratio_nominal
from labkit.results.tables import table
from labkit.sff.c0 import sff_stress, sff_stress_by_volume

Quantities = Mapping[str, tuple[str, np.ndarray]]  # name in run files -> unit, value () or (3, 3)


def snapshot_quantities(snapshot: Snapshot) -> Quantities:
    """Return statistics and stresses of a snapshot; `sff_error` is |C0 - Love|/|Love|, `_by_volume` its sibling."""
    love, c0, by_volume = love_stress(snapshot), sff_stress(snapshot), statistics_by_volume(snapshot)
    c0_by_volume = sff_stress_by_volume(snapshot, by_volume)
    values = {
        **statistics(snapshot).by_name(),
        "stress": love,
        "stress_sff": c0,
        "sff_error": relative_error(c0, love),
        "mean_normalised_force_by_volume": by_volume.mean_normalised_force,
        "stress_sff_by_volume": c0_by_volume,
        "sff_error_by_volume": relative_error(c0_by_volume, love),
        "void_ratio": void_ratio(snapshot),
        "void_ratio_nominal": void_ratio_nominal(snapshot),
        "grains": snapshot.number_of_grains,
        "contacts": len(snapshot.contacts),
        "mean_diameter": 2.0 * snapshot.radius.mean(),
        "volume": snapshot.volume,
        "young_modulus": snapshot.young_modulus,
    }
    units = {name: variable.units for name, variable in (RECORD | BY_VOLUME | ECCENTRICITY).items()}
    units |= {"mean_diameter": "m", "volume": "m3", "young_modulus": "Pa"}
    return {name: (units.get(name, "1"), np.asarray(value)) for name, value in values.items()}


def as_json(quantities: Quantities) -> str:
    """Format the quantities as a JSON object, name -> number or three rows of three numbers; NaN becomes null."""
    values = {}
    for name, (_, value) in quantities.items():
        plain = value.astype(object)
        plain[~np.isfinite(value)] = None
        values[name] = plain.tolist()
    return json.dumps(values, indent=1) + "\n"


def as_csv(quantities: Quantities) -> str:
    """Format the quantities as CSV with the columns name, units, value; a tensor has nine rows, such as stress_xz."""
    labels = {0: [""], 2: [f"_{i}{j}" for i in "xyz" for j in "xyz"]}  # number of dimensions -> endings of names
    rows = [
        (f"{name}{label}", units, float(component))
        for name, (units, value) in quantities.items()
        for label, component in zip(labels[value.ndim], value.flat, strict=True)
    ]
    return pandas.DataFrame(rows, columns=["name", "units", "value"]).to_csv(index=False)


def as_text(quantities: Quantities) -> str:
    """Format the quantities as lines of text; a tensor has three rows."""
    lines = []
    for name, (units, value) in quantities.items():
        label = name if units == "1" else f"{name} [{units}]"
        for row in np.atleast_2d(value):
            lines.append(f"{label:<32}" + "".join(f"{float(component):>14.6g}" for component in row))
            label = ""
    return "\n".join(lines)


def grain_table(snapshot: Snapshot) -> pandas.DataFrame:
    """Tabulate grains: position, radius, number of contacts, velocity if known; columns have units: `radius [m]`."""
    columns = {name: getattr(snapshot, name) for name in ("position", "velocity", "radius")}
    frame = _table({name: values for name, values in columns.items() if values is not None}, STATE)
    frame.insert(0, "grain", range(len(frame)))
    return frame.assign(contacts=contacts_per_grain(snapshot))


def contact_table(snapshot: Snapshot) -> pandas.DataFrame:
    """Tabulate contacts as `run.lab.contacts_table` does; grains are numbered from 0."""
    names = ("contact_grain", "normal", "overlap", "normal_force", "tangential_force", "rolling_moment")
    return _table({name: getattr(snapshot.contacts, name.removeprefix("contact_")) for name in names}, CONTACTS)


def _table(columns: Mapping[str, np.ndarray], described: Mapping[str, Variable]) -> pandas.DataFrame:
    """Tabulate columns with their dimensions and units; `described`: name -> Variable."""
    variables = {
        name: xarray.DataArray(values, dims=described[name].dimensions, attrs={"units": described[name].units})
        for name, values in columns.items()
    }
    return table(variables, units=True)
