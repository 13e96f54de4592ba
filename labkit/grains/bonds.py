"""Bonds the grains of a State."""

from __future__ import annotations

import numpy as np

from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.io.links import BOND_FORCE, BOND_LENGTH, BOND_MOMENT, no_links
from labkit.micro.snapshot import branch_vectors


def bond(state: State, scene: Scene | None = None) -> State:
    """Return a copy of a State in which all contacts are bonded, without force, under a law with bonds.

    Existing bonds are replaced. Raises InputError if the contact law has no bonds.

    Args:
        state: The state, e.g. a specimen or the end of a consolidation.
        scene: Its new scene (default: that of the state, with the law `bonded` if its own has no bonds).
    """
    own = "bond" in state.scene.contact_law.has
    scene = scene or (state.scene if own else state.scene.replace(law="bonded"))
    if "bond" not in scene.contact_law.has:
        raise InputError("has no bonds", field="law", value=scene.law, allowed="bonded", quoted=True)
    contacts = len(state.contact_grain)
    links = no_links(contacts) if state.links is None else state.links.copy()
    branch = branch_vectors(state.position, state.cell, state.contact_grain, state.contact_shift)
    links[:, BOND_LENGTH] = np.linalg.norm(branch, axis=1)
    links[:, BOND_FORCE], links[:, BOND_MOMENT] = 0.0, 0.0
    return state.replace(scene=scene, links=links, time_step=scene.time_step)
