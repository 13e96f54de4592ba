"""Packing: the content of another program's file; Answers: information that the file lacks and the user supplies."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from labkit.errors import InputError, option_name
from labkit.parameters import Number, check_parameters, parameter
from labkit.plugins.exchange.contact_list import ContactList
from labkit.text.reading import is_real
from labkit.units import DECIMAL

RADIUS, DIAMETER = "radius", "diameter"
COMPRESSION, TENSION = "compression", "tension"
FIRST, SECOND = "first", "second"


@dataclasses.dataclass(frozen=True, eq=False)
class Packing:
    """Grains, box and contacts of a file, in the units of the file. A field is None if the file does not specify it.

    Args:
        position: Grain centres, (n, 3).
        size: Sizes, (n,).
        size_is: Meaning of the sizes, "radius" or "diameter".
        id: Ids by which contacts refer to the grains, (n,).
        body: Clump to which each grain belongs, (n,), negative for none.
        cell: Cell vectors as columns, (3, 3).
        origin: Corner of the cell, (3,); None if the file gives only lengths.
        tilt: Component along x of the second cell vector; used if the file does not give the lengths of the cell.
        contacts: The contacts.
        length_unit: Unit of length, m.
        force_unit: Unit of force, N.
        at: Instant of the grains, `step` or `time` -> number.
        notes: What the reader of the file omitted or assumed.
    """

    position: np.ndarray
    size: np.ndarray | None = None
    size_is: str | None = None
    id: np.ndarray | None = None
    body: np.ndarray | None = None
    cell: np.ndarray | None = None
    origin: np.ndarray | None = None
    tilt: float = 0.0
    contacts: ContactList | None = None
    length_unit: float | None = None
    force_unit: float | None = None
    at: Mapping[str, float] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.position)

    def with_notes(self, *notes: str) -> Packing:
        """Return a copy of the packing with further notes."""
        return dataclasses.replace(self, notes=(*self.notes, *notes))


def triclinic(lengths: np.ndarray, xy: float = 0.0, xz: float = 0.0, yz: float = 0.0) -> np.ndarray:
    """Return LAMMPS's cell for edge lengths (3,) and tilts: columns (lx, 0, 0), (xy, ly, 0), (xz, yz, lz)."""
    cell = np.diag(np.asarray(lengths, dtype=float))
    cell[0, 1], cell[0, 2], cell[1, 2] = xy, xz, yz
    return cell


MATERIAL = {  # lower-case name of a constant in other programs -> option, and how it is used
    "density": "--density",
    "young": "--young-modulus",
    "poisson": "--stiffness-ratio",
    "frictionangle": "--friction, its tangent",
    "slidingfrictioncoefficient": "--friction",
    "slidingfriction": "--friction",
    "rollingfriction": "--rolling-friction",
    "torsionfriction": "--twisting-friction",
    "etaroll": "--rolling-friction",
    "rollingfrictioncoefficient": "--rolling-friction",
    "etatwist": "--twisting-friction",
    "alphakr": "no counterpart unless 1",
    "alphaktw": "no counterpart unless 1",
}


def stated_material(words: Sequence[str]) -> str:
    """Return a note that labkit does not use the material in a file; `words` are names and numbers in turn."""
    pairs = {name: value[:7] for name, value in zip(words[::2], words[1::2], strict=False) if is_real(value)}
    texts = [f"{name} {value} ({MATERIAL[key]})" for name, value in pairs.items() if (key := name.lower()) in MATERIAL]
    others = [f"{name} {value}" for name, value in pairs.items() if name.lower() not in MATERIAL][:MOST_STATED]
    return f"the file states {', '.join([*texts, *others])}: not used, give the material with these options"


MOST_STATED = 4  # largest number of other material constants in a note
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}  # name -> m
FORCES = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "uN": 1e-6, "dyn": 1e-5}  # name -> N
Known = TypeVar("Known", str, float)
UNIT = re.compile(rf"\s*+({DECIMAL}(?:[eE][+-]?\d++)?+)?+\s*+([A-Za-z]++)\s*+")


