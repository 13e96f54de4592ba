"""State: grains, periodic cell and contacts with their history; a plain value that can be saved to a file.

A state is taken after the forces and before the motion of a step: positions, cell, overlaps and contact forces belong
to the same instant, velocities lag by half a step. An engine that loads a state moves the grains first, so that saving
and loading a state does not change a run.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
from collections.abc import Callable
from typing import Any

import netCDF4
import numpy as np

import labkit
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.io.conventions import describe
from labkit.io.hashes import values_of
from labkit.io.html import html_table
from labkit.io.netcdf import create_variables, new_netcdf, open_netcdf
from labkit.io.schema import LARGEST_RADIUS, SIZES, STATE
from labkit.micro.cells import widths
from labkit.micro.contacts import Contacts, branch_vectors
from labkit.micro.snapshot import Snapshot
from labkit.micro.stress import love_stress, mean_stress
from labkit.micro.summary import summary
from labkit.micro.void_ratio import grain_volume


@dataclasses.dataclass(frozen=True)
class Ledger:
    """Energies since the ledger was opened, J (labkit.records.energy).

    start: energy stored at that time; cell_work: work done on the cell; friction_loss, rolling_loss, damping_loss:
    energy dissipated by friction, rolling and damping (local damping or dashpots).
    """

    start: float = 0.0
    cell_work: float = 0.0
    friction_loss: float = 0.0
    rolling_loss: float = 0.0
    damping_loss: float = 0.0

    @property
    def without_losses(self) -> bool:
        """True if the engine sums the work on the cell and no losses, which are then NaN."""
        return math.isnan(self.friction_loss) and math.isfinite(self.cell_work)

    def plus(self, *flows: float) -> Ledger:
        """A copy with the given work and losses added, in the order of the fields."""
        values = dataclasses.astuple(self)
        return Ledger(values[0], *(a + float(b) for a, b in zip(values[1:], flows, strict=True)))


@dataclasses.dataclass(frozen=True, repr=False)
class State:
    """Grains, cell and contacts at one instant; labkit.io.schema.STATE lists shapes and units."""

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
    precision: str = "double"  # in which the engine computed
    history: str = ""
    recipe: str = ""  # JSON of the Recipe of the specimen
    provenance: str = ""  # JSON from labkit.io.provenance
    ledger: Ledger = Ledger()

    def __repr__(self) -> str:
        diameter, e = 2e3 * self.radius.mean(), np.linalg.det(self.cell) / grain_volume(self.radius) - 1.0
        p = mean_stress(love_stress(self.snapshot())) / 1e3
        return (
            f"State({self.number_of_grains} grains of {diameter:.3g} mm, {len(self.contact_grain)} contacts, "
            f"e = {e:.3f}, p = {p:.4g} kPa, {self.scene.law}, step {self.step})"
        )

    def _repr_html_(self) -> str:
        """A table for notebooks."""
        scene, engine = self.scene, f"{self.engine} {self.engine_version}".strip()
        friction = f"{scene.friction:g}, rolling {scene.rolling_friction:g}"
        return html_table(
            "State",
            summary(self.snapshot()) | {"contact law": scene.law, "friction": friction, "made by": engine or "unknown"},
        )

    @property
    def number_of_grains(self) -> int:
        """Number of grains N_g, including those without contacts."""
        return len(self.radius)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(getattr(self, name).nbytes for name in STATE)

    @property
    def volume(self) -> float:
        """Volume of the cell, m3."""
        return float(np.linalg.det(self.cell))

    def replace(self, **changes: Any) -> State:
        """A copy of the state with the given fields replaced."""
        return dataclasses.replace(self, **changes)

    def snapshot(self) -> Snapshot:
        """The Snapshot of this instant, with normal forces from the contact law of the scene."""
        grain = self.contact_grain
        branch = branch_vectors(self.position, self.cell, grain, self.contact_shift)
        distance = np.sqrt(np.einsum("ci,ci->c", branch, branch))
        radius_a, radius_b = self.radius[grain[:, 0]], self.radius[grain[:, 1]]
        overlap = radius_a + radius_b - distance
        contacts = Contacts(
            grain=grain,
            normal=branch / distance[:, None],
            overlap=overlap,
            normal_force=self.scene.normal_force(radius_a, radius_b, overlap),
            tangential_force=self.tangential_force,
            rolling_moment=self.rolling_moment,
        )
        return Snapshot(self.scene, self.radius, self.cell, contacts, self.position, self.time, velocity=self.velocity)

    def digest(self, law: str | None = None) -> str:
        """SHA-256 of the scene and of all arrays, hexadecimal, to identify a specimen.

        law: a former name of its contact law, for comparison with files of earlier versions.
        """
        scene = self.scene.identity() | ({} if law is None else {"law": law})
        digest = hashlib.sha256(json.dumps(scene).encode())
        for name in STATE:
            digest.update(np.ascontiguousarray(getattr(self, name)).tobytes())
        return digest.hexdigest()

    def at_rest(self) -> State:
        """A copy of the state with all velocities, the velocity gradient, the time and the step number at zero."""
        zero = np.zeros_like(self.velocity)
        return self.replace(velocity=zero, angular_velocity=zero, velocity_gradient=np.zeros((3, 3)), time=0.0, step=0)


def grains_in_cell(
    scene: Scene, radius: np.ndarray, position: np.ndarray, cell: np.ndarray, seed: int = 0, history: str = ""
) -> State:
    """A State of grains at rest without contact history. radius (n,), position (n, 3), cell (3, 3), m."""
    zero = np.zeros((len(radius), 3))
    return State(
        scene=scene,
        radius=radius,
        position=position,
        velocity=zero,
        angular_velocity=zero,
        cell=cell,
        velocity_gradient=np.zeros((3, 3)),
        contact_grain=np.zeros((0, 2), np.int32),
        contact_shift=np.zeros((0, 3), np.int32),
        tangential_force=np.zeros((0, 3)),
        rolling_moment=np.zeros((0, 3)),
        time_step=scene.time_step,
        seed=seed,
        history=history,
    )


MARGIN = 50_000  # bytes of a state file besides its arrays, about

FAR = 1000  # cells; no grain travels that far

ATTRIBUTES = ("time", "time_step", "step", "seed", "engine", "engine_version", "history", "recipe", "provenance")


def write_attributes(dataset: netCDF4.Dataset, state: State, kind: str) -> None:
    """Write the attributes common to state and run files. `kind`: state or run."""
    dataset.labkit_file = kind
    dataset.labkit_version = labkit.__version__
    dataset.scene = state.scene.to_json()
    for name in ATTRIBUTES:
        setattr(dataset, name, getattr(state, name))
    if state.precision != "double":  # files of earlier versions lack it
        dataset.precision = state.precision
    describe(dataset, f"labkit {kind} of {state.number_of_grains} grains", state.history)
    dataset.ledger = np.array(dataclasses.astuple(state.ledger))


def read_group(group: netCDF4.Dataset, attributes: netCDF4.Dataset, contacts: int | None = None) -> State:
    """The State in a netCDF group, with the attributes of the dataset `attributes`.

    `contacts`: number of valid contacts, if the group may have spare capacity.
    """
    values: dict[str, Any] = {}
    for name, variable in STATE.items():
        rows = slice(contacts if "contact" in variable.dimensions else None)
        values[name] = values_of(group[name], rows)
    names = (*ATTRIBUTES, "precision")
    kept: dict[str, Any] = {name: getattr(attributes, name) for name in names if name in attributes.ncattrs()}
    for name in ("step", "seed"):
        kept[name] = int(kept[name])
    for name in ("time", "time_step"):
        kept[name] = float(kept[name])
    if "ledger" in attributes.ncattrs():
        kept["ledger"] = Ledger(*(float(x) for x in attributes.ledger))
    return State(scene=Scene.from_json(attributes.scene), **values, **kept)


def write_state(path: str | os.PathLike, state: State) -> None:
    """Write a state file atomically. Raises OSError."""
    with new_netcdf(path, MARGIN + state.nbytes) as dataset:
        write_attributes(dataset, state, "state")
        create_variables(dataset, STATE, {"grain": state.number_of_grains, "contact": len(state.contact_grain)})
        for name in STATE:
            dataset[name][...] = getattr(state, name)


def read_state(path: str | os.PathLike, verify: bool = True) -> State:
    """Read a state file. Raises InputError if it is missing, damaged or not a state file.

    verify: False to check the hash of its bytes, but not that of its data (labkit.io.netcdf).
    """
    with open_netcdf(path, "state", verify) as dataset:
        return checked(path, lambda: read_group(dataset, dataset))


def checked(path: str | os.PathLike[str], read: Callable[[], State]) -> State:
    """The State that `read` returns from the file `path`. Raises InputError if it cannot be grains in a cell."""
    try:
        state = read()
        require_valid(state)
        return state
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{path} is damaged ({error}): create it again") from None


def require_valid(state: State) -> None:
    """Raise ValueError if the values of a state cannot represent grains in a cell."""
    grains, contacts = state.number_of_grains, len(state.contact_grain)
    for name, variable in STATE.items():
        values = getattr(state, name)
        sizes = {**SIZES, "grain": grains, "contact": contacts}
        if values.shape != tuple(sizes[dimension] for dimension in variable.dimensions):
            raise ValueError(f"{name} has the wrong shape {values.shape}")
        if not np.isfinite(values).all():
            raise ValueError(f"{name} contains NaN or infinite values")
        if np.abs(values).max(initial=0) > LARGEST:
            raise ValueError(f"{name} contains values above {LARGEST:g}")
    if not grains:
        raise ValueError("it has no grains")
    if not ((state.radius > 0.0) & (state.radius < LARGEST_RADIUS)).all():
        raise ValueError(f"radius contains values that are not between 0 and {LARGEST_RADIUS:g} m")
    _require_cell(state)
    if contacts:
        _require_contacts(state)


def _require_cell(state: State) -> None:
    """Raise ValueError for a cell that cannot hold the grains."""
    if not state.volume > 0.0:
        raise ValueError("the cell has no volume, or is left-handed")
    if widths(state.cell).min() < 2.0 * NARROWEST * state.radius.max():
        raise ValueError("the cell is narrower than its largest grain")
    if np.abs(np.linalg.solve(state.cell, state.position.T)).max() > FAR:
        raise ValueError(f"a grain lies more than {FAR} cell lengths from the periodic cell")


def _require_contacts(state: State) -> None:
    """Raise ValueError for contacts that grains cannot have."""
    grain, shift = state.contact_grain, state.contact_shift
    if not (grain.min() >= 0 and grain.max() < state.number_of_grains):
        raise ValueError("contact_grain refers to grains that do not exist")
    if ((grain[:, 0] == grain[:, 1]) & (shift == 0).all(axis=1)).any():
        raise ValueError("contact_grain lists a contact of a grain with itself")
    if np.abs(shift).max() > 2 * FAR:
        raise ValueError(f"contact_shift contains shifts of more than {2 * FAR} cells")
    branch = branch_vectors(state.position, state.cell, grain, shift)
    sum_of_radii = state.radius[grain].sum(axis=1)
    overlap = 1.0 - np.linalg.norm(branch, axis=1) / sum_of_radii
    if overlap.mean() > MOST_OVERLAP:
        raise ValueError(
            f"its grains overlap by {overlap.mean():.0%} of their diameter on average, too deep for a contact law: "
            "relax them first, as labkit specimen does"
        )
    if overlap.min() < -FARTHEST:
        raise ValueError("contact_grain lists two grains that are far apart")


LARGEST = 1e30  # in SI units; no quantity of a specimen is larger
MOST_OVERLAP = 0.2  # mean of all contacts, over their mean diameter; the guards of a run judge smaller ones
NARROWEST = 0.8  # width of the cell over the diameter of its largest grain
FARTHEST = 0.5  # gap in a contact, over the mean diameter of its grains
