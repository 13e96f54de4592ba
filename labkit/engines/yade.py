"""The reference engine: YADE's contact laws in a periodic cell. It runs only inside YADE.

The cycle of YADE's engines is rotated so that a time step starts with the motion: Newton, reset, collider, forces.
Positions, cell, overlaps and forces between two steps then belong to the same instant, and a velocity gradient set
there applies to cell and grains in the same step. The cyclic order is YADE's own.

YADE counts tension positive; signs are flipped in this file and nowhere else.
"""

from __future__ import annotations

import gc
from collections.abc import Iterable
from typing import Any

import numpy as np

from labkit.dem.engine import Engine, Progress
from labkit.dem.scene import Scene
from labkit.dem.state import Ledger, State
from labkit.errors import InputError, PhysicsError
from labkit.micro.cells import widths

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
except ImportError:  # outside YADE the class can be described but not started
    yade = None

VERLET_DISTANCE = 0.1  # fraction of the mean radius: how far a grain may move before the next neighbour search


class YadeEngine(Engine):
    """YADE with a State loaded. Raises InputError unless YADE runs with `threads` threads (`yade -jN`)."""

    name = "yade"

    @classmethod
    def here(cls) -> bool:
        """True in YADE's interpreter."""
        return yade is not None

    @classmethod
    def elsewhere(cls, job: str, processors: int, progress: Progress) -> None:
        from labkit.engines.yade_process import run_script

        run_script("task.py", [job], processors, progress)

    @classmethod
    def require(cls, scene: Scene) -> None:
        """Raise InputError for a contact law that YADE lacks."""
        if not scene.contact_law.on_yade:
            raise InputError(f"has no contact law {scene.law}", field="engine", value=cls.name, allowed="fused")

    def __init__(self, state: State, threads: int = 1) -> None:
        """Load the state. Raises InputError outside YADE, or if YADE was started with another number of threads."""
        if yade is None:
            raise InputError("the yade engine runs only inside YADE: labkit.run(..., engine='yade') starts it there")
        self.version = yade.config.version
        running = Omega().numThreads
        if threads != running:
            reason = f"is not valid: this YADE was started with {running}"
            raise InputError(reason, field="threads", value=threads, allowed=f"{running}, or start yade -j{threads}")
        self.load(state)

    def load(self, state: State) -> None:
        """Replace the loaded state. Raises InputError if the cell is narrower than two grains."""
        _require_loadable(state)
        omega = self._omega = Omega()
        omega.reset()
        law = state.scene.contact_law.yade(state.scene)
        assert law is not None, "`require` has accepted the contact law"
        self._start, self._law = state, law
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
        damping = state.scene.contact_law.features(state.scene).damping or 0.0
        newton = NewtonIntegrator(damping=damping, prevVelGrad=gradient, warnNoForceReset=False)
        forces = [
            ForceResetter(),
            InsertionSortCollider([Bo1_Sphere_Aabb()], verletDist=-VERLET_DISTANCE),
            InteractionLoop(self._law.geometry, self._law.physics, self._law.law),
        ]
        omega.engines = [newton, *forces]
        newton.dead = True
        omega.dt = law.loading_step  # finds the contacts without motion and without an increment of their history
        omega.step()
        self._set_history(state)
        omega.forces.f(0, True)  # sums the forces as Newton would: YADE resets only summed forces
        omega.step()
        newton.dead = False
        omega.dt = state.time_step
        omega.trackEnergy = True
        self._stress = self._sum_stress()

    def _add_grains(self, state: State) -> None:
        """Add the bodies in the order of the state, in which grains close in space are close in memory."""
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

    def _set_history(self, state: State) -> None:
        """Copy the tangential forces and rolling moments of the state to YADE's contacts."""
        pairs = [tuple(pair) for pair in state.contact_grain.tolist()]
        history = dict(zip(pairs, zip(state.tangential_force, state.rolling_moment, strict=True), strict=True))
        for contact in self._omega.interactions:
            first, second = contact.id1, contact.id2
            sign = -1.0  # YADE stores the force on the second grain
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
        parts = [1] * steps if gas else [steps]  # in a gas, collisions would be missed between two stress sums
        for part in parts:
            self._advance(part, np.asarray(velocity_gradient))

    def _advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        step = self._omega.step
        for _ in range(steps):
            step()
        self._step += steps
        self._time += steps * self._start.time_step
        self._require_width()
        before, self._stress = self._stress, self._sum_stress()
        strain = -velocity_gradient * steps * self._start.time_step
        self._cell_work += self._omega.cell.volume * float(np.sum(0.5 * (before + self._stress) * strain.T))

    def _require_width(self) -> None:
        """Raise PhysicsError if the cell is narrower than two grains, where YADE's collider ends with a traceback."""
        width, needed = _widths(np.array(self._omega.cell.hSize).reshape(3, 3), self._start.radius)
        if width < needed:
            raise PhysicsError(
                f"the cell is only {width:.3g} m wide at step {self._step}: YADE needs {needed:.3g} m, twice the "
                "largest grain plus a margin; use a specimen with more grains, or --engine fused"
            )

    def stress(self) -> np.ndarray:
        return self._stress.copy()  # summed at the end of the last `advance`

    def _sum_stress(self) -> np.ndarray:
        return -np.array(yade_utils.getStress(), dtype=float).reshape(3, 3).T

    def stop_grains(self) -> None:
        self._ledger = self._ledger.plus(0.0, 0.0, 0.0, yade_utils.kineticEnergy())
        yade_utils.calm()

    def _ledger_now(self) -> Ledger:
        """Return the ledger of the loaded state plus the work and losses that YADE has summed since."""
        energies = dict(self._omega.energy.items())
        losses = (energies.get(name, 0.0) for name in (*self._law.losses, "nonviscDamp"))
        both = (a + b for a, b in zip(losses, self._law.dissipated(), strict=True))
        return self._ledger.plus(self._cell_work, *both)

    def state(self) -> State:
        collecting = gc.isenabled()
        gc.disable()  # collecting the many small objects created here would double the time
        try:
            return self._read_state()
        finally:
            if collecting:
                gc.enable()

    def _read_state(self) -> State:
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


def _components(vectors: Iterable[Any]) -> np.ndarray:
    """Convert YADE vectors to an array (n, 3); indexing them is ten times faster than unpacking or np.array."""
    return np.array([(v[0], v[1], v[2]) for v in vectors], dtype=float).reshape(-1, 3)


def _matrix(values: np.ndarray) -> Any:
    """Convert (3, 3) to a YADE matrix."""
    return Matrix3(*np.asarray(values, dtype=float).ravel().tolist())


def _require_loadable(state: State) -> None:
    """Raise InputError if the cell is too narrow: YADE allows only one contact per pair of grains."""
    width, needed = _widths(state.cell, state.radius)
    if width < needed:
        raise InputError(
            f"the cell is {width:.3g} m wide: YADE needs {needed:.3g} m, twice the largest grain plus a margin"
        )


def _widths(cell: np.ndarray, radius: np.ndarray) -> tuple[float, float]:
    """Return the smallest width of the cell and the width that YADE needs, m."""
    return widths(cell).min(), 4.0 * radius.max() * (1.0 + VERLET_DISTANCE)
