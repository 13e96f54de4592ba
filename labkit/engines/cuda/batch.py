"""States that advance together on the device."""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable, Sequence
from typing import cast

import numpy as np

import labkit
from labkit.engines.base import IN_ENGINE
from labkit.engines.cuda.arrays import ENERGIES, new_grains, new_grid, new_lists, new_states, put, rows_of, zeros
from labkit.engines.cuda.build import kernels_of, row_of, shape_of
from labkit.engines.cuda.contacts import STRESSES
from labkit.engines.cuda.device import BLOCK, SLICE, cuda, require_device
from labkit.engines.cuda.listing import lists_of, state_from_lists
from labkit.engines.cuda.memory import KINDS, SPARE, require_room
from labkit.engines.cuda.reading import Reader
from labkit.engines.cuda.servo import new_plans, put_plan
from labkit.engines.kernel.build import explain_refusal
from labkit.engines.kernel.neighbours import grid_shape, sort_grains
from labkit.errors import InputError
from labkit.grains.state import State
from labkit.servo.plan import AHEAD, Corrections

SKIN = 0.03  # Verlet skin as a fraction of the mean diameter
CHUNK = 50  # maximum number of steps between two checks whether a search is due

LOST = "a grain is lost or its position became NaN: the time step is too large"


class Batch:
    """States on the device. They share the type of contact law; everything else may differ.

    `failures` gives for each state one sentence that says why it stopped, or None while it runs. A state that fails
    does not affect the others, and the results of a state have the same bits in any batch.
    """

    def __init__(self, states: Sequence[State], precision: str = "double") -> None:
        """Load the states; compile the kernels at the first use of a contact law.

        Raises InputError if a state cannot be loaded.

        Args:
            states: States to advance together.
            precision: "double", or "mixed" with forces and history of contacts in single precision.
        """
        require_device()
        if not states:
            raise InputError("a batch needs at least one State")
        require_room([state.number_of_grains for state in states], precision)
        n, self._precision = len(states), precision
        scene, law = states[0].scene, states[0].scene.contact_law
        self._law, self._shape = type(law), shape_of(scene)
        self._kernels = kernels_of(cast(Hashable, self._law), self._shape, precision == "mixed")
        self._count = np.array([state.number_of_grains for state in states])
        padded = -(-self._count // BLOCK) * BLOCK
        self._first = np.cumsum(padded) - padded
        self._blocks = int(padded.sum()) // BLOCK
        self._room = np.zeros(n, int)
        self._states = new_states(self._first, self._count, len(row_of(scene)))
        self._grains = new_grains(np.repeat(np.arange(n), padded // BLOCK))
        self._lists = new_lists(n, int(padded.sum()), KINDS[precision])
        self._grid = new_grid(self._count, int(padded.sum()))
        self._plans = new_plans(n, AHEAD)
        self._stream, self._reader, self._region = cuda.stream(), Reader(), np.zeros((2, n), np.int64)
        self._left, self._interval, self._controlled = np.zeros(n, np.int32), np.ones(n, int), np.zeros(n, bool)
        self._sums, self._totals = zeros((self._blocks, STRESSES)), zeros((n, STRESSES))
        self._start = list(states)
        self._order = [np.zeros(0, int)] * n
        self._side = np.zeros(n, np.int32)
        self._stresses: np.ndarray | None = None
        self.failures: list[str | None] = [None] * n
        for i, state in enumerate(states):
            self._put(i, state)
        with explain_refusal(law, " for a GPU"):
            self._search(np.ones(n, bool), moving=0.0)

    def __len__(self) -> int:
        return len(self._start)

    def takes(self, i: int, state: State) -> bool:
        """True if a State can replace the i-th one: same number of grains, contact law and features."""
        same = type(state.scene.contact_law) is self._law and shape_of(state.scene) == self._shape
        return same and state.number_of_grains == self._count[i]

    def load(self, i: int, state: State) -> None:
        """Replace the i-th state by one with as many grains. Raises InputError if its grains or law differ."""
        if not self.takes(i, state):
            raise InputError(f"load a state with {self._count[i]} grains and the same contact law as state {i}")
        self._put(i, state)
        self.failures[i], self._left[i], self._stresses = None, 0, None
        self._search(np.arange(len(self)) == i, moving=0.0)

    def advance(self, steps: int | np.ndarray, velocity_gradient: np.ndarray) -> None:
        """Advance each state.

        Args:
            steps: Number of steps, the same for all states or one for each, (n,).
            velocity_gradient: Velocity gradients, (n, 3, 3), 1/s.
        """
        for i, count in enumerate(np.broadcast_to(steps, len(self))):
            if count > 0 and self.failures[i] is None:
                self.begin(i, Corrections.constant(int(count), velocity_gradient[i]))
        while self.going.any():
            self.run()

    @property
    def going(self) -> np.ndarray:
        """True (n,) for states with unfinished steps."""
        return self._left > 0

    def begin(self, i: int, corrections: Corrections) -> None:
        """Submit the steps of the corrections for the i-th state, which must have no steps left."""
        put_plan(self._plans, i, corrections)
        self._left[i], self._interval[i] = corrections.total, corrections.steps.max()
        self._controlled[i] = corrections.servo is not None
        for array, value in ((self._states.left, corrections.total), (self._states.until, 0)):
            array[i : i + 1].copy_to_device(np.array([value], np.int32))
        start = self._start[i]
        time = start.time + corrections.total * start.time_step
        self._start[i] = start.replace(step=start.step + corrections.total, time=time)

    def run(self) -> None:
        """Advance all states until one has no steps left, or fails."""
        before = self.going
        while (self.going == before).all() and before.any():
            self.launch()
            self.look()

    def launch(self) -> None:
        """Launch the kernels of some steps of the states with unfinished steps, without waiting for them.

        Each group of steps follows a correction of the velocity gradients. The other states stay as they are until
        `look`.
        """
        k, s, g, going = self._kernels, self._states, self._grains, self.going
        self._stresses = None
        interval, controlled = int(self._interval[going].min()), bool(self._controlled[going].any())
        of_states, of_grains = (-(-len(self) // SLICE), SLICE, self._stream), (self._blocks, BLOCK, self._stream)
        for _ in range(min(-(-int(self._left.max()) // interval), max(1, CHUNK // interval))):
            if controlled:
                self._sum_stresses(every=0)
            k.correct[of_states](s, self._plans, self._totals)
            for _ in range(min(interval, CHUNK)):
                k.start_step[of_states](s)
                k.move[of_grains](s, g)
                k.forces[of_grains](s, g, self._lists, 1.0)

    def look(self) -> None:
        """Wait for the steps, make the searches that are due, and find out which states have steps left."""
        self._stresses = None
        due = self._states.due.copy_to_host() == 1
        if due.any():
            self._search(due)
        self._left = self._states.left.copy_to_host()

    def _sum_stresses(self, every: int) -> None:
        """Sum branch (x) force of all states (every = 1), or of those whose servo needs it (0)."""
        k, s = self._kernels, self._states
        of_grains, of_states = (self._blocks, BLOCK, self._stream), (len(self), BLOCK, self._stream)
        k.stress_of_blocks[of_grains](s, self._grains, self._lists, self._plans, self._sums, every)
        k.stress_of_states[of_states](s, self._plans, self._sums, self._totals, every)

    def stress(self) -> np.ndarray:
        """Love's stress of each state, (n, 3, 3), Pa, compression positive; computed once per instant."""
        if self._stresses is None:
            self._sum_stresses(every=1)
            volume = np.linalg.det(self._states.cell.copy_to_host())
            self._stresses = -self._totals.copy_to_host().reshape(-1, 3, 3) / volume[:, None, None]
        return self._stresses.copy()

    def state(self, i: int) -> State:
        """A copy of the i-th State, with contacts sorted by grain and the ledger up to date.

        Raises PhysicsError if the state has failed or contains NaN.
        """
        return self.take(i)[1]()

    def take(self, i: int) -> tuple[State, Callable[[], State]]:
        """Copy the i-th State, which must have no unfinished steps, from the device; other states may be advancing.

        Returns the State without the arrays IN_ENGINE and with its former ledger, and a function that completes it.
        """
        g, s, first, count = self._grains, self._states, int(self._first[i]), int(self._count[i])
        of_state = {"cell": [s.cell[i]], "velocity_gradient": [s.used[i]]}
        of_grains = {"position": g.position, "velocity": g.velocity, "spin": g.spin, "energies": g.energies}
        columns = {name: rows_of(array, first, count) for name, array in of_grains.items()}
        side, lists = int(self._side[i]), self._lists
        at, room = int(self._region[side, i]), int(self._room[i])
        of_lists = {
            "count": rows_of(lists.count[side], first, count),
            "slice_first": rows_of(lists.slice_first[side], first // SLICE, -(-count // SLICE)),
            **{name: rows_of(getattr(lists, name), at, room) for name in ("partner", "shift", "history")},
        }
        arrays = self._reader.read(of_state | columns | of_lists)
        brief = self._start[i].replace(
            cell=arrays["cell"][0],
            velocity_gradient=arrays["velocity_gradient"][0],
            engine="cuda",
            engine_version=labkit.__version__,
            precision=self._precision,
        )
        return brief, functools.partial(state_from_lists, brief, self._order[i], first, arrays)

    def _put(self, i: int, state: State) -> None:
        """Copy a State to the device, without its neighbour list. Raises InputError if its law differs."""
        scene = state.scene
        if not self.takes(i, state):
            raise InputError(
                f"the contact law of state {i}, or its features such as friction or rolling resistance, differ from "
                "those of the batch: give states with the same law and features"
            )
        skin, diameter = SKIN * 2.0 * state.radius.mean(), 2.0 * state.radius.max()
        order = sort_grains(state.position, state.cell, diameter + skin).order
        self._order[i], self._start[i] = order, state.replace(**dict.fromkeys(IN_ENGINE))
        radius, first, g, s = state.radius[order], int(self._first[i]), self._grains, self._states
        put(g.number, first, order)
        put(g.radius, first, radius)
        put(g.inverse_mass, first, 1.0 / scene.mass(radius))
        put(g.inverse_inertia, first, 1.0 / scene.moment_of_inertia(radius))
        put(g.position, first, state.position[order].T)
        put(g.velocity, first, state.velocity[order].T)
        put(g.spin, first, state.angular_velocity[order].T)
        put(g.energies, first, np.zeros((ENERGIES, len(order))))
        before, dt = state.velocity_gradient, state.time_step
        drift = before @ np.linalg.solve(np.eye(3) + dt * before, state.cell)
        rows = (
            (s.time_step, dt),
            (s.skin, skin),
            (s.diameter, diameter),
            (s.law, row_of(scene)),
            (s.factor, scene.contact_law.normal.factor(scene)),
            (s.disc, 0.5 * scene.mean_diameter if scene.planar else 0.0),
            (s.due, 0),
            (s.left, 0),
        )
        for array, value in (*rows, (s.cell, state.cell), (s.used, before), (s.drift, drift)):
            array[i : i + 1].copy_to_device(np.ascontiguousarray(np.asarray(value, array.dtype)[None]))
        self._put_contacts(i, state)

    def _put_contacts(self, i: int, state: State) -> None:
        """Copy the contacts of a State to the device, as the list from which the first search copies their history."""
        first, arrays = int(self._first[i]), lists_of(state, self._order[i], int(self._first[i]))
        self._grow(np.where(np.arange(len(self)) == i, arrays["partner"].shape[1], 0))
        at = int(self._region[self._side[i], i])
        put(self._lists.count[self._side[i]], first, arrays["count"])
        put(self._lists.slice_first[self._side[i]], first // SLICE, arrays["slice_first"])
        put(self._lists.partner, at, arrays["partner"][0])
        put(self._lists.shift, at, arrays["shift"])
        put(self._lists.history, at, arrays["history"])

    def _grow(self, needed: np.ndarray) -> None:
        """Give each state room for the number of entries that it needs, (n,)."""
        needed = np.maximum(needed, 1)  # an array on the device cannot be empty
        small = needed > self._room
        if not small.any():
            return
        room = np.where(small, -(-(SPARE * needed).astype(int) // SLICE) * SLICE, self._room)
        first = np.cumsum(room) - room
        region = np.stack([first, first + room.sum()])
        for name in ("partner", "shift", "stiffness", "history"):
            old = getattr(self._lists, name).copy_to_host()
            self._lists = self._lists._replace(**{name: self._lists.side})  # frees the memory on the device
            new = np.zeros((*old.shape[:-1], 2 * int(room.sum()) + 1), old.dtype)
            for i in range(len(self)):
                source, target = self._region[self._side[i], i], region[self._side[i], i]
                new[..., target : target + self._room[i]] = old[..., source : source + self._room[i]]
            self._lists = self._lists._replace(**{name: cuda.to_device(new)})
        self._lists = self._lists._replace(region=cuda.to_device(region))
        self._region, self._room = region, room

    def _search(self, which: np.ndarray, moving: float = 1.0) -> None:
        """Find the neighbours of the states `which` (n,), and compute their forces; `moving` as in contacts.forces."""
        k, s, g, grid = self._kernels, self._states, self._grains, self._grid
        cell = s.cell.copy_to_host()
        which = which & self._set_grid(which, cell)
        of_states, of_grains = (len(self), BLOCK, self._stream), (self._blocks, BLOCK, self._stream)
        k.clear[of_states](grid)
        k.find_cells[of_grains](s, g, grid)
        k.offsets[of_states](grid)
        k.sort[of_grains](s, g, grid)
        k.count_neighbours[of_grains](s, g, self._lists, grid)
        k.arrange[of_states](s, self._lists, grid)
        lost = grid.lost.copy_to_host() == 1
        self._grow(np.where(which, grid.needed.copy_to_host(), 0))
        k.fill[of_grains](s, g, self._lists, grid)
        self._side = np.where(which, 1 - self._side, self._side).astype(np.int32)
        self._lists.side.copy_to_device(self._side)
        first_cell = s.first_cell.copy_to_host()
        first_cell[which] = cell[which]
        s.first_cell.copy_to_device(first_cell)
        self._fail(which & lost)
        s.due.copy_to_device(np.where(which, 0, s.due.copy_to_host()).astype(np.int32))
        s.running.copy_to_device((which & ~lost).astype(np.int32))
        k.forces[of_grains](s, g, self._lists, moving)
        self._stream.synchronize()  # needed before another stream copies the state

    def _set_grid(self, which: np.ndarray, cell: np.ndarray) -> np.ndarray:
        """Define the grids of the states `which` (n,) with cells (n, 3, 3); return which of them have a valid cell."""
        shape, span, inverse = np.ones((len(self), 3), int), np.ones((len(self), 3), int), np.zeros((len(self), 3, 3))
        sound = which & (np.nan_to_num(np.linalg.det(np.nan_to_num(cell))) > 0.0) & np.isfinite(cell).all(axis=(1, 2))
        reach = self._states.diameter.copy_to_host() + self._states.skin.copy_to_host()
        for i in np.flatnonzero(sound):
            shape[i], span[i] = grid_shape(cell[i], reach[i], int(self._count[i]))
            inverse[i] = np.linalg.inv(cell[i])
        self._fail(which & ~sound)
        grid = self._grid
        grid.searching.copy_to_device(sound.astype(np.int32))
        grid.shape.copy_to_device(shape.astype(np.int32))
        grid.span.copy_to_device(span.astype(np.int32))
        grid.inverse.copy_to_device(inverse)
        grid.lost.copy_to_device(np.zeros(len(self), np.int32))
        return sound

    def _fail(self, which: np.ndarray) -> None:
        """Stop the states `which` (n,), which have lost a grain."""
        if not which.any():
            return
        for i in np.flatnonzero(which):
            self.failures[i], self._left[i] = LOST, 0
        for array in (self._states.left, self._states.due):
            array.copy_to_device(np.where(which, 0, array.copy_to_host()).astype(np.int32))
