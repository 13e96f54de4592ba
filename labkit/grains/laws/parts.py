"""The interface of a part of a contact law; a law is a sum of parts, one of each kind.

Each part is one small class, which defines its force, stored energy, loss and stiffness, and the numbers that it takes
from a scene. Its static functions are written for numbers and also applied to arrays; the engines compile them. They
may use numbers, vectors, the functions of labkit.grains.laws.vectors, and numpy's minimum, maximum and sqrt.
"""

from __future__ import annotations

from typing import ClassVar

from labkit.errors import InputError

Numbers = tuple[float, ...]


class LawPart:
    """A part of a contact law. The sum of parts is a law, which has at most one part of each `kind`.

    `uses` names the parameters of a scene that this part uses but not every part does.
    """

    kind: ClassVar[str]
    uses: ClassVar[tuple[str, ...]] = ()

    def __add__(self, other: LawPart | LawParts) -> LawParts:
        return LawParts(self) + other


class LawParts(dict[str, LawPart]):
    """Parts of a law: kind -> part. Raises InputError for two of a kind."""

    def __init__(self, *parts: LawPart) -> None:
        """Sum the parts."""
        super().__init__()
        for part in parts:
            if part.kind in self:
                raise InputError(f"a contact law has two {part.kind} parts: give one")
            self[part.kind] = part

    def __add__(self, other: LawPart | LawParts) -> LawParts:
        return LawParts(*self.values(), *(other.values() if isinstance(other, LawParts) else (other,)))
