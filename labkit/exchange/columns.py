"""Names of columns in other programs' tables of grains and contacts, and the grains and contacts read from them."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from labkit.errors import InputError
from labkit.exchange.packing import DIAMETER, FORCES, LENGTHS, RADIUS, ContactList, Packing

SKIP = "-"
BRACKET = re.compile(r"\s*[\[(]\s*([A-Za-z]+)\s*[\])]\s*$")
AXES = "xyz"
BARE = ("x", "y", "z", "size")  # four columns without names


@dataclasses.dataclass(frozen=True)
class Vocabulary:
    """The names of the columns of a table.

    Args:
        spellings: Name used here -> spellings of other programs, in lower case and without units.
        units: Units that a header may give in brackets, in SI units.
        bare: Names of columns whose unit is ignored.
        needed: Names without which a table cannot be used.
        option: Command-line option that names the columns.
        example: Example of the value of this option.
    """

    spellings: Mapping[str, Collection[str]]
    units: Mapping[str, float]
    bare: Collection[str]
    needed: Sequence[str]
    option: str
    example: str

    def canonical(self, name: str) -> str | None:
        """Return the name used here for a column, or None for a column that is not used."""
        plain = BRACKET.sub("", name).strip().lower().replace(" ", "_")
        return next((own for own, known in self.spellings.items() if plain == own or plain in known), None)

    def columns(
        self, names: Sequence[str] | None, values: np.ndarray, where: object
    ) -> tuple[dict[str, np.ndarray], float | None]:
        """Return the used columns of `values` (n, k) by name, and the unit on which their headers agree.

        Raises InputError if the names are unknown or do not match the columns.
        """
        if names is None:
            raise InputError(
                f"{where} has {values.shape[1]} columns without names: give {self.option}, e.g. {self.example}"
            )
        if len(names) != values.shape[1]:
            raise InputError(f"{where} has {values.shape[1]} columns, but {len(names)} names: {', '.join(names)}")
        spelled: dict[str, str] = {}
        columns: dict[str, np.ndarray] = {}
        for column, name in zip(values.T, names, strict=True):
            own = None if name == SKIP else self.canonical(name)
            if own is not None and own in columns:
                raise InputError(
                    f"{where} has two columns for {own}, {spelled[own]} and {name}: skip one (-) in {self.option}"
                )
            if own is not None:
                columns[own], spelled[own] = column, name
        missing = [name for name in self.needed if name not in columns]
        if missing:
            listed = ", ".join(f"{number} {name}" for number, name in enumerate(names, 1))
            raise InputError(
                f"{where} has no column {missing[0]}; its columns are {listed}: name them with {self.option}, e.g. "
                f"{self.example}, where - skips one"
            )
        found = {self._unit_in(name) for own, name in spelled.items() if own not in self.bare}
        return columns, found.pop() if len(found) == 1 else None

    def arrays(
        self, arrays: Mapping[str, np.ndarray], where: object, renamed: Mapping[str, str] | None = None
    ) -> dict[str, np.ndarray]:
        """Return the columns in named arrays (n,) and vectors (n, 3), singular or plural; renamed: theirs -> ours."""
        columns: dict[str, np.ndarray] = {}
        for name, values in arrays.items():
            parts = {(renamed or {}).get(name, name): values}
            if values.ndim != 1:
                parts = self._split(*parts.popitem(), where)
            for part, column in parts.items():
                own = self.canonical(part)
                if own is not None:
                    columns.setdefault(own, column)
        return columns

    def _split(self, name: str, values: np.ndarray, where: object) -> dict[str, np.ndarray]:
        """Return the components of a vector (n, 3), none if it is not used."""
        stem = name if self.canonical(f"{name}_x") else name.removesuffix("s")
        if self.canonical(f"{stem}_x") is None:
            return {}
        if values.shape[1:] != (3,):
            problem = f"its {name.removesuffix('s')}s have the shape {values.shape}, not (n, 3)"
            raise InputError(f"{where} is damaged ({problem}): give another file")
        return {f"{stem}_{axis}": column for axis, column in zip(AXES, values.T, strict=True)}

    def _unit_in(self, name: str) -> float | None:
        match = BRACKET.search(name)
        return self.units.get(match[1]) if match else None


def _components(*names: str) -> dict[str, tuple[str, ...]]:
    """Spell the components of a vector, x to z, from names in which {} stands for x and [{n}] for its number."""
    return {axis: tuple(name.format(axis, n=number) for name in names) for number, axis in enumerate(AXES)}


GRAIN = Vocabulary(
    {
        "id": ("grain", "grain_id", "body_id", "bodyid", "particle", "particleid"),
        **_components(
            *("{}u", "position_{}", "pos_{}", "pos{}", "points:{n}", "point_{}", "center_{}"),
            *("coordinates:{n}", "p{}", "state.pos[{n}]"),
        ),
        "radius": ("r", "rad", "radii", "shape.radius"),
        "diameter": ("d", "diam", "diameters"),
        "size": (),
    },
    LENGTHS,
    ("id",),
    tuple(AXES),
    "--columns",
    "x,y,z,radius,-",
)
VECTORS = {
    "force": _components("f{}", "force_{}", "f_{}", "contact_force_{}"),
    "normal_force_vector": _components("fn{}", "fn_{}", "normal_force_{}", "normalforce_{}", "phys.normalforce[{n}]"),
    "tangential_force": _components(
        *("ft{}", "fs{}", "ft_{}", "fs_{}", "tangential_force_{}", "shear_force_{}", "shearforce_{}"),
        "phys.shearforce[{n}]",
    ),
}
CONTACT = Vocabulary(
    {
        "id1": ("i", "p1", "grain1", "contact_grain_1", "first_grain", "source", "sources", "patom1", "contacts_i"),
        "id2": ("j", "p2", "grain2", "contact_grain_2", "second_grain", "destinations", "patom2", "contacts_j"),
        "fn": ("normal_force", "normalforce", "forcen", "f_n"),
        "overlap": ("penetration_depth", "penetrationdepth", "geom.penetrationdepth", "delta", "un"),
        **{f"{name}_{axis}": known for name, axes in VECTORS.items() for axis, known in axes.items()},
    },
    FORCES,
    ("id1", "id2", "overlap"),
    ("id1", "id2"),
    "--contact-columns",
    "id1,id2,fx,fy,fz",
)


def grains_from(columns: Mapping[str, np.ndarray], where: object) -> Packing:
    """Return the grains from columns named as in GRAIN. Raises InputError if a position is missing."""
    missing = [axis for axis in AXES if axis not in columns]
    if missing:
        raise InputError(f"{where} has no column {missing[0]}: name its columns with --columns, e.g. x,y,z,radius")
    size_is = next((name for name in (RADIUS, DIAMETER) if name in columns), None)
    return Packing(
        position=np.stack([columns[axis] for axis in AXES], axis=1),
        size=columns.get(size_is or "size"),
        size_is=size_is,
        id=_whole(columns["id"], where) if "id" in columns else None,
    )


def contacts_from(columns: Mapping[str, np.ndarray], where: object) -> ContactList:
    """Return the contacts from columns named as in CONTACT. Raises InputError if the columns of grains are missing."""
    for name in ("id1", "id2"):
        if name not in columns:
            raise InputError(
                f"{where} has no column {name}: name its columns with --contact-columns, e.g. id1,id2,fx,fy,fz"
            )
    if len(columns["id1"]) != len(columns["id2"]):
        raise InputError(f"{where} names {len(columns['id1'])} first and {len(columns['id2'])} second grains")
    force, normal, tangential = (_vector(columns, name, where) for name in VECTORS)
    if force is None and normal is not None:
        force = normal if tangential is None else normal + tangential
    return ContactList(
        grain=np.stack([_whole(columns["id1"], where), _whole(columns["id2"], where)], axis=1),
        normal_force=None if force is not None else columns.get("fn"),
        tangential_force=None if force is not None else tangential,
        force=force,
        overlap=columns.get("overlap"),
    )


def same_length(rows: Sequence[Sequence[float]]) -> np.ndarray:
    """Convert rows of numbers to an array (n, k). Raises ValueError if their lengths differ."""
    short = next((number for number, row in enumerate(rows, 1) if len(row) != len(rows[0])), None)
    if short is not None:
        raise ValueError(f"row {short} has {len(rows[short - 1])} numbers, row 1 has {len(rows[0])}")
    return np.array(rows)


def _whole(values: np.ndarray, where: object) -> np.ndarray:
    """Convert ids to integers. Raises InputError if they are not whole numbers."""
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all() or (values != np.rint(values)).any():
        raise InputError(f"{where} has grain numbers that are not whole numbers: repair the file, or name its columns")
    return values.astype(np.int64)


def _vector(columns: Mapping[str, np.ndarray], name: str, where: object) -> np.ndarray | None:
    given = [columns[f"{name}_{axis}"] for axis in AXES if f"{name}_{axis}" in columns]
    if given and len(given) != 3:
        raise InputError(f"{where} has only {len(given)} of the three components of {name.replace('_', ' ')}")
    return np.stack(given, axis=1) if given else None
