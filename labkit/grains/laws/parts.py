"""The interface of a part of a contact law; a law is a sum of parts, one of each kind.

Each part is one small class: the numbers that it takes from a scene, the columns of history that it keeps, the losses
that it has, its force, stored energy and stiffness. The engines compile its static functions. They may use numbers,
vectors, the functions of labkit.grains.laws.vectors and of math, and numpy's maximum, minimum and sqrt. Those of force,
energy and stiffness are also applied to arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from labkit.errors import InputError
from labkit.grains.laws.yade import InYade
from labkit.io.schema import HISTORY, LOSSES, RECORD, STATE, Variable

if TYPE_CHECKING:
    from labkit.grains.scene import Scene

Numbers = tuple[float, ...]
WITHOUT_NORMAL_FORCE = (
    "tangential",
    "rolling",
    "twisting",
    "damping",
)  # kinds
SPECIAL = ("normal", *WITHOUT_NORMAL_FORCE, "cohesion")  # kinds that the others depend on


class Column(NamedTuple):
    """A quantity that a contact remembers, as kernels and files store it.

    Args:
        units: Unit, as files have it.
        long_name: What it is, as files have it.
        size: 1 for a number, 3 for a vector, which the part has to turn with the contact.
        odd: True if its sign changes when the two grains are exchanged.
        joins: True if grains with a value other than 0 act on each other across a gap.
    """

    units: str
    long_name: str
    size: int = 1
    odd: bool = False
    joins: bool = False

    @property
    def is_force(self) -> bool:
        """True for a tangential force: a vector in N."""
        return self.size > 1 and self.units == "N"

    def zeros(self, contacts: int) -> np.ndarray:
        """Values of a number of contacts without a history, (n,) or (n, 3)."""
        return np.zeros((contacts, self.size)[: 1 + (self.size > 1)])

    def variable(self, name: str) -> Variable:
        """The column as a variable of a file."""
        dimensions = ("contact", "i") if self.size > 1 else ("contact",)
        return Variable(name, dimensions, "f8", self.units, self.long_name)


PARAMETERS: dict[str, Any] = {}  # parameters of a scene that parts use: name -> field of a dataclass
BREAKING = {"breaking_loss": "energy lost where grains joined or parted, and where bonds broke"}


class LawPart:
    """A part of a contact law. The sum of parts is a law, which has at most one part of each `kind`.

    Args:
        kind: What it does; a law has at most one part of a kind.
        parameters: Parameters of a scene that this part uses but not every part does: name -> labkit.parameter(...).
        history: Columns of history that it keeps: name -> Column. Two parts may share one Column.
        losses: Energies that it loses: name in files -> what it is.
        central: True if it needs neither velocities nor spins and has no moments.
    """

    kind: ClassVar[str]
    parameters: ClassVar[Mapping[str, Any]] = {}
    history: ClassVar[Mapping[str, Column]] = {}
    losses: ClassVar[Mapping[str, str]] = {}
    central: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        """Tell scenes about the parameters, and files about the columns and the losses."""
        super().__init_subclass__()
        PARAMETERS.update({name: known for name, known in cls.parameters.items() if name not in PARAMETERS})
        rows = {name: Variable(name, ("time",), "f8", "J", text) for name, text in cls.losses.items()}
        LOSSES.update({name: row for name, row in rows.items() if name not in RECORD})
        HISTORY.update({name: column.variable(name) for name, column in cls.history.items() if name not in STATE})

    def __add__(self, other: LawPart | LawParts) -> LawParts:
        return LawParts(self) + other

    def acts(self, scene: Scene) -> bool:
        """True if the part does something in a scene: not a spring with a friction of 0, for instance."""
        return True

    def numbers(self, scene: Scene) -> Numbers:
        """Numbers of a scene that its functions need."""
        return ()

    def yade(self, scene: Scene, radius: float) -> InYade | None:
        """The part in YADE, for the material of grains of a radius, m; None if YADE has no such part."""
        return None

    def begin(self, overlap: np.ndarray) -> dict[str, np.ndarray]:
        """Columns for contacts of a State that lacks them, unless 0: name -> values, from their overlaps, (n,), m."""
        return {}

    def reach(self, scene: Scene, stiffness: float, radius: float) -> float:
        """Largest gap across which two grains of this radius, m, act on each other, m.

        `stiffness` is their coefficient of the normal part.
        """
        return 0.0


class LawParts(dict[str, LawPart]):
    """Parts of a law: kind -> part. Raises InputError for two of a kind, or two columns of a name."""

    def __init__(self, *parts: LawPart) -> None:
        """Sum the parts."""
        super().__init__()
        for part in parts:
            if part.kind in self:
                raise InputError(f"a contact law has two {part.kind} parts: give one")
            for name, column in part.history.items():
                if self.columns.get(name, column) is not column:
                    raise InputError(f"two parts of a contact law keep a history named {name}: rename one")
            for name, known in part.parameters.items():
                if self.parameters.get(name, known) is not known:
                    raise InputError(f"two parts of a contact law have different parameters named {name}: rename one")
            self[part.kind] = part

    def __add__(self, other: LawPart | LawParts) -> LawParts:
        return LawParts(*self.values(), *(other.values() if isinstance(other, LawParts) else (other,)))

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters of a scene that the parts use: name -> field of a dataclass."""
        return {name: known for part in self.values() for name, known in part.parameters.items()}

    @property
    def columns(self) -> dict[str, Column]:
        """The columns of history of all parts: name -> Column."""
        return {name: column for part in self.values() for name, column in part.history.items()}


def write_function(text: str, **names: object) -> Callable[..., Any]:
    """Return the function of a text; it counts as one of this file."""
    function: Callable[..., Any] = eval(compile(text, __file__, "eval"), {"__name__": __name__, **names})
    return function


def columns_in(values: np.ndarray, columns: Mapping[str, Column]) -> dict[str, np.ndarray]:
    """Return views of rows of history (n, k) by name: (n,) for numbers, (n, 3) for vectors."""
    views, first = {}, 0
    for name, column in columns.items():
        views[name] = values[:, first] if column.size == 1 else values[:, first : first + column.size]
        first += column.size
    return views