@dataclasses.dataclass(frozen=True)
class Answers:
    """Information that a file lacks; None if the user does not give it. Raises InputError for an invalid value."""

    box: str | None = parameter(
        None,
        kind=str,
        help="periodic box in the length unit of the file: the side of a cube, three lengths, or the nine components "
        "of the matrix whose columns are the cell vectors, row by row; separated by commas",
    )
    length_unit: str | None = parameter(None, kind=str, help="length unit of the file, e.g. m, mm or '0.17 mm'")
    force_unit: str | None = parameter(None, kind=str, help="force unit of the file, e.g. N or mN")
    size: str | None = parameter(
        None, kind=str, choices=(RADIUS, DIAMETER), help="meaning of the size of a grain in the file"
    )
    diameter: str | None = parameter(
        None, kind=str, help="diameter of all grains, in the length unit of the file, if the file gives no sizes"
    )
    force_sign: str | None = parameter(
        None, kind=str, choices=(COMPRESSION, TENSION), help="sign for which a normal force in the file is positive"
    )
    force_on: str | None = parameter(
        None, kind=str, choices=(FIRST, SECOND), help="grain of a contact on which the force vectors in the file act"
    )
    first_id: Number[int | None] = parameter(
        None, kind=int, low=0, high=1, help="number of the first grain in a contact list, if grains have no ids"
    )
    columns: str | None = parameter(
        None, kind=str, help="columns of the grains, if the file does not name them, e.g. x,y,z,radius; - skips one"
    )
    contact_columns: str | None = parameter(
        None, kind=str, help="columns of the contacts, if their file does not name them, e.g. id1,id2,fx,fy,fz"
    )
    frame: Number[int | None] = parameter(
        None, kind=int, low=-(10**9), high=10**9, help="number of the frame in a file with several (default: the last)"
    )

    def __post_init__(self) -> None:
        """Check every parameter; a box may be text, a number or a sequence of numbers."""
        if not isinstance(self.box, str | None):
            object.__setattr__(self, "box", ",".join(map(str, np.ravel(self.box))))
        check_parameters(self)
        self.cell()
        _unit(self.length_unit, LENGTHS, "length_unit")
        _unit(self.force_unit, FORCES, "force_unit")

    @property
    def metre(self) -> float | None:
        """The unit of length in m, or None."""
        return _unit(self.length_unit, LENGTHS, "length_unit")

    @property
    def newton(self) -> float | None:
        """The unit of force in N, or None."""
        return _unit(self.force_unit, FORCES, "force_unit")

    def cell(self) -> np.ndarray | None:
        """Return the periodic box as a matrix (3, 3), or None if the user does not give a box."""
        if self.box is None:
            return None
        try:
            values = [float(part) for part in self.box.strip("()[] ").split(",")]
        except ValueError:
            values = []
        if len(values) == 1:
            values = values * 3
        if len(values) not in (3, 9) or not np.isfinite(values).all():
            raise InputError("is not a box", field="box", value=self.box, allowed="1, 3 or 9 numbers", quoted=True)
        cell = np.diag(values) if len(values) == 3 else np.reshape(values, (3, 3))
        if not 0.0 < np.linalg.det(cell / (np.abs(cell).max() or 1.0)):
            raise InputError("has no volume", field="box", value=self.box, allowed="a right-handed box", quoted=True)
        return cell

    def complete(self, packing: Packing) -> Packing:
        """Complete a packing with these answers, in m, N and radii. Raises InputError if information is missing."""
        if self.diameter is not None:
            if packing.size is not None:
                raise InputError("--diameter is not used: the file has the sizes of its grains, leave it out")
            sizes = np.full(len(packing), _length(self.diameter, "diameter"))
            packing = dataclasses.replace(packing, size=sizes, size_is=DIAMETER)
        packing = self._in_box(packing)
        size_is = _agreed("size", packing.size_is, self.size) if self.diameter is None else DIAMETER
        metre = _agreed("length_unit", packing.length_unit, self.metre)
        contacts, newton = packing.contacts, None
        if contacts is not None:
            newton = _agreed("force_unit", contacts.force_unit or packing.force_unit, self.newton)
        of_contacts = {} if contacts is None else self._of_contacts(contacts, newton, packing)
        size, cell = packing.size, packing.cell
        _require(box=cell, diameter=size, size=size is None or size_is, length_unit=metre, **of_contacts)
        assert size is not None and cell is not None and metre is not None
        if contacts is not None:
            contacts = self._contacts(contacts, newton or 1.0, metre)
        return dataclasses.replace(
            packing,
            position=packing.position * metre,
            size=size * metre * (0.5 if size_is == DIAMETER else 1.0),
            size_is=RADIUS,
            cell=cell * metre,
            origin=_times(packing.origin, metre),
            contacts=contacts,
            length_unit=1.0,
            force_unit=1.0,
        )

    def _in_box(self, packing: Packing) -> Packing:
        """Return the packing in the box that the user gives, if any, with the shear that the file states."""
        cell = self.cell()
        if cell is None:
            return packing
        sheared = packing.tilt != 0.0 and packing.cell is None
        if sheared and np.array_equal(cell, np.diag(np.diag(cell))):
            cell[0, 1] = packing.tilt
            packing = packing.with_notes(
                f"the box is sheared by {packing.tilt:.6g} in x over its y, as the file states"
            )
        elif sheared:
            packing = packing.with_notes(
                f"the file states a shift of {packing.tilt:.6g} in x over y: is it in the box?"
            )
        elif packing.cell is not None and not np.allclose(packing.cell, cell, rtol=1e-6):
            packing = packing.with_notes("the box of the file is not used, but the one given")
        return dataclasses.replace(packing, cell=cell)

    def _of_contacts(self, contacts: ContactList, newton: float | None, packing: Packing) -> dict[str, object]:
        """Return the information that the contacts require, field of Answers -> value, or None if it is missing."""
        unit: dict[str, object] = {"force_unit": newton} if contacts.has_forces else {}
        if contacts.normal_force is not None:
            unit["force_sign"] = _agreed("force_sign", contacts.positive, self.force_sign)
        if contacts.tangential_force is not None or contacts.force is not None:
            unit["force_on"] = _agreed("force_on", contacts.acts_on, self.force_on)
        if packing.id is None:
            unit["first_id"] = first_id(contacts.grain, len(packing)) if self.first_id is None else self.first_id
        return unit

    def _contacts(self, contacts: ContactList, newton: float, metre: float) -> ContactList:
        """Convert contacts to N and m, with compression positive and vectors on the first grain."""
        positive, acts_on = contacts.positive or self.force_sign, contacts.acts_on or self.force_on
        on_first = newton if acts_on == FIRST else -newton
        return dataclasses.replace(
            contacts,
            normal_force=_times(contacts.normal_force, newton if positive == COMPRESSION else -newton),
            positive=COMPRESSION,
            tangential_force=_times(contacts.tangential_force, on_first),
            force=_times(contacts.force, on_first),
            acts_on=FIRST,
            overlap=_times(contacts.overlap, contacts.overlap_unit or metre),
            point=_times(contacts.point, contacts.point_unit or metre),
        )


