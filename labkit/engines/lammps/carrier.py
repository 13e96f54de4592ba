"""The grains of one MPI rank in LAMMPS, which divides them among the ranks. All ranks make all calls together.

LAMMPS computes no forces and moves no grains. Its box is the cell at the last neighbour search, turned so that LAMMPS
can represent it. It has three tasks, each of one command:

    change_box      moves grains to the rank that now owns their place
    run 0           copies the grains near a rank to this rank, with their positions in the State (property `place`)
    run 1 pre no    copies positions, velocities and spins of these grains again

A copy may lie in another period of the box. `_away` is the vector from the position in the State to that in LAMMPS.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from labkit.engines.followers import library
from labkit.engines.fused import Kinematics
from labkit.engines.kernel.layout import SITE_V, SITE_W
from labkit.engines.kernel.packing import PackedArrays
from labkit.errors import InputError, PhysicsError
from labkit.micro.cells import widths
from labkit.process.extras import install_command, require_library

OLDEST = 20250722  # version of LAMMPS
NEVER = 2_000_000_000  # time steps
MARGIN = 1e-9  # two ranks are sent grains this close to the face between them; LAMMPS then decides

SETTINGS = f"""\
units si
atom_style sphere
atom_modify sort 0 0.0
boundary p p p
newton off
comm_modify vel yes
box tilt large
region cell prism {{sides}} units box
create_box 1 cell
fix place all property/atom d2_place 3 ghost yes
neighbor 0.0 bin
neigh_modify every 1 delay {NEVER} check no
thermo {NEVER}
thermo_style custom step
"""


class Grains(NamedTuple):
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

    def take(self, which: np.ndarray) -> Grains:
        """Return some of the grains."""
        return Grains(*(values[which] for values in self))


def require_lammps() -> None:
    """Raise InputError if LAMMPS, mpi4py or MPI is missing."""
    library()
    require_library("lammps", "the engine lammps", "lammps")


class Carrier:
    """LAMMPS on this rank; `comm` is the mpi4py communicator of all ranks."""

    def __init__(self, comm: Any) -> None:
        """Start LAMMPS. Raises InputError if it is missing or too old."""
        lammps, install = require_library("lammps", "the engine lammps", "lammps"), install_command("lammps")
        try:
            self._lmp = lammps.lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"], comm=comm)
        except Exception as error:  # LAMMPS's Python module raises no other exceptions
            if type(error) is not Exception:
                raise
            raise InputError(f"LAMMPS cannot be started ({str(error).splitlines()[0]}): {install}") from None
        self.version = str(self._lmp.version())
        if int(self.version) < OLDEST:
            raise InputError(f"LAMMPS {self.version} is too old: {install}")
        if self._lmp.extract_setting("world_size") != comm.size:
            raise InputError(f"LAMMPS and mpi4py use different MPI libraries: {install}")

    def create_box(self, cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Replace everything by an empty cell (3, 3), m; return the ends of this rank, (3,), from 0 to 1."""
        self._turn(cell)
        self._let("clear", *SETTINGS.format(sides=" ".join(map(repr, self._sides()))).splitlines())
        return self._ends()

    def _ends(self) -> tuple[np.ndarray, np.ndarray]:
        low, high = (np.array(self._lmp.extract_global(f"sub{end}_lambda")) for end in ("lo", "hi"))
        return low, high

    def create_grains(self, grains: Grains) -> Grains:
        """Create those of the grains whose place belongs to this rank, and return them."""
        n, x = len(grains.label), self.inside(grains.position) @ self._box.T
        self._lmp.create_atoms(n, (grains.label + 1).tolist(), [1] * n, x.ravel())
        own = self._lmp.extract_global("nlocal")
        self._atoms = np.argsort(self._values("id", own), kind="stable")
        grains = grains.take(np.searchsorted(grains.label, self._values("id", own)[self._atoms] - 1))
        self._values("radius", own)[self._atoms] = grains.radius
        return grains

    def carry(self, cell: np.ndarray, reach: float, *moved: np.ndarray) -> tuple[int, Grains]:
        """Let each grain move to the rank that owns its place, and find all grains near this rank.

        Returns the number of grains of this rank, and these grains, followed by grains of other ranks.

        Args:
            cell: Cell vectors as columns, (3, 3), m.
            reach: Largest distance (m) between the centres of two grains with a contact.
            moved: Position, velocity and spin of the grains of this rank, (grain, 3).
        """
        lmp, own = self._lmp, self._lmp.extract_global("nlocal")
        self._turn(cell)
        arrays = *moved, self.inside(moved[0]) @ self._box.T
        for name, values in zip(("d2_place", "v", "omega", "x"), arrays, strict=True):
            self._values(name, own)[self._atoms] = values
        sides = "x final {} {} y final {} {} z final {} {} xy final {} xz final {} yz final {}".format(*self._sides())
        self._let(f"change_box all {sides} units box", f"comm_modify cutoff {reach:.17g}", "run 0 post no")
        own = lmp.extract_global("nlocal")
        count = own + lmp.extract_global("nghost")
        label, place = self._values("id", count).astype(np.int64) - 1, self._values("d2_place", count)
        others, first = np.unique(label[own:], return_index=True)
        self._atoms = np.argsort(label[:own], kind="stable")
        foreign = own + first[np.isin(others, label[:own], assume_unique=True, invert=True)]
        self._all = np.concatenate([self._atoms, foreign])
        self._arrays = [self._values(name, count) for name in ("x", "v", "omega")]
        x = self._arrays[0][self._all] - place[self._all] @ self._turned
        self._away = np.round(np.linalg.solve(self._box, x.T).T) @ self._box.T
        low, high = self._ends()
        inside = np.linalg.solve(self._box, self._arrays[0][self._atoms].T).T
        near = np.where(high - low < 1.0, reach * (1.0 + MARGIN) / widths(cell), 0.0)  # of other ranks
        self._sent = np.flatnonzero(((inside < low + near) | (inside > high - near)).any(axis=1))
        values = (self._values("radius", count)[self._all], place[self._all], *(v[self._all] for v in self._arrays[1:]))
        return own, Grains(label[self._all], *values)

    def refresh(self, packing: PackedArrays, cell: np.ndarray, drift: np.ndarray) -> None:
        """Copy grains of other ranks to their sites.

        Args:
            packing: Arrays of the kernel, of the grains that `carry` returned.
            cell: Cell vectors as columns, (3, 3), m.
            drift: Velocity that each period adds, (3, 3), m/s.
        """
        (x, v, w), arrays, foreign = self._arrays, packing.arrays, packing.foreign
        site, atom = packing.number[self._sent], self._all[self._sent]
        x[atom] = arrays.places[site, :3] @ self._turned + self._away[self._sent]
        v[atom], w[atom] = arrays.motions[site, SITE_V : SITE_V + 3], arrays.motions[site, SITE_W : SITE_W + 3]
        self._let("run 1 pre no post no")
        grain, sites = packing.order[foreign.grain], slice(foreign.first, foreign.first + len(foreign.grain))
        atom = self._all[grain]
        arrays.places[sites, :3] = (x[atom] - self._away[grain]) @ self._turned.T + foreign.shift @ cell.T
        arrays.motions[sites, SITE_V : SITE_V + 3] = v[atom] + foreign.shift @ drift.T
        arrays.motions[sites, SITE_W : SITE_W + 3] = w[atom]

    def _let(self, *commands: str) -> None:
        """Give commands to LAMMPS. Raises PhysicsError with its message if it fails."""
        try:
            self._lmp.commands_list(commands)
        except Exception as error:
            if type(error) is not Exception:
                raise
            raise PhysicsError(f"LAMMPS stopped: {str(error).splitlines()[0]}") from None

    def _turn(self, cell: np.ndarray) -> None:
        """Set the box, upper triangular with a positive diagonal, and the rotation from the box to the cell."""
        turned, box = np.linalg.qr(cell)
        signs = np.sign(np.diag(box))
        self._turned, self._box = turned * signs, box * signs[:, None]

    def inside(self, position: np.ndarray) -> np.ndarray:
        """Return positions (grain, 3), m, in units of the box, from 0 to 1. Raises PhysicsError if one is NaN."""
        inside = np.linalg.solve(self._box, (position @ self._turned).T).T
        if not np.isfinite(inside).all():
            raise PhysicsError("a grain is lost or its position became NaN: the time step is too large")
        return inside - np.floor(inside)

    @staticmethod
    def belongs(inside: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return a mask (grain,), True for places (grain, 3) of the rank with the ends `low` and `high`, (3,)."""
        away = (inside - 0.5 * (low + high) + 0.5) % 1.0 - 0.5
        belongs: np.ndarray = (np.abs(away) <= 0.5 * (high - low) + MARGIN).all(axis=1)
        return belongs

    def _sides(self) -> list[float]:
        """Return the ends of the box along x, y and z and its tilts, in m."""
        (x, xy, xz), (_, y, yz), (_, _, z) = self._box.tolist()
        return [0.0, x, 0.0, y, 0.0, z, xy, xz, yz]

    def _values(self, name: str, count: int) -> np.ndarray:
        """Return a quantity of the first grains of LAMMPS, (count,) or (count, 3), which it shares."""
        values: np.ndarray = self._lmp.numpy.extract_atom(name, nelem=count)
        return values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
