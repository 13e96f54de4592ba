"""Memory layout of contacts and grains.

The kernel computes with blocks of WIDTH contacts or grains. A block consists of consecutive rows of WIDTH numbers, one
quantity per row, so quantities are a constant stride apart and the compiler can vectorise a loop over a block.
Contacts access grains in no particular order. Each grain therefore has a site with three records: contacts read the
records of place and motion, and add forces to the record of force.

In mixed precision, positions, the velocities that move the grains, energies and all sums over the specimen are double.
All other numbers are single: velocities as contacts read them, spins, forces, contact history and constants, masses.

The functions of a law receive None for each feature that a scene does not use, and are compiled without this feature.
labkit/engines/host has the same numbers and structs; labkit.engines.kernel.host compares them when it loads it.
"""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np
from numpy import uint64 as uint  # an index that cannot be negative: Numba then leaves out its check

from labkit.engines.kernel.tables import PointerTable
from labkit.grains.laws.vectors import Vector

WIDTH = 64  # contacts or grains per block
LANES = 16  # contacts or grains that are transferred at once: one or two vector registers

# rows of a block of contacts: constants, then the history that the scene uses
STIFFNESS, HISTORY = (row * WIDTH for row in range(2))

# rows of a block of grains (velocity, always double) and of a block of masses
V, GRAIN_ROWS = 0, 3
INVERSE_MASS, INVERSE_INERTIA, MASS_ROWS = 0, WIDTH, 2

# columns of the records of a site: place (position and radius, always double), motion (velocity, spin and radius) and
# force (force and torque). A vector takes four columns, so it never crosses a cache line.
PLACE_RADIUS, PLACE_COLUMNS = 3, 4
SITE_V, SITE_W, SITE_RADIUS, SITE_COLUMNS = 0, 4, 7, 8
SITE_FORCE, SITE_TORQUE, FORCE_COLUMNS = 0, 4, 8

# rows for contacts in the workspace of a domain: values read from sites (in mixed precision also R^2 - d^2, with the
# sum R of the radii and the distance d), results to add to sites, energy sums
D, RADII, SQUARES = (row * WIDTH for row in (0, 3, 4))
VREL, WA, RADIUS_A, WB, RADIUS_B = (row * WIDTH for row in (5, 8, 11, 12, 15))
FORCE, TORQUE_A, TORQUE_B = (row * WIDTH for row in (16, 19, 22))
CELL_WORK, FIRST_LOSS, SUM_ROWS = 25 * WIDTH, 26 * WIDTH, 8
# rows for grains in the workspace of a domain: force and torque, spin and radius
GRAIN_FORCE, GRAIN_TORQUE, W = (row * WIDTH for row in (33, 36, 39))
WORK_ROWS = 43

# rows of the double-precision workspace of a domain: position and radius of grains, energy dissipated by damping,
# largest squared speed; in mixed precision also the totals of the SUM_ROWS rows of energy sums that start at CELL_WORK
X, DAMPING_LOSS, SPEED2, CONTACT_SUMS = (row * WIDTH for row in (0, 4, 5, 6))
DOUBLE_ROWS = 14

LAYOUT = (
    *(WIDTH, LANES, PLACE_COLUMNS, SITE_W, SITE_COLUMNS, SITE_TORQUE, FORCE_COLUMNS, GRAIN_ROWS, MASS_ROWS, D, SQUARES),
    *(VREL, WA, WB, FORCE, TORQUE_A, TORQUE_B, CELL_WORK, SUM_ROWS, GRAIN_FORCE, GRAIN_TORQUE, W, WORK_ROWS),
    *(X, SPEED2, CONTACT_SUMS, DOUBLE_ROWS),
)


