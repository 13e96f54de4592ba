"""Names of columns in other programs' tables; makes grains and contacts from the columns."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Mapping, Sequence
from typing import cast

import numpy as np

from labkit.errors import InputError, option_name
from labkit.plugins.exchange.contact_list import ContactList
from labkit.plugins.exchange.packing import DIAMETER, FORCES, LENGTHS, RADIUS, Packing
from labkit.text.reading import real

SKIP = "-"
HEADER_UNIT = re.compile(r" *(?:[\[(]([^\])]*)[\])]|(?:[_/,]|\bin\b) *([\w\u00b5\u03bc]+)) *$")
LONGEST = 200  # largest number of characters of a name
BETWEEN = re.compile(r"[\s_.:()\[\]-]+")  # separates the words of a name
WALL = re.compile(r"(?i)wall|facet|plane|mesh|geometry|triangle|boundary|rigid_?block|^(s[amtw]|[pb]-?[wfg])$")
AXES = "xyz"
BARE = ("x", "y", "z", "size")  # the names of four columns without a header
WITHOUT_UNIT = ("id", "body", "mol", "id1", "id2", "normal_x", "normal_y", "normal_z")


@dataclasses.dataclass(frozen=True)
class Vocabulary:
    """The names of the columns of a table.

    Args:
        spellings: Name used here -> spellings of other programs, without separators between words and without units.
        units: Units that a header may contain, name -> size in SI units.
        others: Units of the columns that are not measured in `units`; empty if these columns have no unit.
        needed: Names of the columns that a table must have.
        option: Command-line option that names the columns.
        example: Example of the value of this option.
        unit: Field of Answers with the unit of a table.
    """

    spellings: Mapping[str, str]
    units: Mapping[str, float]
    others: Mapping[str, Mapping[str, float]]
    needed: Sequence[str]
    option: str
    example: str
    unit: str

    def canonical(self, name: str) -> str | None:
        """Return the name used here for a column, or None if the column is not used."""
        return self._parse(name)[0]

    def _parse(self, name: str) -> tuple[str | None, float | None]:
        """Return the name used here for a column, or None, and the size of the unit in its header, or None."""
        if len(name) > LONGEST:
            return None, None
        if (canonical := self._known(name)) is not None or (match := HEADER_UNIT.search(name)) is None:
            return canonical, None
        text = (match[1] or match[2] or "").strip().replace("\u00b5", "u").replace("\u03bc", "u")
        canonical = self._known(name[: match.start()])
        unit = self.others.get(canonical or "", self.units).get(text)
        return (None, None) if unit is None and match[1] is None else (canonical, unit)

    def _known(self, name: str) -> str | None:
        plain = BETWEEN.sub("", name).lower()
        fits = (key for key, words in self.spellings.items() if plain in (BETWEEN.sub("", key), *words.split()))
        return next(fits, None)

    def columns(
        self, names: Sequence[str] | None, values: np.ndarray, where: object, chosen: float | None = None
    ) -> tuple[dict[str, np.ndarray], float | None]:
        """Return the used columns of `values` (n, k) by name, in a common unit, and this unit, None if it is unknown.

        `given` is the unit that the user gives. Raises InputError if the names are unknown or do not match the
        columns, or if headers have units but none has the given unit.
        """
        if names is None:
            raise InputError(
                f"{where} has {values.shape[1]} columns without names: give {self.option}, e.g. {self.example}"
            )
        if len(names) != values.shape[1]:
            raise InputError(f"{where} has {values.shape[1]} columns, but {len(names)} names: {', '.join(names)}")
        spelled: dict[str, str] = {}
        columns: dict[str, np.ndarray] = {}
        units: dict[str, float | None] = {}
        for column, name in zip(values.T, names, strict=True):
            canonical, unit = (None, None) if name == SKIP else self._parse(name)
            if canonical is None:
                continue
            if canonical in columns:
                raise InputError(
                    f"{where} has two columns for {canonical}, {spelled[canonical]} and {name}: skip one (-) in "
                    f"{self.option}"
                )
            columns[canonical], spelled[canonical] = column, name
            if canonical not in WITHOUT_UNIT:
                units[canonical] = unit
        self.require(columns, where, names)
        for canonical in self.others.keys() & units.keys():
            if (unit := units.pop(canonical)) is not None:
                columns[f"{canonical}_si"] = columns.pop(canonical) * unit
        return self._in_one_unit(columns, units, spelled, chosen)

    def require(self, columns: Collection[str], where: object, names: Sequence[str] = ()) -> None:
        """Raise InputError, with the names of all columns in the file, if a needed column is missing."""
        missing = [name for name in self.needed if name not in columns]
        if missing:
            listed = ", ".join(f"{number} {name}" for number, name in enumerate(names, 1))
            raise InputError(
                f"{where} has no column {missing[0]}{listed and '; its columns are '}{listed}: name them with "
                f"{self.option}, e.g. {self.example}, where - skips one"
            )

    def arrays(
        self, arrays: Mapping[str, np.ndarray], where: object, renamed: Mapping[str, str] | None = None
    ) -> dict[str, np.ndarray]:
        """Return the used columns of named arrays, (n,) or (n, 3); `renamed`: name in the file -> name used here."""
        columns: dict[str, np.ndarray] = {}
        for name, values in arrays.items():
            parts = {(renamed or {}).get(name, name): values}
            if values.ndim != 1:
                parts = self._split(*parts.popitem(), where)
            for part, column in parts.items():
                canonical = self.canonical(part)
                if canonical is not None:
                    columns.setdefault(canonical, column)
        return columns

    def _split(self, name: str, values: np.ndarray, where: object) -> dict[str, np.ndarray]:
        """Return the components of a vector (n, 3), or no components if the vector is not used."""
        stem = name if self.canonical(f"{name}_x") else name.removesuffix("s")
        if self.canonical(f"{stem}_x") is None:
            return {}
        if values.shape[1:] != (3,):
            problem = f"its {name.removesuffix('s')}s have the shape {values.shape}, not (n, 3)"
            raise InputError(f"{where} is damaged ({problem}): give another file")
        return {f"{stem}_{axis}": column for axis, column in zip(AXES, values.T, strict=True)}

    def _in_one_unit(
        self,
        columns: dict[str, np.ndarray],
        units: Mapping[str, float | None],
        spelled: Mapping[str, str],
        chosen: float | None,
    ) -> tuple[dict[str, np.ndarray], float | None]:
        """Convert the columns to the given unit, or to the unit of the first header; also return the unit, or None.

        The unit is None if it is not given and some headers do not contain a unit.
        """
        stated = {canonical: unit for canonical, unit in units.items() if unit is not None}
        if chosen is not None and stated and not np.isclose(list(stated.values()), chosen, rtol=1e-9, atol=0.0).any():
            headers = ", ".join(spelled[canonical] for canonical in stated)
            raise InputError(f"{option_name(self.unit)} contradicts the headers {headers}: leave it out")
        unit = chosen or next(iter(stated.values()), None)
        for canonical, factor in stated.items():
            columns[canonical] = columns[canonical] * (factor / cast(float, unit))
        return columns, unit if chosen or stated.keys() == units.keys() else None


def _components(names: str) -> dict[str, str]:
    """Spell the components of a vector, x to z, from names in which {} stands for the axis and {n} for its number."""
    return {axis: names.format(*axis * names.count("{}"), n=number) for number, axis in enumerate(AXES)}


GRAIN = Vocabulary(
    {
        "id": "grain grainid bodyid particle particleid",
        **_components(
            "{}u position{} pos{} points{n} point{} center{} centre{} centroid{} coord{} {}coord {}coordinate "
            "{}position coordinates{n} position{n} pos{n} p{} statepos{n}"
        ),
        "radius": "r rad radii shaperadius particleradius",
        "diameter": "d diam diameters particlediameter",
        "size": "",
        "body": "clump clumpid multisphereindex idmultisphere multisphere",
        "mol": "molecule molid",
    },
    LENGTHS,
    {},
    tuple(AXES),
    "--columns",
    "x,y,z,radius,-",
    "length_unit",
)
VECTORS = {
    "force": _components("f{} contactforce{}"),
    "normal_force_vector": _components("fn{} normalforce{} physnormalforce{n}"),
    "tangential_force": _components("ft{} fs{} shearforce{} forceshear{} tangentialforce{} physshearforce{n}"),
}
GEOMETRY = {
    "point": _components("contactpoint{} contactpos{} contactposition{} cp{} geomcontactpoint{n}"),
    "normal": _components("n{} contactnormal{} normalvector{} geomnormal{n}"),
}
CONTACT = Vocabulary(
    {
        "id1": "i p1 grain1 contactgrain1 firstgrain source sources patom1 contactsi geoa end1 ball1",
        "id2": "j p2 grain2 contactgrain2 secondgrain destinations patom2 contactsj geob end2 ball2",
        "fn": "normalforce forcen forcenormal",
        "overlap": "penetrationdepth geompenetrationdepth delta un",
        **{
            f"{name}_{axis}": spellings
            for name, axes in (VECTORS | GEOMETRY).items()
            for axis, spellings in axes.items()
        },
    },
    FORCES,
    {"overlap": LENGTHS, **{f"point_{axis}": LENGTHS for axis in AXES}},
    ("id1", "id2"),
    "--contact-columns",
    "id1,id2,fx,fy,fz",
    "force_unit",
)


def grains_from(columns: Mapping[str, np.ndarray], where: object) -> Packing:
    """Create a Packing from columns that are named as in GRAIN. Raises InputError if a position is missing."""
    GRAIN.require(columns, where)
    body = next((columns[name] for name in ("body", "mol") if name in columns), None)
    if body is not None:  # in LAMMPS, an atom without a molecule has molecule 0
        body = _whole(np.where(np.isnan(body) | ("body" not in columns and body == 0), -1, body), where)
    size_is = next((name for name in (RADIUS, DIAMETER) if name in columns), None)
    return Packing(
        position=np.stack([columns[axis] for axis in AXES], axis=1),
        size=columns.get(size_is or "size"),
        size_is=size_is,
        id=_whole(columns["id"], where) if "id" in columns else None,
        body=body,
    )


def contacts_from(columns: Mapping[str, np.ndarray], where: object) -> ContactList:
    """Make contacts from columns with the names of CONTACT. Raises InputError if the ids of the grains are missing."""
    CONTACT.require(columns, where)
    if len(columns["id1"]) != len(columns["id2"]):
        raise InputError(f"{where} names {len(columns['id1'])} first and {len(columns['id2'])} second grains")
    force, normal, tangential = (_vector(columns, name, where) for name in VECTORS)
    point, point_si = _vector(columns, "point", where), _vector(columns, "point", where, "_si")
    direction = _vector(columns, "normal", where)
    direction = normal if direction is None else direction
    if force is None and normal is not None:
        force = normal if tangential is None else normal + tangential
    return ContactList(
        grain=np.stack([_whole(columns["id1"], where), _whole(columns["id2"], where)], axis=1),
        normal_force=None if force is not None else columns.get("fn"),
        tangential_force=None if force is not None else tangential,
        force=force,
        overlap=columns.get("overlap_si", columns.get("overlap")),
        overlap_unit=1.0 if "overlap_si" in columns else None,
        point=point if point_si is None else point_si,
        point_unit=None if point_si is None else 1.0,
        normal=direction,
    )


def renamed(vocabulary: Vocabulary, text: str | None, arrays: Collection[str], where: object) -> dict[str, str]:
    """Parse pairs `array=column`, separated by commas, for a file of named arrays: name in the file -> column.

    Raises InputError for another text, or for an array that is not in the file.
    """
    words = [pair.partition("=") for pair in text.split(",")] if text else []
    pairs = {name.strip(): column.strip() for name, _, column in words}
    for name, column in pairs.items():
        if name not in arrays or (vocabulary.canonical(column) is None and vocabulary.canonical(f"{column}_x") is None):
            allowed = f"ARRAY=COLUMN for arrays of {where}, which are {', '.join(arrays)}"
            raise InputError(field=vocabulary.option.strip("-").replace("-", "_"), value=text, allowed=allowed)
    return pairs


def require_length(rows: Sequence[Sequence[object]], length: int) -> None:
    """Raise ValueError unless each row has this number of cells."""
    for number, row in enumerate(rows, 1):
        if len(row) != length:
            raise ValueError(f"row {number} has {len(row)} numbers for {length} columns")


def same_length(rows: Sequence[Sequence[float]]) -> np.ndarray:
    """Convert rows of numbers to an array (n, k). Raises ValueError if their lengths differ."""
    require_length(rows, len(rows[0]) if rows else 0)
    return np.array(rows)


def number_in(word: str, name: str) -> float:
    """Return the number in a cell of a column of grains, or NaN for a word in a column that is not used."""
    return np.nan if GRAIN.canonical(name) is None else real(word)


def _whole(values: np.ndarray, where: object) -> np.ndarray:
    """Convert ids to integers. Raises InputError if they are not whole numbers."""
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all() or (values != np.rint(values)).any():
        raise InputError(f"{where} has grain numbers that are not whole numbers: repair the file, or name its columns")
    return values.astype(np.int64)


def _vector(columns: Mapping[str, np.ndarray], name: str, where: object, ending: str = "") -> np.ndarray | None:
    components = [columns[f"{name}_{axis}{ending}"] for axis in AXES if f"{name}_{axis}{ending}" in columns]
    if components and len(components) != 3:
        raise InputError(
            f"{where} has only {len(components)} of the three components of {name.replace('_', ' ')}: name all three, "
            "with one unit in their headers or without"
        )
    return np.stack(components, axis=1) if components else None