def first_id(grain: np.ndarray, grains: int) -> int | None:
    """Return the number of the first grain: 0 or 1 if the ids in the contact list prove it, otherwise None."""
    return 0 if (grain == 0).any() else 1 if (grain == grains).any() else None


def _agreed(field: str, in_file: Known | None, answered: Known | None) -> Known | None:
    """Return the value from the file or from the user. Raises InputError if they contradict each other."""
    if in_file is None or answered is None or in_file == answered:
        return answered if in_file is None else in_file
    if isinstance(in_file, float) and isinstance(answered, float) and math.isclose(in_file, answered, rel_tol=1e-9):
        return in_file
    stated = f"a unit of {in_file:g} {'N' if field == 'force_unit' else 'm'}" if isinstance(in_file, float) else in_file
    raise InputError(f"{option_name(field)} contradicts the file, which states {stated}: leave it out")


def _times(values: np.ndarray | None, factor: float) -> np.ndarray | None:
    return None if values is None else values * factor


def _unit(text: str | None, units: dict[str, float], field: str) -> float | None:
    """Return the SI value of a unit such as `mm` or `0.17 mm`, or None if `text` is None. Raises InputError."""
    if text is None:
        return None
    match = UNIT.fullmatch(text)
    if match is None or match[2] not in units:
        allowed = f"one of {', '.join(units)}, with or without a number"
        raise InputError("is not a unit", field=field, value=text, allowed=allowed, quoted=True)
    size = float(match[1] or 1.0) * units[match[2]]
    if not 0.0 < size < math.inf:
        raise InputError("is not positive and finite", field=field, value=text, allowed="another unit", quoted=True)
    return size


def answer_names(columns: str | None) -> Sequence[str] | None:
    """Split a user's list of columns into names."""
    return None if columns is None else [name.strip() for name in columns.split(",")]


def _length(text: str, field: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not 0.0 < value < math.inf:
        raise InputError("is not a length", field=field, value=text, allowed="a positive number", quoted=True)
    return value


def frame_number(frames: int, answers: Answers, file: Path) -> tuple[int, list[str]]:
    """Return the index of the frame to read, and a note if it is the last of several. Raises InputError."""
    number = -1 if answers.frame is None else answers.frame
    if not -frames <= number < frames:
        raise InputError(f"is not in {file}, which has {frames}", field="frame", value=number, allowed="another number")
    return number, [f"the last of {frames} frames is read"] if frames > 1 and answers.frame is None else []


def require_count(file: Path, stated: int, rows: int, what: str) -> None:
    """Raise InputError unless a file has as many rows as it states."""
    if stated != rows:
        raise InputError(f"{file} states {stated} {what}, but {rows} rows follow: repair the file, or write it again")


QUESTIONS = {  # field of Answers -> what the file lacks, and what to give
    "box": ("no periodic box", "its lengths, e.g. 4,4,4 in the length unit of the file"),
    "diameter": ("no grain sizes", "the diameter of the grains"),
    "size": ("no word on whether sizes are radii or diameters", "radius or diameter"),
    "length_unit": ("no length unit", f"one of {', '.join(LENGTHS)}, or e.g. '0.17 mm'"),
    "force_unit": ("no force unit", f"one of {', '.join(FORCES)}"),
    "force_sign": ("no word on which normal force is positive", "compression or tension"),
    "force_on": ("no word on which grain the forces act on", "first or second"),
    "first_id": ("no word on whether its contact list counts grains from 0 or from 1", "0 or 1"),
}


def _require(**values: object) -> None:
    """Raise InputError with the questions for all fields that are None."""
    missing = [
        f"{QUESTIONS[field][0]}: give {option_name(field)} (in Python {field}=), {QUESTIONS[field][1]}"
        for field, value in values.items()
        if value is None
    ]
    if missing:
        raise InputError(f"the file has {'; '.join(missing)}")
