"""Registers user-defined contact laws; their parameters become parameters of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from labkit.errors import InputError
from labkit.extensions import require_subclass
from labkit.grains.laws import LAWS, ContactLaw
from labkit.grains.scene import Scene
from labkit.parameters import Parameter, named, parameters_of

Kind = TypeVar("Kind", bound=ContactLaw)


def register_law(kind: type[Kind]) -> type[Kind]:
    """Register a subclass of ContactLaw under its `name` and return it; use it as a class decorator.

    The parameters of its parts become arguments of Scene, options of commands and keys of campaigns.

    Raises InputError if the force of its normal part is not the derivative of its energy, or if one of its parameters
    has a name that a scene uses otherwise.
    """
    require_subclass(kind, ContactLaw)
    require_potential(kind)
    require_names(kind.parts_by_kind.parameters)
    return LAWS.register(kind)


def require_names(parameters: Mapping[str, object]) -> None:
    """Raise InputError for a parameter, name -> field, that is no Parameter or whose name a scene uses otherwise."""
    for name, field in parameters.items():
        if not isinstance(getattr(field, "metadata", {}).get("parameter"), Parameter) or not name.isidentifier():
            raise InputError(f"{name} is not a parameter: give its name and labkit.parameter(default, help=...)")
        if hasattr(Scene, name) and parameters_of(Scene).get(name) != named(name, field):
            raise InputError(f"a scene has another {name}: give the parameter of the law another name")


def require_potential(kind: type[ContactLaw]) -> None:
    """Raise InputError if the force in a law's normal part is not the derivative of the energy there."""
    normal, radius = kind.normal, 1e-4
    stiffness = normal.stiffness(1e9, radius, radius)
    for overlap in radius * np.geomspace(1e-4, 0.2, 20):
        step = 1e-4 * overlap
        force = normal.force(stiffness, overlap)
        slope = (normal.energy(stiffness, overlap + step) - normal.energy(stiffness, overlap - step)) / (2.0 * step)
        if not abs(slope - force) <= 1e-6 * max(abs(force), stiffness * overlap):
            raise InputError(
                f"contact law {getattr(kind, 'name', kind.__name__)}: the force of {type(normal).__name__} is not the "
                f"derivative of its energy ({force:.6g} N against {slope:.6g} N at an overlap of {overlap:.3g} m)"
            )
