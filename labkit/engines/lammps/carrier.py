"""LAMMPS, which divides the grains among MPI ranks. All ranks make all calls together.

LAMMPS computes no forces and moves no grains. Its box is the cell at a neighbour search, turned so that LAMMPS can
represent it. The command `change_box` moves grains to the rank that owns their place, and `run 0` lets each rank know
the grains near it. The properties `place` and `rank` of a grain, its position in the State and its rank, go with it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from labkit.engines.kernel.specimen import Kinematics
from labkit.engines.mpi import mpi_library
from labkit.errors import InputError, PhysicsError
from labkit.process.extras import install_command, require_library

OLDEST = 20250722  # version of LAMMPS
MARGIN = 1e-9  # two ranks are sent the grains that are this close to the face between them; LAMMPS then decides

SETTINGS = """\
clear
units si
atom_style sphere
atom_modify sort 0 0.0
boundary p p p
comm_modify vel yes
box tilt large
region cell prism {sides} units box
create_box 1 cell
fix state all property/atom d2_place 3 i_rank ghost yes
neighbor 0.0 bin
thermo_style custom step
"""


class LabelledGrains(NamedTuple):
    """Grains in the order of their labels, which are their indices in the State.

    Args:
        label: Labels, (grain,).
        radius: Radii, (grain,), in m.
        position: Positions, (grain, 3), in m.
        velocity: Velocities, (grain, 3), in m/s.
        spin: Spins, (grain, 3), in 1/s.
    """

    label: np.ndarray
    radius: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray

    @property
    def kinematics(self) -> Kinematics:
        """Position, velocity and spin."""
        return self.position, self.velocity, self.spin

    def take(self, which: np.ndarray) -> LabelledGrains:
        """Return some of the grains."""
        return LabelledGrains(*(values[which] for values in self))


def require_lammps() -> None:
    """Raise InputError if LAMMPS, mpi4py or MPI is missing."""
    mpi_library()
    require_library("lammps", "the engine lammps", "lammps")


class Carrier:
    """LAMMPS on this rank; `comm` is the mpi4py communicator of all ranks."""

    def __init__(self, comm: Any) -> None:
        """Start LAMMPS. Raises InputError if it is missing, too old, or uses another MPI library than mpi4py."""
        lammps, install = require_library("lammps", "the engine lammps", "lammps"), install_command("lammps")
        try:
            self._lmp = lammps.lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"], comm=comm)
        except Exception as error:
            raise InputError(f"LAMMPS cannot be started ({str(error).splitlines()[0]}): {install}") from None
        self.version = str(self._lmp.version())
        if int(self.version) < OLDEST:
            raise InputError(f"LAMMPS {self.version} is too old: {install}")
        if self._lmp.extract_setting("world_size") != comm.size:
            raise InputError(f"LAMMPS and mpi4py use different MPI libraries: {install}")

    def create_box(self, cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Replace everything by an empty cell (3, 3), m; return the ends of this rank, (3,), from 0 to 1."""
        self._turn(cell)
        self._let(*SETTINGS.format(sides=" ".join(map(repr, self._sides()))).splitlines())
        low, high = (np.array(self._lmp.extract_global(f"sub{end}_lambda")) for end in ("lo", "hi"))
        return low, high

    def create_grains(self, grains: LabelledGrains) -> LabelledGrains:
        """Create those of the grains whose place belongs to this rank, and return them."""
        number, x = len(grains.label), self.inside(grains.position) @ self._box.T
        self._lmp.create_atoms(number, (grains.label + 1).tolist(), [1] * number, x.ravel())
        label = self._values("id", self._own())
        self._atoms = np.argsort(label, kind="stable")
        grains = grains.take(np.searchsorted(grains.label, label[self._atoms] - 1))
        self._values("radius", len(label))[self._atoms] = grains.radius
        return grains

    def carry(self, cell: np.ndarray, reach: float, *moved: np.ndarray) -> tuple[LabelledGrains, np.ndarray]:
        """Let each grain move to the rank that owns its place.

        Returns the grains of this rank and those near it, and their ranks, (grain,).

        Args:
            cell: Cell vectors as columns, (3, 3), m.
            reach: Largest distance (m) between the centres of two grains with a contact.
            moved: Position, velocity and spin of the grains of this rank, (grain, 3).
        """
        own = self._own()
        self._turn(cell)
        arrays = *moved, self.inside(moved[0]) @ self._box.T
        for name, values in zip(("d2_place", "v", "omega", "x"), arrays, strict=True):
            self._values(name, own)[self._atoms] = values
        sides = "x final {} {} y final {} {} z final {} {} xy final {} xz final {} yz final {}".format(*self._sides())
        self._let(f"change_box all {sides} units box", f"comm_modify cutoff {reach:.17g}")
        self._values("i_rank", self._own())[:] = self._lmp.extract_setting("world_rank")
        self._let("run 0 post no")
        own = self._own()
        count = own + self._lmp.extract_global("nghost")
        label, rank = (self._values(name, count) for name in ("id", "i_rank"))
        _, atoms = np.unique(label, return_index=True)  # of a grain and its copies, the grain
        self._atoms = atoms[atoms < own]
        values = (self._values(name, count)[atoms] for name in ("radius", "d2_place", "v", "omega"))
        return LabelledGrains(label.take(atoms) - 1, *values), rank.take(atoms)

    def inside(self, position: np.ndarray) -> np.ndarray:
        """Return positions (grain, 3), m, in units of the box, from 0 to 1. Raises PhysicsError if one is NaN."""
        inside = np.linalg.solve(self._box, (position @ self._turned).T).T
        if not np.isfinite(inside).all():
            raise PhysicsError("a grain is lost or its position became NaN: the time step is too large")
        return inside - np.floor(inside)

    def _own(self) -> int:
        """Return the number of grains of this rank."""
        return int(self._lmp.extract_global("nlocal"))

    def _let(self, *commands: str) -> None:
        """Give commands to LAMMPS. Raises PhysicsError with its message if it fails."""
        try:
            self._lmp.commands_list(commands)
        except Exception as error:
            raise PhysicsError(f"LAMMPS stopped: {str(error).splitlines()[0]}") from None

    def _turn(self, cell: np.ndarray) -> None:
        """Set the box, upper triangular with a positive diagonal, and the rotation from the box to the cell."""
        turned, box = np.linalg.qr(cell)
        signs = np.sign(np.diag(box))
        self._turned, self._box = turned * signs, box * signs[:, None]

    def _sides(self) -> list[float]:
        """Return the ends of the box along x, y and z and its tilts, in m."""
        (x, xy, xz), (_, y, yz), (_, _, z) = self._box.tolist()
        return [0.0, x, 0.0, y, 0.0, z, xy, xz, yz]

    def _values(self, name: str, count: int) -> np.ndarray:
        """Return a quantity of the first grains of LAMMPS, (count,) or (count, 3), which it shares."""
        values: np.ndarray = self._lmp.numpy.extract_atom(name, nelem=count)
        return values


def belongs(inside: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return a mask (grain,), True for the places (grain, 3), from 0 to 1, of the rank from `low` to `high`, (3,)."""
    away = (inside - 0.5 * (low + high) + 0.5) % 1.0 - 0.5
    mask: np.ndarray = (np.abs(away) <= 0.5 * (high - low) + MARGIN).all(axis=1)
    return mask
