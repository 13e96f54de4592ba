"""Adds bonds to the contacts of a State."""

from __future__ import annotations

import numpy as np

from labkit.errors import InputError, require_type
from labkit.grains.columns import history_fields
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.grains.valid import require_state
from labkit.micro.snapshot import branch_vectors


def bond(state: State, scene: Scene | None = None) -> State:
    """Return a copy of a State in which all contacts are bonded, without force, under a law with bonds.

    Existing bonds are replaced. Raises InputError if the contact law has no bonds.

    Args:
        state: The state, e.g. a specimen or the end of a consolidation.
        scene: New scene (default: the scene of the state, with the law `bonded` if its own law has no bonds).
    """
    require_state(state)
    require_type(scene or state.scene, Scene, "scene", "labkit.Scene(law='bonded')")
    has_bonds = "bond" in state.scene.contact_law.has
    scene = scene or (state.scene if has_bonds else state.scene.replace(law="bonded"))
    if "bond" not in scene.contact_law.has:
        raise InputError("has no bonds", field="law", value=scene.law, allowed="bonded", quoted=True)
    branch = branch_vectors(state.position, state.cell, state.contact_grain, state.contact_shift)
    carried = {name: value for name, value in state.history_columns.items() if name in scene.contact_law.columns}
    zero = np.zeros_like(branch)
    bonds = {"bond_length": np.linalg.norm(branch, axis=1), "bond_force": zero, "bond_moment": zero.copy()}
    history = history_fields(scene.contact_law.columns, carried | bonds, len(branch))
    return state.replace(scene=scene, time_step=scene.time_step, **history)
