"""The reference engine: YADE's rolling-resistance law in a periodic cell. Runs inside YADE only.

YADE's step is turned so that it begins with the motion: Newton, reset, collider, forces. Between two
steps positions, cell, overlaps and forces then belong to one instant, and the velocity gradient set
there holds for cell and grains in the same step. The order of operations within the cycle is YADE's own.

YADE counts tension positive; signs are turned here and nowhere else.
"""

from __future__ import annotations

import gc

import numpy as np

from labkit.dem.engine import Engine
from labkit.dem.scene import Scene
from labkit.dem.state import State
from labkit.errors import InputError, PhysicsError

try:
    import yade
    from yade import Matrix3, Vector3
    from yade import utils as yade_utils
    from yade.wrapper import (
        Bo1_Sphere_Aabb,
        ForceResetter,
        InsertionSortCollider,
        InteractionLoop,
        NewtonIntegrator,
        Omega,
    )
except ImportError:  # outside YADE the class says what it is, and cannot be started
    yade = None

VERLET_DISTANCE = 0.1  # of the mean radius: how far a grain may move before neighbours are sought again


class YadeEngine(Engine):
    """YADE holding a State. Raises InputError when `threads` is not that of the running YADE (`yade -jN`)."""

    name = "yade"

    @classmethod
    def here(cls) -> bool:
        """Whether this is YADE's interpreter."""
        return yade is not None

    @classmethod
    def require(cls, scene: Scene) -> None:
        """Raises InputError for a contact law that YADE lacks."""
        if not scene.contact_law.on_yade:
            raise InputError(f"has no contact law {scene.law}", field="engine", value=cls.name, allowed="fused")

    def __init__(self, state: State, threads: int = 1) -> None:
        """Raises InputError outside YADE, and for another number of threads than it was started with."""
        if yade is None:
            raise InputError("engine yade runs inside YADE alone: labkit.run(..., engine='yade') starts it there")
        self.version = yade.config.version
        running = Omega().numThreads
        if threads != running:
            said = f"is not possible in a YADE that was started with {running}"
            raise InputError(said, field="threads", value=threads, allowed=f"{running}, or start yade -j{threads}")
        self.load(state)

    def load(self, state: State) -> None:
        """Goes on from another state. Raises InputError for a cell narrower than two grains."""
        _require_loadable(state)
        omega = self._omega = Omega()
        omega.reset()
        self._start, self._law = state, state.scene.contact_law.yade(state.scene)
        self._ledger = state.ledger
        self._cell_work = 0.0
        self._time = state.time
        self._step = state.step
        omega.periodic = True
        omega.cell.setBox(1, 1, 1)
        omega.cell.hSize = _matrix(state.cell)
        self._add_grains(state)
        gradient = _matrix(state.velocity_gradient)
        omega.cell.updateAttrs({"velGrad": gradient, "prevVelGrad": gradient})
        newton = NewtonIntegrator(damping=state.scene.local_damping, prevVelGrad=gradient, warnNoForceReset=False)
        forces = [
            ForceResetter(),
            InsertionSortCollider([Bo1_Sphere_Aabb()], verletDist=-VERLET_DISTANCE),
            InteractionLoop(self._law.geometry, self._law.physics, self._law.law),
        ]
        omega.engines = [newton, *forces]
        newton.dead = True
        omega.dt = 0.0  # no motion and no increment of the history while the contacts are found and loaded
        omega.step()
        self._set_history(state)
        omega.forces.f(0, True)  # YADE resets only forces that were summed, which Newton would have done
        omega.step()
        newton.dead = False
        omega.dt = state.time_step
        omega.trackEnergy = True
        self._stress = self._sum_stress()

    def _add_grains(self, state):
        """Bodies in the order of the state. Grains near in space are near in the state, and so in memory."""
        bodies, planar = self._omega.bodies, state.scene.planar
        common = self._law.material(float(state.radius[0])) if len(state.radius) else None
        columns = (state.position, state.velocity, state.angular_velocity)
        for radius, position, velocity, spin in zip(state.radius.tolist(), *(c.tolist() for c in columns), strict=True):
            grain = yade_utils.sphere(position, radius, material=self._law.material(radius) if planar else common)
            grain.state.vel = velocity
            grain.state.angVel = spin
            if planar:
                grain.state.blockedDOFs = "yXZ"
            bodies.append(grain)

    def _set_history(self, state):
        """Gives the contacts that YADE has found the tangential forces and moments of the state."""
        pairs = [tuple(pair) for pair in state.contact_grain.tolist()]
        history = dict(zip(pairs, zip(state.tangential_force, state.rolling_moment, strict=True), strict=True))
        for contact in self._omega.interactions:
            first, second = contact.id1, contact.id2
            sign = -1.0  # YADE keeps the force on the second grain
            if (first, second) not in history:
                first, second, sign = second, first, 1.0
            if (first, second) in history:
                force, moment = history[first, second]
                setattr(contact.phys, self._law.tangential_force, Vector3(*(sign * force)))
                setattr(contact.phys, self._law.rolling_moment, Vector3(*(sign * moment)))

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        omega = self._omega
        omega.cell.updateAttrs({"velGrad": _matrix(velocity_gradient)})
        gas = omega.interactions.countReal() < len(omega.bodies)
        parts = [1] * steps if gas else [steps]  # sums of the stress: in a gas collisions would fall between them
        for part in parts:
            self._advance(part, np.asarray(velocity_gradient))

    def _advance(self, steps, velocity_gradient):
        step = self._omega.step
        for _ in range(steps):
            step()
        self._step += steps
        self._time += steps * self._start.time_step
        self._require_width()
        before, self._stress = self._stress, self._sum_stress()
        strain = -velocity_gradient * steps * self._start.time_step
        self._cell_work += self._omega.cell.volume * float(np.sum(0.5 * (before + self._stress) * strain.T))

    def _require_width(self):
        """YADE's collider gives up, with a traceback, in a cell that a test has made narrower than two grains."""
        width, needed = _widths(np.array(self._omega.cell.hSize).reshape(3, 3), self._start.radius)
        if width < needed:
            raise PhysicsError(
                f"the cell has become {width:.3g} m wide at step {self._step}: YADE needs {needed:.3g} m, twice the "
                "largest grain and a margin; take a specimen of more grains, or --engine fused"
            )

    def stress(self) -> np.ndarray:
        return self._stress.copy()  # summed when the engine last stopped

    def _sum_stress(self):
        return -np.array(yade_utils.getStress(), dtype=float).reshape(3, 3).T

    def stop_grains(self) -> None:
        self._ledger = self._ledger.plus(0.0, 0.0, 0.0, yade_utils.kineticEnergy())
        yade_utils.calm()

    def _ledger_now(self):
        """What YADE has summed since the state was loaded added to the ledger of that state."""
        taken = dict(self._omega.energy.items())
        losses = (taken.get(name, 0.0) for name in (*self._law.losses, "nonviscDamp"))
        return self._ledger.plus(self._cell_work, *losses)

    def state(self) -> State:
        collecting = gc.isenabled()
        gc.disable()  # the many small objects made here would double the time
        try:
            return self._read_state()
        finally:
            if collecting:
                gc.enable()

    def _read_state(self):
        grains = [body.state for body in self._omega.bodies]
        contacts = list(self._omega.interactions)
        physics = [contact.phys for contact in contacts]
        pair = np.array([(contact.id1, contact.id2) for contact in contacts], np.int32).reshape(-1, 2)
        shift = _components([contact.cellDist for contact in contacts]).astype(np.int32)
        swap = (pair[:, 0] > pair[:, 1])[:, None]
        sign = np.where(swap, 1.0, -1.0)
        pair = np.sort(pair, axis=1)
        order = np.lexsort((pair[:, 1], pair[:, 0]))
        cell = self._omega.cell
        return self._start.replace(
            position=_components([grain.pos for grain in grains]),
            velocity=_components([grain.vel for grain in grains]),
            angular_velocity=_components([grain.angVel for grain in grains]),
            cell=np.array(cell.hSize, dtype=float).reshape(3, 3),
            velocity_gradient=np.array(cell.velGrad, dtype=float).reshape(3, 3),
            contact_grain=pair[order],
            contact_shift=np.where(swap, -shift, shift)[order],
            tangential_force=(sign * _components([getattr(p, self._law.tangential_force) for p in physics]))[order],
            rolling_moment=(sign * _components([getattr(p, self._law.rolling_moment) for p in physics]))[order],
            time=self._time,
            step=self._step,
            engine=self.name,
            engine_version=self.version,
            ledger=self._ledger_now(),
        )


def _components(vectors):
    """YADE vectors as an array (n, 3). Indexing them is ten times faster than unpacking or np.array."""
    return np.array([(v[0], v[1], v[2]) for v in vectors], dtype=float).reshape(-1, 3)


def _matrix(values):
    return Matrix3(*np.asarray(values, dtype=float).ravel().tolist())


def _require_loadable(state):
    """YADE knows one contact per pair of grains: a cell must be wider than two grains."""
    width, needed = _widths(state.cell, state.radius)
    if width < needed:
        raise InputError(
            f"the cell is {width:.3g} m wide: YADE needs {needed:.3g} m, twice the largest grain and a margin"
        )


def _widths(cell, radius):
    """The least width of the cell, and the width that YADE needs, m."""
    widths = 1.0 / np.linalg.norm(np.linalg.inv(cell), axis=1)
    return widths.min(), 4.0 * radius.max() * (1.0 + VERLET_DISTANCE)