class Arrays(NamedTuple):
    """Arrays of the loop over time steps.

    Args:
        grain_first: First grain of each domain, and the end, (domain + 1,).
        contact_first: First contact of each domain, (domain,).
        contact_last: Last contact of each domain, (domain,).
        places: Records of place of grains and images.
        motions: Records of motion of grains and images.
        forces: Records of force of grains and images.
        grains: Blocks of grains.
        masses: Blocks of the masses of grains.
        blocks: Blocks of contacts.
        pairs: Sites of each contact, (2, contact).
        image_first: First image of each domain, and the end, (domain + 1,).
        owner: Grain of which each image is a copy, (image,).
        shift: Periodic shift of each image, (image, 3).
        work: Workspace of each domain, (domain, ...).
        doubles: Workspace of each domain in double precision, (domain, ...).
        start: Positions at the last neighbour search, (grain, 3), in m.
    """

    grain_first: np.ndarray
    contact_first: np.ndarray
    contact_last: np.ndarray
    places: np.ndarray
    motions: np.ndarray
    forces: np.ndarray
    grains: np.ndarray
    masses: np.ndarray
    image_first: np.ndarray
    owner: np.ndarray
    shift: np.ndarray
    pairs: np.ndarray
    blocks: np.ndarray
    work: np.ndarray
    doubles: np.ndarray
    start: np.ndarray


ARRAYS = PointerTable(
    Arrays,
    sizes=("domains", "ends", "grains", "grain_blocks", "sites", "images", "slots", "blocks", "block_size"),
    grain_first=(int, "ends"),
    contact_first=(int, "domains"),
    contact_last=(int, "domains"),
    places=(float, "sites", PLACE_COLUMNS),
    motions=("real", "sites", SITE_COLUMNS),
    forces=("real", "sites", FORCE_COLUMNS),
    grains=(float, "grain_blocks", GRAIN_ROWS * WIDTH),
    masses=("real", "grain_blocks", MASS_ROWS * WIDTH),
    image_first=(int, "ends"),
    owner=(int, "images"),
    shift=(float, "images", 3),
    pairs=(np.uint32, 2, "slots"),
    blocks=("real", "blocks", "block_size"),
    work=("real", "domains", WORK_ROWS * WIDTH),
    doubles=(float, "domains", DOUBLE_ROWS * WIDTH),
    start=(float, "grains", 3),
)


POINTER, INTEGER, REAL = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double


class LoopStruct(ctypes.Structure):
    """The struct Loop in labkit/engines/host/loop.hpp."""

    _fields_ = [
        ("arrays", POINTER), ("functions", POINTER * 10), ("motion", POINTER), ("cell", POINTER), ("drift", POINTER),
        ("wanted", POINTER), ("back", POINTER), ("totals", POINTER), ("bodies", POINTER),
        ("arms", POINTER), ("numbers", POINTER), ("gradient", POINTER), ("damping", REAL), ("turning", INTEGER),
        ("radii", INTEGER), ("first", INTEGER), ("last", INTEGER), ("exchange", POINTER),
    ]  # fmt: skip


class PlanStruct(ctypes.Structure):
    """The struct Plan in labkit/engines/host/loop.hpp."""

    _fields_ = [("table", POINTER), ("steps", POINTER), ("place", POINTER), ("controlled", INTEGER)]


def offsets(struct: type[ctypes.Structure]) -> tuple[int, ...]:
    """Return the size of a struct and the offset of each member, in bytes."""
    return ctypes.sizeof(struct), *(getattr(struct, field[0]).offset for field in struct._fields_)


class _Table(ctypes.Structure):
    _fields_ = [(name, ctypes.c_uint64) for name in (*Arrays._fields, "sizes")]  # see labkit.engines.kernel.tables


COMPILED = {  # tables of the library in labkit/engines/host/levels.cpp -> what they must contain
    "compiled_layout": LAYOUT,
    "compiled_loop": offsets(LoopStruct),
    "compiled_plan": offsets(PlanStruct),
    "compiled_arrays": offsets(_Table),
}


def load(rows: np.ndarray, first: int, i: int) -> Vector:
    """Read the i-th vector from three rows, the first of which starts at `first`."""
    return Vector(rows[uint(first + i)], rows[uint(first + WIDTH + i)], rows[uint(first + 2 * WIDTH + i)])


def store(rows: np.ndarray, first: int, i: int, vector: Vector) -> None:
    """Write the i-th vector to three rows, the first of which starts at `first`."""
    rows[uint(first + i)], rows[uint(first + WIDTH + i)], rows[uint(first + 2 * WIDTH + i)] = vector
