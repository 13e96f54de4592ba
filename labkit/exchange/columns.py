"""Names of columns in tables of grains and contacts, as other programs spell them, and the arrays made from them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from labkit.errors import InputError
from labkit.exchange.answers import FORCES, LENGTHS
from labkit.exchange.packing import DIAMETER, RADIUS, ContactList

SKIP = "-"
GRAIN = {  # name -> spellings, in lower case without units
    "id": ("id", "grain", "grain_id", "body_id", "bodyid", "particle", "particleid"),
    "x": ("x", "xu", "position_x", "pos_x", "posx", "points:0", "coordinates:0", "px", "state.pos[0]"),
    "y": ("y", "yu", "position_y", "pos_y", "posy", "points:1", "coordinates:1", "py", "state.pos[1]"),
    "z": ("z", "zu", "position_z", "pos_z", "posz", "points:2", "coordinates:2", "pz", "state.pos[2]"),
    "radius": ("radius", "r", "rad", "radii", "shape.radius"),
    "diameter": ("diameter", "d", "diam", "diameters"),
}
CONTACT = {
    "id1": ("id1", "i", "p1", "grain1", "contact_grain_1", "first_grain", "source", "sources", "patom1", "contacts_i"),
    "id2": ("id2", "j", "p2", "grain2", "contact_grain_2", "second_grain", "destinations", "patom2", "contacts_j"),
    "fn": ("fn", "normal_force", "normalforce", "forcen", "f_n"),
    "overlap": ("overlap", "penetration_depth", "penetrationdepth", "geom.penetrationdepth", "delta", "un"),
}
VECTORS = {  # components x, y and z
    "force": ("f{}", "force_{}", "f_{}", "contact_force_{}"),
    "normal_force_vector": ("fn{}", "fn_{}", "normal_force_{}", "normalforce_{}"),
    "tangential_force": ("ft{}", "fs{}", "ft_{}", "fs_{}", "tangential_force_{}", "shear_force_{}", "shearforce_{}"),
}
for _name, _spellings in VECTORS.items():
    for _number, _axis in enumerate("xyz"):
        _long = {"normal_force_vector": "phys.normalforce", "tangential_force": "phys.shearforce"}.get(_name)
        CONTACT[f"{_name}_{_axis}"] = (
            *(spelling.format(_axis) for spelling in _spellings),
            *((f"{_long}[{_number}]",) if _long else ()),
        )
BRACKET = re.compile(r"\s*[\[(]\s*([A-Za-z]+)\s*[\])]\s*$")


def canonical(name: str, known: Mapping[str, Sequence[str]]) -> str | None:
    """The name used here for a column, None for a column that is not used."""
    plain = BRACKET.sub("", name).strip().lower().replace(" ", "_")
    return next((own for own, spellings in known.items() if plain == own or plain in spellings), None)


def unit_in(name: str, units: Mapping[str, float]) -> float | None:
    """The unit in brackets after the name of a column, in SI units; None if there is none."""
    match = BRACKET.search(name)
    return units.get(match[1]) if match else None


def chosen(
    names: Sequence[str], values: np.ndarray, known: Mapping[str, Sequence[str]], where: object
) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """(name -> column, name -> its spelling) for the columns of `values` (n, k) that are used. Raises InputError."""
    if len(names) != values.shape[1]:
        raise InputError(f"{where} has {values.shape[1]} columns, but {len(names)} names: {', '.join(names)}")
    columns: dict[str, np.ndarray] = {}
    spelled: dict[str, str] = {}
    for number, name in enumerate(names):
        own = None if name == SKIP else canonical(name, known)
        if own is not None and own in columns:
            raise InputError(f"{where} has two columns for {own}, {spelled[own]} and {name}: skip one (-) in --columns")
        if own is not None:
            columns[own], spelled[own] = values[:, number], name
    return columns, spelled


def unit_from(spelled: Mapping[str, str], names: Sequence[str], units: Mapping[str, float]) -> float | None:
    """The unit that the headers of some columns agree on, None if a header lacks it."""
    found = {unit_in(spelled[name], units) for name in names if name in spelled}
    return found.pop() if len(found) == 1 else None


def grains_from(
    columns: Mapping[str, np.ndarray], where: object
) -> tuple[np.ndarray, np.ndarray | None, str | None, np.ndarray | None]:
    """(position, size, size_is, id) from columns named as in GRAIN. Raises InputError if a position is missing."""
    missing = [axis for axis in "xyz" if axis not in columns]
    if missing:
        raise InputError(f"{where} has no column {missing[0]}: name its columns with --columns, e.g. x,y,z,radius")
    size_is = next((name for name in (RADIUS, DIAMETER) if name in columns), None)
    size = columns[size_is] if size_is else columns.get("size")
    identity = _whole(columns["id"], where) if "id" in columns else None
    return np.stack([columns[axis] for axis in "xyz"], axis=1), size, size_is, identity


def contacts_from(columns: Mapping[str, np.ndarray], where: object) -> ContactList:
    """The contacts in columns named as in CONTACT. Raises InputError if the grains of a contact are missing."""
    for name in ("id1", "id2"):
        if name not in columns:
            raise InputError(
                f"{where} has no column {name}: name its columns with --contact-columns, e.g. id1,id2,fx,fy,fz"
            )
    if len(columns["id1"]) != len(columns["id2"]):
        raise InputError(f"{where} names {len(columns['id1'])} first and {len(columns['id2'])} second grains")
    vectors = {name: _vector(columns, name, where) for name in VECTORS}
    force, normal = vectors["force"], vectors["normal_force_vector"]
    tangential = vectors["tangential_force"]
    if force is None and normal is not None:
        force, tangential = normal if tangential is None else normal + tangential, None
    return ContactList(
        grain=np.stack([_whole(columns["id1"], where), _whole(columns["id2"], where)], axis=1),
        normal_force=None if force is not None else columns.get("fn"),
        tangential_force=None if force is not None else tangential,
        force=force,
        overlap=columns.get("overlap"),
    )


def same_length(rows: Sequence[Sequence[float]]) -> np.ndarray:
    """Rows of numbers as an array (n, k). Raises ValueError if their lengths differ."""
    short = next((number for number, row in enumerate(rows, 1) if len(row) != len(rows[0])), None)
    if short is not None:
        raise ValueError(f"row {short} has {len(rows[short - 1])} numbers, row 1 has {len(rows[0])}")
    return np.array(rows)


def _whole(values: np.ndarray, where: object) -> np.ndarray:
    """Ids as integers. Raises InputError if they are not whole numbers."""
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all() or (values != np.rint(values)).any():
        raise InputError(f"{where} has numbers of grains that are not whole: repair the file, or name its columns")
    return values.astype(np.int64)


def contact_units(spelled: Mapping[str, str]) -> float | None:
    """The force unit in the headers of a contact list, None if it has none."""
    names = [name for name in CONTACT if name not in ("id1", "id2", "overlap")]
    return unit_from(spelled, names, FORCES)


def grain_units(spelled: Mapping[str, str]) -> float | None:
    """The length unit in the headers of a table of grains, None if it has none."""
    return unit_from(spelled, [name for name in GRAIN if name != "id"], LENGTHS)


def _vector(columns: Mapping[str, np.ndarray], name: str, where: object) -> np.ndarray | None:
    components = [columns.get(f"{name}_{axis}") for axis in "xyz"]
    given = [each for each in components if each is not None]
    if given and len(given) != 3:
        raise InputError(f"{where} has only {len(given)} of the three components of {name.replace('_', ' ')}")
    return np.stack(given, axis=1) if given else None
