"""State: grains, periodic cell and contacts with their history; a value that can be saved to a file.

A State is taken after the forces of a step are computed and before the grains move: positions, cell, overlaps and
contact forces belong to the same instant, and velocities lag by half a step. An engine that loads a state moves the
grains first, so saving and loading a state does not change a run.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from labkit.bodies.clumps import Clumps
from labkit.files.schema import HISTORY, STATE, Variable
from labkit.grains.columns import history_fields
from labkit.grains.grading import sizes_of
from labkit.grains.ledger import Ledger as Ledger
from labkit.grains.scene import Scene
from labkit.micro.bodies import snapshot_of_bodies
from labkit.micro.snapshot import Contacts, Snapshot, branch_vectors, love_stress, summary
from labkit.micro.stress import mean_stress
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.text.html import html_table


@dataclasses.dataclass(frozen=True, repr=False, eq=False)
class State:
    """Grains, cell and contacts at one instant; labkit.files.schema.STATE lists shapes and units.

    A State equals only itself; two with the same `digest()` have the same scene, grains and contacts.
    """

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
    columns: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)  # further history: labkit.laws.Column
    time: float = 0.0
    time_step: float = 0.0
    step: int = 0
    seed: int = 0
    engine: str = ""
    engine_version: str = ""
    precision: str = "double"  # precision in which the engine computed
    history: str = ""
    recipe: str = ""  # JSON of the Recipe of the specimen
    provenance: str = ""  # JSON from labkit.files.provenance
    ledger: Ledger = dataclasses.field(default_factory=Ledger)
    undrained_stress: tuple[float, ...] = ()  # at the start of undrained loading (Pa); 0 if drained
    clumps: Clumps | None = None  # None if every grain is a separate body

    @classmethod
    def from_arrays(
        cls, radius: ArrayLike, position: ArrayLike, *, cell: ArrayLike, scene: Scene | None = None
    ) -> State:
        """Return your own grains at rest; an engine finds their contacts. The scene gets their mean size and spread.

        Whatever takes the State judges it, and raises InputError, for instance, for grains larger than the cell.

        Args:
            radius: Radii, (n,), in m.
            position: Grain centres, (n, 3), in m.
            cell: Cell vectors as columns, (3, 3), or the sides of a box, (3,), in m.
            scene: Material (default: labkit.Scene()).
        """
        size, box = np.array(radius, dtype=float), np.array(cell, dtype=float)
        material = (Scene() if scene is None else scene).replace(**sizes_of(size))
        return grains_in_cell(material, size, np.array(position, dtype=float), np.diag(box) if box.ndim == 1 else box)

    def __repr__(self) -> str:
        snapshot = self.snapshot()
        diameter, e, p = 2e3 * snapshot.radius.mean(), void_ratio_nominal(snapshot), mean_stress(love_stress(snapshot))
        return (
            f"State({self.contents} of {diameter:.3g} mm, {len(self.contact_grain)} contacts, "
            f"e = {e:.3f}, p = {p / 1e3:.4g} kPa, {self.scene.law}, step {self.step})"
        )

    def _repr_html_(self) -> str:
        """Return a table for notebooks."""
        scene, engine = self.scene, f"{self.engine} {self.engine_version}".strip()
        friction = f"{scene.friction:g}, rolling {scene.rolling_friction:g}"
        return html_table(
            "State",
            summary(self.snapshot()) | {"contact law": scene.law, "friction": friction, "made by": engine or "unknown"},
        )

    @property
    def number_of_grains(self) -> int:
        """Number of grains N_g, including those without contacts; for clumps, the number of spheres."""
        return len(self.radius)

    @property
    def contents(self) -> str:
        """Contents of the cell as text: `400 grains`, or `302 clumps of 906 spheres`."""
        return f"{self.number_of_grains} grains" if self.bodies is None else self.bodies.contents

    @property
    def bodies(self) -> Clumps | None:
        """The clumps, or None if every grain is a separate body, which includes clumps of one sphere."""
        return None if self.clumps is None or self.clumps.single.all() else self.clumps

    @property
    def body_radius(self) -> np.ndarray:
        """Radii of the grains, or of spheres with the same volumes as the clumps, (body,), in m."""
        return self.radius if self.bodies is None else self.bodies.equivalent_radius(self.radius)

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays by name: the variables in labkit.files.schema.STATE, arrays of the clumps, and further history."""
        of_clumps = {} if self.clumps is None else self.clumps.arrays
        return {**{name: getattr(self, name) for name in STATE}, **of_clumps, **self.columns}

    @property
    def history_columns(self) -> dict[str, np.ndarray]:
        """The history of the contacts by name: tangential force, rolling moment and further columns."""
        names = ("tangential_force", "rolling_moment")
        return {**{name: getattr(self, name) for name in names}, **self.columns}

    @property
    def table(self) -> dict[str, Variable]:
        """The schema of `arrays`."""
        history = {name: HISTORY[name] for name in self.columns}
        return STATE | ({} if self.clumps is None else self.clumps.table) | history

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the dimensions of `arrays`."""
        lengths = {"grain": self.number_of_grains, "contact": len(self.contact_grain)}
        return lengths if self.clumps is None else lengths | self.clumps.sizes

    @property
    def nbytes(self) -> int:
        """Total size of all arrays in bytes."""
        return sum(values.nbytes for values in self.arrays.values())

    @property
    def volume(self) -> float:
        """Volume of the cell (m3)."""
        return float(np.linalg.det(self.cell))

    def replace(self, **changes: Any) -> State:
        """Return a copy of the state with the given fields replaced."""
        return dataclasses.replace(self, **changes)

    def snapshot(self) -> Snapshot:
        """Return the Snapshot of this instant, with normal forces from the contact law of the scene.

        If the State has clumps, they are the grains of the Snapshot.
        """
        grain = self.contact_grain
        branch = branch_vectors(self.position, self.cell, grain, self.contact_shift)
        distance = np.sqrt(np.einsum("ci,ci->c", branch, branch))
        radii, law = self.radius.take(grain.T), self.scene.contact_law
        overlap = radii[0] + radii[1] - distance
        normal_force, tangential_force = law.forces(self.scene, radii, overlap, self.history_columns)
        contacts = Contacts(
            grain=grain,
            normal=branch / distance[:, None],
            overlap=overlap,
            normal_force=normal_force,
            tangential_force=tangential_force,
            rolling_moment=self.rolling_moment,
            columns=self.columns,
        )
        of_grains = Snapshot(
            self.scene, self.radius, self.cell, contacts, self.position, self.time, velocity=self.velocity
        )
        return snapshot_of_bodies(of_grains, self.bodies)

    def digest(self) -> str:
        """Return the SHA-256 of the scene and of all arrays, hexadecimal, to identify a specimen."""
        digest = hashlib.sha256(json.dumps(self.scene.identity()).encode())
        for values in self.arrays.values():
            digest.update(np.ascontiguousarray(values).tobytes())
        return digest.hexdigest()

    def at_rest(self) -> State:
        """Return an ordinary specimen: velocities, velocity gradient, time and step number are zero."""
        still = self.without_velocities()
        return still.replace(velocity_gradient=np.zeros((3, 3)), time=0.0, step=0, undrained_stress=())

    def without_velocities(self) -> State:
        """Return a copy of the state in which no grain moves."""
        zero, clumps = np.zeros_like(self.velocity), None if self.clumps is None else self.clumps.at_rest()
        return self.replace(velocity=zero, angular_velocity=zero, clumps=clumps)


def grains_in_cell(scene: Scene, radius: np.ndarray, position: np.ndarray, cell: np.ndarray, seed: int = 0) -> State:
    """Return a State of grains at rest without contact history.

    Args:
        scene: The scene.
        radius: Radii, (n,), in m.
        position: Grain centres, (n, 3), in m.
        cell: Cell vectors as columns, (3, 3), in m.
        seed: Random seed to record.
    """
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
    )


def state_of_snapshot(snapshot: Snapshot) -> State:
    """Return a State with the grains and contacts of a snapshot, e.g. of a run; without velocities it is at rest.

    The `step` of the State is not zero if the snapshot is a later one of a run: a test then continues from its stress.
    Raises InputError if the snapshot has no positions.
    """
    clumps, snapshot = snapshot.clumps, snapshot.spheres
    position, contacts = snapshot.require_position(), snapshot.contacts
    branch = contacts.branch_length(snapshot.radius)[:, None] * contacts.normal
    straight = position[contacts.grain[:, 1]] - position[contacts.grain[:, 0]]
    shift = np.rint(np.linalg.solve(snapshot.cell, (branch - straight).T).T).astype(np.int32)
    scene = cast(Scene, snapshot.scene)
    state, law = grains_in_cell(scene, snapshot.radius, position, snapshot.cell), scene.contact_law
    return state.replace(
        contact_grain=contacts.grain.astype(np.int32),
        contact_shift=shift,
        **history_fields(law.columns, law.history_of(contacts), len(contacts)),
        velocity=state.velocity if snapshot.velocity is None else snapshot.velocity,
        time=snapshot.time,
        step=round(snapshot.time / state.time_step),
        clumps=clumps,
    )
