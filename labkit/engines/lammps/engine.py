"""The engine `lammps`: LAMMPS on one or more MPI ranks, with the spring-dashpot law."""

from __future__ import annotations

import numpy as np

from labkit.engines.base import Abilities, rotation_error
from labkit.engines.lammps.coefficients import classes_of, pair_coefficients
from labkit.engines.lammps.domain import require_loadable
from labkit.engines.lammps.process import require_lammps, start_ranks
from labkit.engines.server import ServedEngine, Server, Values
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.grains.state import State


def _require_scene(scene: Scene) -> None:
    """Raise InputError for a scene that LAMMPS cannot simulate."""
    if scene.law != "spring_dashpot":
        raise InputError(f"has no contact law {scene.law}: use spring_dashpot", field="engine", value="lammps")
    if scene.blocked_motions:
        raise InputError("has no planar layers", field="engine", value="lammps", allowed="fused")
    if scene.twisting_friction > 0.0:
        raise InputError("has no twisting resistance", field="engine", value="lammps", allowed="fused")


class LammpsEngine(ServedEngine):
    """LAMMPS with one State loaded; `threads` is the number of MPI ranks."""

    name = "lammps"
    abilities = Abilities(("ranks",), rotates_cell=False, require_scene=_require_scene, require_computer=require_lammps)
    keeps_server = False  # waiting ranks would keep their processors busy

    @classmethod
    def start_server(cls, threads: int) -> Server:
        return start_ranks(threads)

    def load_message(self, state: State) -> tuple[Values, dict[str, np.ndarray]]:
        require_loadable(state)
        pair_coefficients(state.scene, classes_of(state.radius)[1])  # for its InputError
        return {"scene": state.scene.to_json(), "work": state.ledger.cell_work}, {}

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        gradient = np.asarray(velocity_gradient, dtype=float)
        if np.abs(np.tril(gradient, -1)).max() > 1e-12 * np.abs(gradient).max():
            raise rotation_error(self.name)
        super().advance(steps, gradient)
