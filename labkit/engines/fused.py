"""The fused engine: a compiled kernel for the scenes of this laboratory alone, in the Python that labkit runs in.

It needs no YADE. The law `rolling_resistance` follows YADE's formulas and its order of operations, `spring_dashpot`
Eqs. 1-3. Any number of threads gives the same bits.
"""

from __future__ import annotations

import numba
import numpy as np

import labkit
from labkit.dem.energy import kinetic_energy
from labkit.dem.engine import Engine
from labkit.dem.state import State
from labkit.engines.kernel import steps
from labkit.engines.kernel.build import kernel_of
from labkit.engines.kernel.layout import CELL_WORK, DAMPING_LOSS, DASHPOT_LOSS, FRICTION_LOSS, ROLLING_LOSS, WIDTH
from labkit.engines.kernel.packing import Grains, History, pack
from labkit.engines.kernel.steps import Motion
from labkit.errors import InputError, PhysicsError
from labkit.io.memory import return_large_arrays

# Verlet skin of the pairs that are kept at hand, of the mean diameter. Quasi-static grains move slowly: the least is
# enough for a thousand steps. Where they fly about it doubles until a search lasts for SEARCH_STEPS[0].
LEAST_MARGIN, MOST_MARGIN = 0.01, 0.32
SEARCH_STEPS = (150, 1500)


# Arrays of a State that the kernel holds in its own form
IN_KERNEL = (
    "position",
    "velocity",
    "angular_velocity",
    "contact_grain",
    "contact_shift",
    "tangential_force",
    "rolling_moment",
)


