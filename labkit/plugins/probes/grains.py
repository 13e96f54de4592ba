"""Probes of a state: response envelopes and tangent stiffness, also of the elastic response alone.

    probes = labkit.probe(state, plane="axisymmetric", directions=24)
    elastic = labkit.probe(state, plane="all", elastic=True)
    elastic.tangent(), elastic.asymmetry(), elastic.directional() / elastic.affine_bound()

Each probe is a separate run (`probing`); all start from the same State. An additional null probe, with
an increment of zero, shows how far the grains creep by themselves; its response is subtracted from all other responses.
For the elastic response, the grains first come to rest in a fixed cell, and contacts are prevented from sliding.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Callable

import numpy as np

from labkit.engines import Device, device_of
from labkit.engines.base import Progress, silent
from labkit.errors import InputError
from labkit.grains.scene import Scene, used_parameters
from labkit.grains.state import State
from labkit.grains.valid import require_state
from labkit.micro.indicators import inertial_number
from labkit.micro.snapshot import Snapshot, love_stress
from labkit.micro.stress import mean_stress
from labkit.micro.tensors import symmetric, to_six
from labkit.parameters import Values
from labkit.paths.path import Path
from labkit.paths.probes import LOADING, StrainProbe, StressProbe
from labkit.plugins.probes.probe_set import Probes, dataset_of
from labkit.plugins.probes.probing import Probing, plane_of
from labkit.records.energy import open_ledger
from labkit.records.limits import INERTIAL_LIMIT
from labkit.records.memory import Groups, RunInMemory
from labkit.records.schedule import Options
from labkit.servo.correction import FLOOR, cell_stiffness
from labkit.simulation.api import progress_function
from labkit.simulation.tasks import RunTask, StateTask, execute
from labkit.specimens.ready import ready
from labkit.specimens.specimen import Equilibrium, settle

CREEPING = Equilibrium(unbalanced_force=1e-5, energy_ratio=1e-10)
STILL = Equilibrium(unbalanced_force=1e-8, energy_ratio=1e-12, step_limit=400_000)
INSIDE = 1.0 - 1e-12  # factor that reduces a force to just below its friction limit
NO_SLIDING = 10.0  # friction coefficients of elastic probes: the largest that a Scene allows


def without_sliding(scene: Scene) -> Scene:
    """Return the scene with friction so high that no contact slides, rolls or twists, for the elastic response.

    A friction coefficient of zero stays zero: no tangential, rolling or twisting springs are added.
    """
    names = ("friction", "rolling_friction", "twisting_friction")
    high: Values = {name: NO_SLIDING for name in names if getattr(scene, name) > 0.0}
    return scene.replace(**used_parameters({"law": scene.law, **high}))


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


LEAST_STIFFNESS = 1e-3  # fraction of the largest stiffness; in a softer direction a specimen carries no load
QUASI_STATIC = 0.1 * INERTIAL_LIMIT  # largest inertial number of a strain probe
CHANGES = ("strain", "stress", "friction_loss", "rolling_loss", "damping_loss")  # quantities that change during a probe
WITHOUT_CREEP = ("strain_increment", "stress_increment", "sliding_loss", "damping_loss")


def probe(
    state: State,
    *,
    elastic: bool = False,
    engine: str | Device = "fused",
    progress: bool | Progress = True,
    plane: str = Probing.plane,
    directions: int | str = Probing.directions,
    kind: str = Probing.kind,
    amplitude: float | str | None = None,
    duration: float | str = Probing.duration,
) -> Probes:
    """Apply small increments of strain or stress to a state, each to the same initial state; returns Probes.

    The grains first come to rest in their fixed cell. Raises InputError for invalid values, PhysicsError if a probe
    fails.

    Args:
        state: The state to probe.
        elastic: True to use a friction so high that no contact slides.
        engine: As for labkit.make_specimen.
        progress: As for labkit.make_specimen.
        plane: As in labkit.Probing.
        directions: As in labkit.Probing.
        kind: As in labkit.Probing.
        amplitude: As in labkit.Probing.
        duration: As in labkit.Probing.
    """
    require_state(state)
    device, probing = device_of(engine), Probing(plane, directions, kind, amplitude, duration)
    return probes_of(at_rest(state, device), probing, elastic, device, progress)


def at_rest(state: State, engine: str | Device = "fused") -> State:
    """Return the state from which probes start, with the grains at rest in their fixed cell. Raises PhysicsError."""
    return execute(RestTask(state=state, device=device_of(engine)))


def probes_of(
    state: State,
    probing: Probing,
    elastic: bool = False,
    engine: str | Device = "fused",
    progress: bool | Progress = True,
) -> Probes:
    """Apply the probes that `probing` describes to a state at rest; see `probe`."""
    device = device_of(engine)
    plane = plane_of(probing.plane)
    angle, direction = plane.directions(probing.directions)
    state = state.replace(scene=without_sliding(state.scene)) if elastic else state
    make = path_maker(state, probing, elastic)
    paths = tuple(make(six) for six in (np.zeros(6), *direction))
    show = progress_function(progress, "probes")
    results = []
    for number, path in enumerate(paths):
        show(number / len(paths), f"probe {number + 1} of {len(paths)}")
        options = Options(record_strain=abs(path.strain), snapshots=1)  # record only the start and the end
        task = RunTask(state=state, path=path, options=options, device=device)
        execute(task)
        results.append(_row(task.memory))
    show(1.0, "done")
    null, *rows = results
    for row in rows:
        row |= {name: row[name] - null[name] for name in WITHOUT_CREEP}
        row["null_strain"], row["null_stress"] = null["strain_increment"], null["stress_increment"]
    material = "elastic" if elastic else "grains"
    data = dataset_of(plane, probing, material, angle, rows, affine_stiffness(state.snapshot()))
    attributes = {"engine": device.name, "scene": state.scene.to_json(), "grains": len(state.body_radius)}
    attributes |= {"precision": device.precision} if device.precision != "double" else {}
    return Probes(data.assign_attrs(attributes))


def affine_stiffness(snapshot: Snapshot) -> np.ndarray:
    """Return the stiffness for grains that move with the mean field (Voigt), an upper bound; (6, 6), Pa, Mandel."""
    return cell_stiffness(snapshot, 6) - FLOOR * snapshot.young_modulus * np.eye(6)


def path_maker(state: State, probing: Probing, elastic: bool) -> Callable[[np.ndarray], Path]:
    """Return a function that returns the path of a probe for a direction, a unit tensor (6,), or zero (null probe).

    The increment is applied in `duration` times the time that a shear wave needs to cross the cell,

        t = L sqrt(rho_b/G),    L = V^(1/3), rho_b the bulk density, 2 G the least eigenvalue of the affine stiffness,

    or in a longer time, if the inertial number of a strain probe would exceed QUASI_STATIC. Raises InputError for a
    specimen that carries no load in some direction.
    """
    snapshot = state.snapshot()
    softest, *_, stiffest = np.linalg.eigvalsh(affine_stiffness(snapshot)).tolist()
    stress = symmetric(love_stress(snapshot))
    pressure = float(mean_stress(stress))
    if softest <= LEAST_STIFFNESS * stiffest or pressure <= 0.0:
        raise InputError("the specimen carries no load in some direction and cannot be probed: give a denser one")
    density = float(np.sum(state.scene.mass(state.body_radius))) / state.volume
    size = probing.size(elastic)
    strain = size if probing.kind == "strain" else size * pressure / softest  # strain of an affine motion
    time = probing.duration * state.volume ** (1.0 / 3.0) * math.sqrt(2.0 * density / softest)
    if probing.kind == "strain":
        fastest = 2.0 * strain / time * np.diag([1.0, 0.0, 0.0])  # twice the mean rate
        number = inertial_number(fastest, pressure, 2.0 * float(state.body_radius.mean()), state.scene.density)
        time *= max(1.0, number / QUASI_STATIC)
    clock = {"rate": strain / time, "strain": strain / LOADING}
    if probing.kind == "strain":
        return lambda six: StrainProbe(**clock, increment=size * six)
    start = to_six(stress) / pressure
    return lambda six: StressProbe(**clock, pressure=pressure, start_stress=start, increment=size * six)


def _row(memory: RunInMemory) -> Values:
    """Return the variables of one probe."""
    groups = memory.contents()[1]
    run, volume = {name: values for name, (_, values) in groups[""].items()}, float(groups[""]["volume"][1][0])
    change = {name: run[name][-1] - run[name][0] for name in CHANGES}
    pairs = [
        {tuple(pair) for pair in snapshot.spheres.contacts.grain.tolist()}
        for _, snapshot in memory.recordings.snapshots
    ]
    return {
        "start_stress": symmetric(run["stress"][0]),
        "strain_increment": change["strain"],
        "stress_increment": symmetric(change["stress"]),
        "sliding_loss": float(change["friction_loss"] + change["rolling_loss"]) / volume,
        "damping_loss": float(change["damping_loss"]) / volume,
        "contacts_gained": float(len(pairs[-1] - pairs[0])),
        "contacts_lost": float(len(pairs[0] - pairs[-1])),
        "unbalanced_force": float(run["unbalanced_force"][-1]),
        "start_sha256": start_sha256(groups),
    }


def start_sha256(groups: Groups) -> str:
    """Return the SHA-256 of the start of a run: first record, positions, contacts and forces, hexadecimal."""
    digest, record, contacts, grains = hashlib.sha256(), groups[""], groups["contacts"], groups["grains"]
    number = int(contacts["row_size"][1][0])
    parts = [record[name][1][0] for name in sorted(record)]
    parts += [grains["radius"][1], grains["position"][1][0]]
    parts += [contacts[name][1][:number] for name in sorted(contacts) if contacts[name][0].dimensions[0] == "contact"]
    for values in parts:
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
