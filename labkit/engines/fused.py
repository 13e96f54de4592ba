"""The fused engine: labkit's own compiled kernel, which runs in the process of labkit and does not need YADE.

The contact law `rolling_resistance` uses YADE's formulas with operations in the same order; `spring_dashpot` uses
Eqs. 1-3. Results are bitwise identical for any number of threads.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from labkit.engines.base import Abilities, Engine
from labkit.engines.kernel.blocks import Needs, compile_functions, is_law_kept
from labkit.engines.kernel.bodies import arrange, bodies_of
from labkit.engines.kernel.host import call_common, level
from labkit.engines.kernel.layout import CELL_WORK, CONTACT_SUMS, DAMPING_LOSS, SITE_V, SITE_W, SUM_ROWS, WIDTH
from labkit.engines.kernel.loop import Loop
from labkit.engines.kernel.machine import code_of, load_code, target_processor
from labkit.engines.kernel.motion import Motion
from labkit.engines.kernel.packing import GRAINS_PER_DOMAIN, History, PackedArrays, pack
from labkit.engines.kernel.specimen import Kinematics, Pairs, Scale, contacts_among, history_of, require_loadable
from labkit.engines.threads import ThreadChoice, warn_once
from labkit.errors import InputError, PhysicsError
from labkit.grains.columns import history_fields
from labkit.grains.laws.parts import columns_in
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.process.system import number_of_cores
from labkit.records.energy import kinetic_energy
from labkit.servo.formula import ServoPlan
from labkit.servo.plan import Corrections, ahead
from labkit.version import __version__

if TYPE_CHECKING:
    from labkit.engines.followers import Ranks
    from labkit.engines.kernel.exchange import Exchange

# Verlet skin as a fraction of the mean diameter. In quasi-static tests the smallest skin suffices for about 1000 steps.
# If the grains move faster, the skin is doubled until searches are at least SEARCH_STEPS[0] steps apart.
LEAST_SKIN, MOST_SKIN = 0.01, 0.32
SEARCH_STEPS = (150, 1500)

NONE = Corrections.constant(0, np.zeros((3, 3))).plan
# arrays of a State that the engine stores in its own layout
OWN = (
    *("position", "velocity", "angular_velocity", "contact_grain", "contact_shift"),
    *("tangential_force", "rolling_moment", "columns"),
)

KINDS: dict[str, type[np.floating]] = {"double": np.float64, "mixed": np.float32}  # type of numbers that may be single


def needs_of(scene: Scene, precision: str, clumps: bool = False, energy: bool = True) -> Needs:
    """Return everything on which the compiled functions of a scene depend."""
    law = scene.contact_law
    damped = law.local_damping(scene) is not None
    single = KINDS[precision] is np.float32
    return Needs(law.composition(scene), law.numbers(scene), single, energy, damped, clumps)


def was_compiled(scene: Scene, precision: str) -> bool:
    """Return True if the contact law of a scene is already compiled."""
    return is_law_kept(scene.contact_law, needs_of(scene, precision))


class FusedEngine(Engine):
    """The kernel with one State loaded.

    Raises InputError if `threads` exceeds the number of processors available to this process.

    The engine uses `threads` threads only while they are faster than one (labkit.engines.threads), and at most one
    thread per 3,000 grains.

    Args:
        state: State to load.
        threads: Number of threads.
        skin: Verlet skin as a fraction of the mean diameter; None lets the engine adapt it.
        precision: "double", or "mixed" with some numbers in single precision (labkit.engines.kernel.layout).
        ranks: The MPI ranks, which share the domains of the specimen; None to compute in this process alone.
    """

    name = "fused"
    abilities = Abilities(
        parallel=("threads", "ranks"),
        clumps=True,
        precisions=("double", "mixed"),
        follow=lambda engine, corrections: engine.follow(corrections),
    )
    version = __version__
    energy = True  # True to sum work and losses; only a benchmark switches this off

    def __init__(
        self,
        state: State,
        threads: int = 1,
        skin: float | None = None,
        precision: str = "double",
        ranks: Ranks | None = None,
    ) -> None:
        """Load the state; the first use of a contact law compiles the kernel. Raises InputError."""
        cores = number_of_cores()
        if threads > cores:
            most = f"at most {cores}"
            raise InputError(
                "are too many for the fused engine on this computer", field="threads", value=threads, allowed=most
            )
        self._given_skin, self._precision, self._kind = skin, precision, KINDS[precision]
        self._threads, self._ranks = threads, ranks
        self._exchange: Exchange | None = None
        self.thread_choice = ThreadChoice(1)
        self.load(state)

    def load(self, state: State) -> None:
        self._accept(state)
        self._prepare()
        self._solids = self._solids_of(self._start.radius)
        kinematics = state.position, state.velocity, state.angular_velocity
        position, velocity, spin = (np.array(values, float) for values in kinematics)
        self._search((position, velocity, spin), history_of(state, self._needs.law.columns))
        self._settle()

    def _accept(self, state: State) -> None:
        """Store what concerns the whole specimen. Raises InputError for a state that the engine cannot load."""
        require_loadable(state)
        radius = np.array(state.radius, float)  # the user may change the array later
        self._start = state.replace(radius=radius, **dict.fromkeys(OWN))
        self._bodies_of_state = bodies_of(state)
        self._scale = Scale.of(state)

    def _prepare(self) -> None:
        """Set everything that does not depend on single grains, and compile the functions."""
        state, scene = self._start, self._start.scene
        self._packing: PackedArrays | None = None
        self._ledger = state.ledger
        self._cell = np.array(state.cell, dtype=float, order="C")
        self._before = np.array(state.velocity_gradient, dtype=float, order="C")
        self._wanted, self._place, self._totals = self._before.copy(), np.zeros(2, np.int64), np.zeros(9)
        self._time_step, self._time, self._step = state.time_step, state.time, state.step
        self._skin, self._since_search = (self._given_skin or LEAST_SKIN) * self._scale.mean_diameter, 0
        self._damping = scene.contact_law.local_damping(scene)
        self._needs = needs_of(scene, self._precision, self._bodies_of_state is not None, self.energy)
        self._functions = self._compile()

    def _compile(self) -> list[int]:
        """Return the functions of the scene: on all ranks the code of rank 0, since two compilations may differ."""
        ranks, law = self._ranks, self._start.scene.contact_law
        if ranks is None or ranks.size == 1:
            return compile_functions(law, self._needs)
        ranks.require_same(repr((level(), target_processor())).encode(), "the processors")
        return load_code(ranks.share(lambda: code_of(compile_functions(law, self._needs))))

    def _settle(self) -> None:
        """Compute the forces of a loaded state."""
        self._divide_work()
        self._run(1, NONE, dt=0.0, moved_already=True)

    def _solids_of(self, radius: np.ndarray) -> np.ndarray:
        """Return radius, 1/mass and 1/(moment of inertia), (grain, 3), of grains with the radii (grain,), in m."""
        masses = self._start.scene.mass(radius), self._start.scene.moment_of_inertia(radius)
        return np.stack([radius, *(1.0 / mass for mass in masses)], axis=1)

    def _divide_work(self) -> None:
        """Choose the largest useful number of threads for the loaded specimen."""
        domains = len(self.packing.arrays.contact_first)
        if self._ranks is not None and self._ranks.size * self._threads > domains:
            each, problem = GRAINS_PER_DOMAIN * self._threads, "are too many for these grains"
            allowed = f"at most {domains // self._threads}, one per {each:,} grains"
            raise InputError(problem, field="ranks", value=self._ranks.size, allowed=allowed)
        most = min(self._threads, domains)
        if most > 1 and not call_common("several_threads"):
            most = 1
            warn_once("the fused engine runs on 1 thread: its compiler had no OpenMP; install g++ and labkit again")
        elif most < self._threads:
            warn_once(
                f"the fused engine runs on {most} thread{'s' * (most > 1)}, not {self._threads}: it can use one thread "
                f"per {GRAINS_PER_DOMAIN:,} grains"
            )
        if most != self.thread_choice.most:
            self.thread_choice = ThreadChoice(most)

    @property
    def packing(self) -> PackedArrays:
        """The arrays of the kernel since the last neighbour search."""
        assert self._packing is not None, "no state is loaded"
        return self._packing

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        self._follow(NONE._replace(steps=np.array([steps], np.int64), gradient=np.array([velocity_gradient], float)))

    def follow(self, corrections: Corrections) -> None:
        """Advance by the steps of the corrections, with the servo in the compiled loop."""
        self._follow(corrections.plan)

    def _follow(self, plan: ServoPlan) -> None:
        steps = int(plan.steps.sum())
        self._place[:] = 0
        done, searched, at_once = 0, False, ahead(self._scale.grains)
        while done < steps:
            begin = time.perf_counter()
            wanted = min(steps - done, at_once)  # Python notices Ctrl-C between two calls of the compiled loop
            completed, search = self._run(self.thread_choice.steps(wanted), plan, self._time_step, searched)
            self.thread_choice.record(completed, time.perf_counter() - begin)
            done += completed
            self._since_search += completed
            searched = search
            if search:
                self._search_again()
        self._step += steps
        for interval in plan.steps.tolist():  # summed one by one: bitwise identical for any division of a run
            self._time += interval * self._time_step

    def _search_again(self) -> None:
        self._fit_margin()
        self._gather()
        self._search(self.packing.unpack_grains(), self.packing.unpack_history())

    def _fit_margin(self) -> None:
        """Widen or narrow the Verlet skin according to the number of steps since the last search."""
        diameter = self._scale.mean_diameter
        if self._given_skin is not None:
            return
        if self._since_search < SEARCH_STEPS[0]:
            self._skin = min(2.0 * self._skin, MOST_SKIN * diameter)
        elif self._since_search > SEARCH_STEPS[1]:
            self._skin = max(0.5 * self._skin, LEAST_SKIN * diameter)
        self._since_search = 0

    def _run(self, steps: int, plan: ServoPlan, dt: float, moved_already: bool) -> tuple[int, bool]:
        return self._loop.advance(steps, moved_already, dt, plan, self.thread_choice.count)

    def _search(self, kinematics: Kinematics, history: History) -> None:
        """Find all pairs of neighbouring grains and fill the arrays of the kernel."""
        self._free()
        scene, bodies, skin = self._start.scene, self._bodies_of_state, self._skin
        of_bodies = None if self._start.bodies is None else self._start.bodies.body
        p = pack(scene, self._solids, kinematics, history, self._cell, skin + self._scale.reach, self._kind, of_bodies)
        self._packing, self._bodies = p, None if bodies is None else arrange(bodies, p.number, p.arrays)
        moving = Motion(
            *(self._cell, self._wanted, self._before, np.zeros((3, 3)), self._place, self._totals),
            *(np.zeros((2, 6)), np.zeros((3, 3, 3)), self._cell.copy(), np.zeros((3, 3)), np.array([0.0, 1.0])),
            *(self._scale.largest_diameter, skin),
        )
        self._exchange = self._exchange_of(p, moving)
        compiled = self._functions, self._needs, self._damping
        self._loop = Loop(p.arrays, moving, self._bodies, *compiled, self._exchange)
        self._place_images()

    def _free(self) -> None:
        """Move work and losses to the ledger, and free the arrays, before new ones are allocated."""
        self._enter_flows()
        self._packing = self._exchange = self._bodies = None
        vars(self).pop("_loop", None)

    def _exchange_of(self, packing: PackedArrays, moving: Motion) -> Exchange | None:
        """Return the exchange with other ranks after a neighbour search, or None on one rank."""
        if self._ranks is None:
            return None
        from labkit.engines.kernel.exchange import ImageExchange

        return ImageExchange(self._ranks, packing.arrays)

    def _place_images(self) -> None:
        """Copy the grains to their images in other periods and domains (host/loop.hpp)."""
        self._loop.place_images(self._drift())

    def _drift(self) -> np.ndarray:
        """Return the velocity that each period adds, L times the cell before its last motion, (3, 3), in m/s."""
        return self._before @ np.linalg.solve(np.eye(3) + self._time_step * self._before, self._cell)

    def _gather(self) -> None:
        """Let this rank know the grains, contacts and sums of all ranks."""
        if self._exchange is not None:
            self._exchange.gather()

    def _enter_flows(self) -> None:
        """Move work and losses from the sums of the kernel to the ledger."""
        if self._packing is None:
            return
        self._gather()
        rows = slice(CELL_WORK, CELL_WORK + SUM_ROWS * WIDTH)
        work, doubles = self._packing.arrays.work[:, rows], self._packing.arrays.doubles
        sums = work + doubles[:, CONTACT_SUMS:]  # one of the two terms is zero
        flows = sums.reshape(len(sums), SUM_ROWS, WIDTH).swapaxes(0, 1).reshape(SUM_ROWS, -1).sum(axis=1)
        cell_work, *losses = flows.tolist()
        lost = dict(zip(self._needs.law.losses, losses, strict=False))
        friction, rolling, dashpots = (lost.pop(f"{name}_loss", 0.0) for name in ("friction", "rolling", "damping"))
        damping = float(doubles[:, DAMPING_LOSS : DAMPING_LOSS + WIDTH].sum())
        work[:], doubles[:] = 0.0, 0.0
        self._ledger = self._ledger.plus(cell_work, friction, rolling, damping + dashpots, lost)
        if not np.isfinite(self._ledger.cell_work):
            raise PhysicsError(f"forces became NaN: the time step {self._time_step:.3g} s is too large")

    def stop_grains(self) -> None:
        if self._bodies is not None:
            super().stop_grains()
            return
        self._gather()
        position, velocity, spin = self.packing.unpack_grains()
        moving = self._start.replace(
            position=position, velocity=velocity, angular_velocity=spin, velocity_gradient=self._before
        )
        self._ledger = self._ledger.plus(0.0, 0.0, 0.0, kinetic_energy(moving))
        a = self.packing.arrays
        a.grains[:], a.forces[:] = 0.0, 0.0
        a.motions[:, SITE_V : SITE_W + 3] = 0.0
        self._place_images()
        self._run(1, NONE, dt=0.0, moved_already=True)  # a step of 0 s updates the contacts without moving grains

    def stress(self) -> np.ndarray:
        self._loop.branch_force()
        return -self._totals.reshape(3, 3) / np.linalg.det(self._cell)

    def state(self) -> State:
        self._enter_flows()
        return self._state_of(*self._unpack())

    def _unpack(self) -> tuple[Kinematics, Pairs]:
        """Return grains and pairs, touching or not, with the indices of the State."""
        p = self.packing
        return p.unpack_grains(), Pairs(p.order.take(p.pairs.T), p.pair_shift, p.take_history(slice(None)))

    def _state_of(self, grains: Kinematics, pairs: Pairs) -> State:
        position, velocity, spin = grains
        law, of_law = self._start.scene.contact_law, self._needs.law
        contacts = contacts_among(pairs, position, self._start.radius, self._cell, of_law.columns if law.far else {})
        contact_grain, contact_shift, order, sign = contacts
        rows = (np.where(self.packing.odd, sign, 1) * pairs.rows.take(order, 0)).astype(float)
        history = columns_in(rows, of_law.columns)
        start, moved = self._start, {} if self._bodies is None else self._bodies.motion()
        return start.replace(
            position=position,
            velocity=velocity,
            angular_velocity=spin,
            cell=self._cell.copy(),
            velocity_gradient=self._before.copy(),
            contact_grain=contact_grain,
            contact_shift=contact_shift,
            **history_fields(law.columns, history, len(order)),
            time=self._time,
            step=self._step,
            engine=self.name,
            engine_version=self.version,
            precision=self._precision,
            ledger=self._ledger,
            clumps=start.clumps and start.clumps.after(start.scene.density, position, velocity, spin, moved),
        )
