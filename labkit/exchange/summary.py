"""The statistics of one Snapshot as a table of names, units and values: Z, A, Lambda, F, F^t, Love's stress and C0."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable

import numpy as np
import pandas

from labkit.io.schema import RECORD
from labkit.micro.fabric import statistics
from labkit.micro.snapshot import Snapshot
from labkit.micro.stress import love_stress, relative_error
from labkit.micro.void_ratio import void_ratio, void_ratio_nominal
from labkit.sff.c0 import sff_stress


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A statistic: name and unit as in run files, value () or (3, 3)."""

    name: str
    units: str
    value: np.ndarray


def quantities(snapshot: Snapshot) -> list[Quantity]:
    """Statistics and stresses of a snapshot, named as in run files; `sff_error` is |C0 - Love|/|Love|."""
    love, c0 = love_stress(snapshot), sff_stress(snapshot)
    values = {
        **vars(statistics(snapshot)),
        "stress": love,
        "stress_sff": c0,
        "sff_error": relative_error(c0, love),
        "void_ratio": void_ratio(snapshot),
        "void_ratio_nominal": void_ratio_nominal(snapshot),
        "grains": snapshot.number_of_grains,
        "contacts": len(snapshot.contacts),
        "mean_diameter": 2.0 * snapshot.radius.mean(),
        "volume": snapshot.volume,
        "young_modulus": snapshot.young_modulus,
    }
    units = {name: variable.units for name, variable in RECORD.items()}
    units |= {"mean_diameter": "m", "volume": "m3", "young_modulus": "Pa"}
    return [Quantity(name, units.get(name, "1"), np.asarray(value)) for name, value in values.items()]


def as_json(found: Iterable[Quantity]) -> str:
    """The quantities as a JSON object, name -> number or three rows of three numbers; NaN becomes null."""
    values = {each.name: _plain(each.value.tolist()) for each in found}
    return json.dumps(values, indent=1) + "\n"


def as_csv(found: Iterable[Quantity]) -> str:
    """The quantities as CSV with the columns name, units and value; a tensor has nine rows, e.g. stress_xz."""
    rows = [
        {"name": f"{each.name}{label}", "units": each.units, "value": float(value)}
        for each in found
        for label, value in _components(each.value)
    ]
    return pandas.DataFrame(rows).to_csv(index=False)


def as_text(found: Iterable[Quantity]) -> str:
    """The quantities as lines of text; a tensor has three rows."""
    lines = []
    for each in found:
        unit = "" if each.units == "1" else f" [{each.units}]"
        rows = np.atleast_2d(each.value) if each.value.ndim else [[each.value]]
        for number, row in enumerate(rows):
            label = f"{each.name}{unit}" if number == 0 else ""
            lines.append(f"{label:<32}" + "".join(f"{float(value):>14.6g}" for value in row))
    return "\n".join(lines)


def _components(value: np.ndarray) -> list[tuple[str, float]]:
    if value.ndim == 0:
        return [("", float(value))]
    return [(f"_{'xyz'[i]}{'xyz'[j]}", float(value[i, j])) for i in range(3) for j in range(3)]


def _plain(value: object) -> object:
    if isinstance(value, list):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
