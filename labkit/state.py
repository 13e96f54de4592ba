"""State: grains, periodic cell and contacts with their history. A plain value with a file form.

The instant of a state is the one between the forces and the motion of a step: positions, cell, overlaps
and contact forces belong together, velocities are half a step old. An engine that takes a state moves
the grains first, so that a run through a state file goes on as if nothing had happened.
"""

from __future__ import annotations

import dataclasses

import netCDF4
import numpy as np

import labkit
from labkit.errors import InputError
from labkit.files import create_variables, open_netcdf, whole_file
from labkit.scene import Scene
from labkit.schema import STATE


@dataclasses.dataclass(frozen=True)
class State:
    """See labkit.schema.STATE for shapes and units."""

    scene: Scene
    radius: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    cell: np.ndarray
    velocity_gradient: np.ndarray
    contact_grain: np.ndarray
    contact_shift: np.ndarray
    tangential_force: np.ndarray
    rolling_moment: np.ndarray
    time: float = 0.0
    time_step: float = 0.0
    step: int = 0
    seed: int = 0
    engine: str = ""
    engine_version: str = ""
    history: str = ""
    recipe: str = ""  # JSON of the Recipe that made the specimen

    @property
    def number_of_grains(self):
        return len(self.radius)

    @property
    def volume(self):
        """Volume of the cell, m3."""
        return float(np.linalg.det(self.cell))

    def replace(self, **changes):
        return dataclasses.replace(self, **changes)

    def at_rest(self):
        """The same state with all velocities zero, the cell held, and the clock at zero."""
        zero = np.zeros_like(self.velocity)
        return self.replace(
            velocity=zero, angular_velocity=zero, velocity_gradient=np.zeros((3, 3)), time=0.0, step=0
        )


def grains_in_cell(scene, radius, position, cell, seed=0, history=""):
    """A State of grains at rest without contact history. radius (n,), position (n, 3), cell (3, 3), m."""
    zero = np.zeros((len(radius), 3))
    return State(
        scene=scene, radius=radius, position=position, velocity=zero, angular_velocity=zero,
        cell=cell, velocity_gradient=np.zeros((3, 3)),
        contact_grain=np.zeros((0, 2), np.int32), contact_shift=np.zeros((0, 3), np.int32),
        tangential_force=np.zeros((0, 3)), rolling_moment=np.zeros((0, 3)),
        time_step=scene.time_step, seed=seed, history=history,
    )  # fmt: skip


ATTRIBUTES = ("time", "time_step", "step", "seed", "engine", "engine_version", "history", "recipe")


def write_attributes(dataset, state, kind):
    """The attributes that state and run files share."""
    dataset.Conventions = "CF-1.10"
    dataset.labkit_file = kind
    dataset.labkit_version = labkit.__version__
    dataset.scene = state.scene.to_json()
    for name in ATTRIBUTES:
        setattr(dataset, name, getattr(state, name))


def read_group(group, attributes, contacts=None):
    """The State in a netCDF group, with the attributes of the dataset `attributes`.

    `contacts`: how many contacts hold, if the group may have room for more.
    """
    values = {}
    for name, variable in STATE.items():
        rows = slice(contacts if "contact" in variable.dimensions else None)
        values[name] = np.ascontiguousarray(group[name][rows].filled())
    kept = {name: getattr(attributes, name) for name in ATTRIBUTES if name in attributes.ncattrs()}
    for name in ("step", "seed"):
        kept[name] = int(kept[name])
    for name in ("time", "time_step"):
        kept[name] = float(kept[name])
    return State(scene=Scene.from_json(attributes.scene), **values, **kept)


def write_state(path, state):
    """Writes a state file, whole or not at all."""
    with whole_file(path) as temporary, netCDF4.Dataset(temporary, "w") as dataset:
        write_attributes(dataset, state, "state")
        create_variables(dataset, STATE, {"grain": state.number_of_grains, "contact": len(state.contact_grain)})
        for name in STATE:
            dataset[name][...] = getattr(state, name)


def read_state(path):
    """Reads a state file. Raises InputError when it is missing, of another kind, or damaged."""
    with open_netcdf(path, "state") as dataset:
        try:
            return read_group(dataset, dataset)
        except (IndexError, AttributeError, KeyError, RuntimeError) as error:
            raise InputError(f"{path} is damaged ({error}): write it again") from None
