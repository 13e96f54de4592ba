"""The interface of a part of a contact law; a law is a sum of parts, at most one of each kind.

Each part is one small class that defines its parameters, its columns of history, its losses, its force, its stored
energy and its stiffness. The engines compile its static functions, which may use numbers, vectors, the functions in
labkit.grains.laws.vectors and math, and numpy's maximum, minimum and sqrt. The functions for force, energy and
stiffness are also applied to arrays.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from labkit.errors import InputError
from labkit.extensions import is_labkits
from labkit.files.schema import HISTORY, LOSSES, RECORD, STATE, Variable
from labkit.grains.laws.yade import InYade
from labkit.parameters import Field

if TYPE_CHECKING:
    from labkit.grains.scene import Scene

Numbers = tuple[float, ...]
WITHOUT_NORMAL_FORCE = (
    "tangential",
    "rolling",
    "twisting",
    "damping",
)  # kinds of parts without a function normal_force
SPECIAL = ("normal", *WITHOUT_NORMAL_FORCE, "cohesion")  # kinds on which other kinds depend


class Column(NamedTuple):
    """A quantity of the contact history, as kernels and files store it.

    Args:
        units: Unit, as written to files.
        long_name: Description, as written to files.
        size: 1 for a number, 3 for a vector, which the part must rotate with the contact.
        odd: True if the sign of the quantity changes when the two grains are exchanged.
        joins: True if a value other than 0 means that the grains interact across a gap.
        range: Smallest and largest value other than 0; of a length, in units of the sum of the radii.
    """

    units: str
    long_name: str
    size: int = 1
    odd: bool = False
    joins: bool = False
    range: tuple[float, float] = (-math.inf, math.inf)

    @property
    def is_force(self) -> bool:
        """True for a tangential force: a vector in N."""
        return self.size > 1 and self.units == "N"

    def zeros(self, contacts: int) -> np.ndarray:
        """Return zeros for a number of contacts, (n,) or (n, 3)."""
        return np.zeros((contacts, self.size)[: 1 + (self.size > 1)])

    def variable(self, name: str) -> Variable:
        """Return the column as a variable of a file."""
        dimensions = ("contact", "i") if self.size > 1 else ("contact",)
        return Variable(name, dimensions, "f8", self.units, self.long_name)


PARAMETERS: dict[str, Field] = {}  # parameters of labkit's parts, all of them fields of a scene: name -> field
BREAKING = {"breaking_loss": "energy lost where grains joined or parted, and where bonds broke"}


class LawPart:
    """A part of a contact law; a law is a sum of parts.

    Args:
        kind: Role of the part; a law has at most one part of each kind.
        parameters: Parameters of a scene that only some parts use, including this one: name -> labkit.parameter(...).
        history: Columns of history of the part: name -> Column. Two parts may share a Column.
        losses: Energies dissipated by the part: name in files -> description.
        central: True if the part depends neither on velocities nor on spins and exerts no moments.
        not_in_yade: Why YADE does not have this part, for the message with which a law is refused there.
    """

    kind: ClassVar[str]
    parameters: ClassVar[Mapping[str, object]] = {}
    history: ClassVar[Mapping[str, Column]] = {}
    losses: ClassVar[Mapping[str, str]] = {}
    central: ClassVar[bool] = False
    not_in_yade: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        """Declare the columns and losses to files. Raises InputError for a function with another signature."""
        super().__init_subclass__()
        _require_signatures(cls)
        if is_labkits(cls):
            PARAMETERS.update(cls.parameters)
        rows = {name: Variable(name, ("time",), "f8", "J", text) for name, text in cls.losses.items()}
        LOSSES.update({name: row for name, row in rows.items() if name not in RECORD})
        HISTORY.update({name: column.variable(name) for name, column in cls.history.items() if name not in STATE})

    def __add__(self, other: LawPart | LawParts) -> LawParts:
        return LawParts(self) + other

    def acts(self, scene: Scene) -> bool:
        """Return True if the part has an effect in a scene; a spring with a friction coefficient of 0 has none."""
        return True

    def numbers(self, scene: Scene) -> Numbers:
        """Return the parameters of a scene that the functions of the part need."""
        return ()

    def yade(self, scene: Scene, radius: float) -> InYade | None:
        """Return the part in YADE for grains of a radius (m); None if YADE has no such part."""
        return None

    def begin(self, overlap: np.ndarray) -> dict[str, np.ndarray]:
        """Return the nonzero initial values of columns, name -> (n,), for contacts with given overlaps (n,), in m."""
        return {}

    def reach(self, scene: Scene, stiffness: float, radius: float) -> float:
        """Return the largest gap (m) across which two grains of this radius (m) interact.

        `stiffness` is the coefficient of the normal part for these grains.
        """
        return 0.0


def _require_signatures(part: type[LawPart]) -> None:
    """Raise InputError if a function of a part does not accept the arguments that its base class accepts."""
    for name, function in vars(part).items():
        base = next((vars(one)[name] for one in part.__mro__[1:] if name in vars(one)), None)
        function, base = (getattr(one, "__func__", one) for one in (function, base))  # of a staticmethod
        if name.startswith("__") or not (inspect.isfunction(function) and inspect.isfunction(base)):
            continue
        written, needed = inspect.signature(function), inspect.signature(base)
        required = [one for one in needed.parameters.values() if one.default is one.empty]
        try:
            written.bind(*required)
            written.bind(*needed.parameters)
        except TypeError:
            plain = [one.replace(annotation=one.empty) for one in needed.parameters.values()]
            right = needed.replace(parameters=plain, return_annotation=needed.empty)
            static = ", a @staticmethod without self" * (
                "self" in written.parameters and "self" not in right.parameters
            )
            raise InputError(
                f"{part.__name__}.{name}{written} does not accept the arguments of its kind of part: write "
                f"{name}{right}{static}"
            ) from None


class LawParts(dict[str, LawPart]):
    """The parts of a law: kind -> part. Raises InputError for two parts of a kind, or a name with two meanings."""

    def __init__(self, *parts: LawPart) -> None:
        """Store the parts by kind."""
        super().__init__()
        for part in parts:
            if not isinstance(part, LawPart):
                raise InputError(f"{part!r} is no part of a contact law: give parts such as LinearSpring() + Coulomb()")
            if part.kind in self:
                raise InputError(f"a contact law has two {part.kind} parts: give one")
            for name, column in part.history.items():
                if self.columns.get(name, column) is not column:
                    raise InputError(f"two parts of a contact law keep a history named {name}: rename one")
            for name, definition in part.parameters.items():
                if self.parameters.get(name, definition) is not definition:
                    raise InputError(f"two parts of a contact law have different parameters named {name}: rename one")
            self[part.kind] = part

    def __add__(self, other: LawPart | LawParts) -> LawParts:
        return LawParts(*self.values(), *(other.values() if isinstance(other, LawParts) else (other,)))

    @property
    def parameters(self) -> dict[str, object]:
        """The parameters of a scene that the parts use: name -> field of a dataclass."""
        return {name: definition for part in self.values() for name, definition in part.parameters.items()}

    @property
    def columns(self) -> dict[str, Column]:
        """The columns of history of all parts: name -> Column."""
        return {name: column for part in self.values() for name, column in part.history.items()}


def write_function(text: str, **names: object) -> Callable[..., Any]:
    """Return the function that a text defines; it is treated as a function of this file."""
    return eval(compile(text, __file__, "eval"), {"__name__": __name__, **names})


def columns_in(values: np.ndarray, columns: Mapping[str, Column]) -> dict[str, np.ndarray]:
    """Return views of rows of history (n, k) by name: (n,) for numbers, (n, 3) for vectors."""
    views, first = {}, 0
    for name, column in columns.items():
        views[name] = values[:, first] if column.size == 1 else values[:, first : first + column.size]
        first += column.size
    return views