class FusedEngine(Engine):
    """The kernel holding a State. Raises InputError when this computer has fewer than `threads` threads for it.

    `skin`: the Verlet skin of the pairs that are kept at hand, of the mean diameter; None: the engine adapts it.
    """

    name = "fused"
    version = labkit.__version__
    energy = True  # whether work and losses are summed: `labkit bench` alone leaves them out

    def __init__(self, state: State, threads: int = 1, skin: float | None = None) -> None:
        """Compiles at the first state of a law, and loads the state. Raises InputError."""
        return_large_arrays()
        if threads > numba.config.NUMBA_NUM_THREADS:
            most = f"at most {numba.config.NUMBA_NUM_THREADS}"
            raise InputError("are too many for the engine fused here", field="threads", value=threads, allowed=most)
        if threads > 1:
            numba.set_num_threads(threads)
        self._skin = skin
        self._threads = threads
        self.load(state)

    def load(self, state: State) -> None:
        scene = state.scene
        self._start = state.replace(**dict.fromkeys(IN_KERNEL))
        self._packing, self._ledger = None, state.ledger
        self._cell = np.array(state.cell, dtype=float)
        self._before = np.array(state.velocity_gradient, dtype=float)
        self._time_step, self._time, self._step = state.time_step, state.time, state.step
        self._margin, self._since_search = (self._skin or LEAST_MARGIN) * 2.0 * state.radius.mean(), 0
        self._kernel, self._features = kernel_of(scene.contact_law), scene.contact_law.features(scene)
        self._advance = self._kernel.advance if self._threads == 1 else self._kernel.advance_threads
        self._mass = scene.mass(state.radius), scene.moment_of_inertia(state.radius)
        rows = [
            values
            for values, kept in (
                (state.tangential_force, self._features.friction),
                (state.rolling_moment, self._features.rolling),
            )
            if kept is not None
        ]
        history = History(
            state.contact_grain,
            state.contact_shift,
            np.concatenate(rows, axis=1) if rows else np.zeros((len(state.contact_grain), 0)),
        )
        self._search((state.position, state.velocity, state.angular_velocity), history)
        try:
            self._run(1, self._before, dt=0.0, moved_already=True)
        except Exception as error:  # of Numba, at a law of the user's own that is Python but nothing to compile
            if scene.contact_law.labkits:
                raise
            said = next((line for line in str(error).splitlines() if line.strip()), "")
            raise InputError(
                f"contact law {scene.law} cannot be compiled ({said.strip()}): write its `pair` with numbers, tuples "
                "and the functions of labkit.dem.laws.vectors alone"
            ) from error

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        gradient = np.array(velocity_gradient, dtype=float)
        done, searched = 0, False
        while done < steps:
            taken, search = self._run(steps - done, gradient, self._time_step, searched)
            done += taken
            self._since_search += taken
            searched = search
            if search:
                self._search_again()
        self._step += steps
        self._time += steps * self._time_step

    def _search_again(self):
        self._fit_margin()
        self._search(self._packing.unpack_grains(), self._packing.unpack_history())

    def _fit_margin(self):
        """A wider or narrower skin for the next search, after how long the last one has lasted."""
        diameter = 2.0 * self._start.radius.mean()
        if self._skin is not None:
            return
        if self._since_search < SEARCH_STEPS[0]:
            self._margin = min(2.0 * self._margin, MOST_MARGIN * diameter)
        elif self._since_search > SEARCH_STEPS[1]:
            self._margin = max(0.5 * self._margin, LEAST_MARGIN * diameter)
        self._since_search = 0

    def _run(self, steps, gradient, dt, moved_already):
        law = self._features
        motion = Motion(
            self._cell, self._before, self._first_cell, self._spread, 2.0 * self._start.radius.max(), self._margin
        )
        return self._advance(
            steps,
            moved_already,
            dt,
            gradient,
            motion,
            self._packing.arrays,
            law.constants,
            law.friction,
            law.rolling,
            law.dashpots,
            law.damping,
            gradient if self.energy else None,
            law.turning,
        )

    def _search(self, kinematics, history):
        """Finds the pairs of grains near each other anew and lays out the kernel's arrays."""
        self._enter_flows()
        self._packing = None  # the old arrays make room for the new
        scene, radius = self._start.scene, self._start.radius
        self._packing = p = pack(
            Grains(*kinematics, radius, *self._mass), history, self._cell, self._margin, scene.normal_stiffness
        )
        self._first_cell, self._spread = self._cell.copy(), np.array([0.0, 1.0])
        drift = self._before @ np.linalg.solve(np.eye(3) + self._time_step * self._before, self._cell)
        for number, block in enumerate(p.arrays.grains):
            steps.write_sites(p.arrays.sites, block, number * WIDTH, WIDTH)
        owner, shift = p.arrays.owner, p.arrays.shift
        steps.image_sites(p.arrays.sites, owner, 0, len(owner), shift, self._cell, drift)

    def _enter_flows(self):
        """Moves work and losses from the kernel's sums to the ledger."""
        if self._packing is None:
            return
        sums = [
            self._packing.arrays.work[:, row : row + WIDTH]
            for row in (CELL_WORK, FRICTION_LOSS, ROLLING_LOSS, DAMPING_LOSS, DASHPOT_LOSS)
        ]
        work, friction, rolling, damping, dashpots = (float(values.sum()) for values in sums)
        for values in sums:
            values[:] = 0.0
        self._ledger = self._ledger.plus(work, friction, rolling, damping + dashpots)
        if not np.isfinite(self._ledger.cell_work):
            raise PhysicsError(f"forces became NaN: the time step {self._time_step:.3g} s is too large")

    def stress(self) -> np.ndarray:
        total = self._kernel.branch_force(self._packing.arrays, self._features.friction)
        return -total / np.linalg.det(self._cell)

    def stop_grains(self) -> None:
        state = self.state()
        nothing = np.zeros_like(state.velocity)
        ledger = state.ledger.plus(0.0, 0.0, 0.0, kinetic_energy(state))
        self.load(state.replace(velocity=nothing, angular_velocity=nothing, ledger=ledger))

    def state(self) -> State:
        self._enter_flows()
        position, velocity, spin = self._packing.unpack_grains()
        history = self._packing.unpack_history()
        first, second = history.grain[:, 0], history.grain[:, 1]
        branch = position[second] + history.shift @ self._cell.T - position[first]
        radius = self._start.radius
        distance = np.sqrt(np.einsum("ci,ci->c", branch, branch))
        touching = np.flatnonzero(radius[first] + radius[second] - distance >= 0.0)
        order = touching[np.lexsort((*history.shift[touching].T, second[touching], first[touching]))]
        rows = history.rows
        nothing = np.zeros((len(order), 3))
        friction, rolling = self._features.friction is not None, self._features.rolling is not None
        return self._start.replace(
            position=position,
            velocity=velocity,
            angular_velocity=spin,
            cell=self._cell.copy(),
            velocity_gradient=self._before.copy(),
            contact_grain=history.grain[order].astype(np.int32),
            contact_shift=history.shift[order].astype(np.int32),
            tangential_force=rows[order, :3] if friction else nothing,
            rolling_moment=rows[order, -3:] if rolling else nothing,
            time=self._time,
            step=self._step,
            engine=self.name,
            engine_version=self.version,
            ledger=self._ledger,
        )
