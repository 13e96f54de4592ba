"""Sites, one per grain or image: contacts read the motion of grains from them and add forces to them.

A site has three records: its place (position and radius), its motion (velocity, spin and radius), and its force (force
and torque).
"""

from __future__ import annotations

import numpy as np
from numpy import uint64 as uint  # an index that cannot be negative: Numba then leaves out its check

from labkit.engines.kernel.compiling import compile_and_keep, compile_callee
from labkit.engines.kernel.layout import (
    FORCE,
    LANES,
    PLACE_COLUMNS,
    SITE_COLUMNS,
    SITE_V,
    TORQUE_A,
    TORQUE_B,
    VREL,
    WA,
    WB,
    Arrays,
    D,
)
from labkit.engines.kernel.transfers import (
    add_forces,
    add_forces_and_torques,
    collect_image,
    put_image,
    read_branches,
    read_spins,
    read_velocities,
)


@compile_and_keep
def read_places(places: np.ndarray, first: np.ndarray, second: np.ndarray, work: np.ndarray) -> None:
    """Fill the rows D to SQUARES of contacts from the places of their grains."""
    for i in range(0, len(first), LANES):
        read_branches(places, first, second, i, work, D + i)


@compile_and_keep
def read_sites(
    places: np.ndarray,
    motions: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    work: np.ndarray,
    turning: bool | None,
) -> None:
    """Fill the rows D to RADIUS_B of contacts from the sites of their grains; no velocities if `turning` is None."""
    for i in range(0, len(first), LANES):
        read_branches(places, first, second, i, work, D + i)
        if turning is not None:
            read_velocities(motions, first, second, i, work, VREL + i)
        read_spins(motions, first, i, work, WA + i)
        read_spins(motions, second, i, work, WB + i)


@compile_and_keep
def add_to_sites(
    forces: np.ndarray, first: np.ndarray, second: np.ndarray, work: np.ndarray, turning: bool | None
) -> None:
    """Add forces and torques of contacts to the sites of their grains; no torques if `turning` is None."""
    for i in range(0, len(first), LANES):
        if turning is not None:
            add_forces_and_torques(forces, first, second, i, work, FORCE + i, TORQUE_A + i, TORQUE_B + i)
        else:
            add_forces(forces, first, second, i, work, FORCE + i)


@compile_callee
def first_image(sites: np.ndarray, owner: np.ndarray) -> int:
    """Index of the first image among the sites: whole blocks of grains precede the images."""
    return len(sites) - 1 - len(owner)


@compile_and_keep
def collect_images(arrays: Arrays, d: int) -> None:
    """Add the forces on the images of the domain d to the grains that they copy, and reset them."""
    images = first_image(arrays.forces, arrays.owner)
    for image in range(arrays.image_first[d], arrays.image_first[d + 1]):
        collect_image(arrays.forces, arrays.owner[uint(image)], images + image)


@compile_and_keep
def image_sites(arrays: Arrays, d: int, offset: np.ndarray, drift: np.ndarray) -> None:
    """Write the sites of the images of the domain d, which are periods away from the grains that they copy.

    Args:
        arrays: Arrays of the loop.
        d: Number of the domain.
        offset: Position that a period adds, that is, the cell, (3, 3), m.
        drift: Velocity that a period adds, that is, L times the cell before the motion, (3, 3), m/s.
    """
    places, motions = arrays.places, arrays.motions
    images = first_image(places, arrays.owner)
    vectors, drifts = np.zeros((3, PLACE_COLUMNS)), np.zeros((3, SITE_COLUMNS), motions.dtype)
    for k in range(3):
        for j in range(3):
            vectors[k, j], drifts[k, SITE_V + j] = offset[j, k], drift[j, k]
    for image in range(arrays.image_first[d], arrays.image_first[d + 1]):
        grain, site = arrays.owner[uint(image)], images + image
        put_image(places, motions, grain, site, arrays.shift, image, vectors, drifts)
