"""A contact law in YADE, as data for the server that YADE runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple


class YadeClass(NamedTuple):
    """A YADE object: the name of its class and its arguments, which may be such objects themselves."""

    name: str
    arguments: Mapping[str, float | str | YadeClass] = {}


class YadeLaw(NamedTuple):
    """A contact law in YADE, as data.

    Args:
        material: Function of a radius, m.
        geometry: Geometry functor of an InteractionLoop.
        physics: Physics functor.
        law: Law functor.
        tangential_force: Name of this history variable in the interaction physics.
        rolling_moment: Name of this history variable in the interaction physics.
        losses: For friction, rolling and damping, the name in YADE's energy tracker and those attributes of the law
            that are added to it, J.
        loading_step: Time step of the two steps that find the contacts of a loaded state, s.
    """

    material: Callable[[float], YadeClass]
    geometry: YadeClass
    physics: YadeClass
    law: YadeClass
    tangential_force: str
    rolling_moment: str
    losses: tuple[tuple[str, tuple[str, ...]], ...]
    loading_step: float = 0.0
