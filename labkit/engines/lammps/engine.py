"""The engine `lammps`: LAMMPS on one or more MPI ranks, with the spring-dashpot law."""

from __future__ import annotations

import numpy as np

from labkit.engines.base import Abilities
from labkit.engines.lammps.coefficients import classes_of, pair_coefficients
from labkit.engines.lammps.domain import require_loadable
from labkit.engines.lammps.process import require_lammps, start_ranks
from labkit.engines.server import ServedEngine, Server, Values
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.paths.path import Path


def _require_scene(scene: Scene, path: Path | None) -> None:
    """Raise InputError for a scene or a path that LAMMPS cannot simulate, or if LAMMPS is not installed."""
    if scene.law != "spring_dashpot":
        raise InputError(f"has no contact law {scene.law}: use spring_dashpot", field="engine", value="lammps")
    if scene.blocked:
        raise InputError("has no planar layers", field="engine", value="lammps", allowed="fused")
    if scene.twisting_friction > 0.0:
        raise InputError("has no twisting resistance", field="engine", value="lammps", allowed="fused")
    require_lammps()
    if path is not None:
        _require_no_rotation(path)


def _require_no_rotation(path: Path) -> None:
    """Raise InputError for a path that rotates the cell: one whose shear rates are symmetric, or set by the servo."""
    control = path.control()
    free = control is not None and control.components > 3 and control.free[3:].any()
    if free or np.tril(path.flow(0.0), -1).any():
        raise _turns()


class LammpsEngine(ServedEngine):
    """LAMMPS with one State loaded. `threads` is the number of ranks."""

    name = "lammps"
    abilities = Abilities(parallel="ranks", require_scene=_require_scene)
    keeps_server = False  # waiting ranks keep their processors busy

    @classmethod
    def start_server(cls, threads: int) -> Server:
        return start_ranks(threads)

    def load_message(self, state: State) -> tuple[Values, dict[str, np.ndarray]]:
        require_loadable(state)
        pair_coefficients(state.scene, classes_of(state.radius)[1])  # raises InputError
        return {"scene": state.scene.to_json(), "work": state.ledger.cell_work}, {}

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        gradient = np.asarray(velocity_gradient, dtype=float)
        if np.abs(np.tril(gradient, -1)).max() > 1e-12 * np.abs(gradient).max():
            raise _turns()
        super().advance(steps, gradient)


def _turns() -> InputError:
    return InputError(
        "the path turns the first vector of the cell, or the plane of the first two, which LAMMPS cannot: use "
        "--engine fused, or a path along x, y and z or simple shear"
    )
