"""Brings grains to rest in a fixed cell, as closely as probes need, and prevents contacts from sliding."""

from __future__ import annotations

import dataclasses

from labkit.engines.base import Progress, silent
from labkit.engines.device import Device
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.records.energy import open_ledger
from labkit.simulation.tasks import StateTask
from labkit.specimens.ready import ready
from labkit.specimens.specimen import Equilibrium, settle

CREEPING = Equilibrium(unbalanced_force=1e-5, energy_ratio=1e-10)
STILL = Equilibrium(unbalanced_force=1e-8, energy_ratio=1e-12, step_limit=400_000)
INSIDE = 1.0 - 1e-12  # factor that reduces a force to just below its friction limit
NO_SLIDING = 10.0  # friction coefficients of elastic probes: the largest that a Scene allows


def without_sliding(scene: Scene) -> Scene:
    """Return the scene with friction so high that no contact slides or rolls, for the elastic part of the response.

    A friction coefficient of zero stays zero: no tangential or rolling springs are added.
    """
    return scene.with_friction(*(NO_SLIDING if mu > 0.0 else 0.0 for mu in (scene.friction, scene.rolling_friction)))


def rest(specimen: State, device: Device, progress: Progress = silent) -> State:
    """Bring the specimen to rest in its fixed cell, as closely as probes need. Raises PhysicsError at the step limit.

    Sliding contacts creep for a long time. When the specimen hardly moves any more, sliding is therefore switched off,
    and the remaining motion decays exponentially. The tangential forces and rolling moments are finally reduced to
    just below their friction limits, so that the state is bitwise identical with and without sliding.
    """
    engine = device(open_ledger(device.drive(ready(specimen.at_rest()))))
    settle(engine, CREEPING, lambda fraction, text: progress(0.5 * fraction, text))
    state = engine.state().at_rest()
    engine.load(open_ledger(state.replace(scene=without_sliding(state.scene))))
    settle(engine, STILL, lambda fraction, text: progress(0.5 + 0.5 * fraction, text))
    engine.load(engine.state().replace(scene=specimen.scene))
    state = engine.state().at_rest()
    return state.replace(tangential_force=INSIDE * state.tangential_force, rolling_moment=INSIDE * state.rolling_moment)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RestTask(StateTask[State]):
    """Let the grains of a specimen come to rest in their fixed cell, as closely as probes need."""

    title = "rest"

    def do(self, progress: Progress) -> State:
        return self.finish(rest(self.state, self.device, progress))
