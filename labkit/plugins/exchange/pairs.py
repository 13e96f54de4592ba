"""Pairs of overlapping grains in a periodic cell, and the periodic image of a grain that is closest to another."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial import cKDTree

from labkit.errors import InputError
from labkit.micro.cells import MOST_OF_A_GRAIN, MOST_PAIRS, widths

IMAGES = np.array(list(itertools.product((-1, 0, 1), repeat=3)))


def wrapped_with_images(position: np.ndarray, cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions wrapped into the cell, and the number of cells by which each grain was moved, (n, 3) each."""
    image = np.floor(np.linalg.solve(cell, position.T).T).astype(int)
    return position - image @ cell.T, image


def overlapping_pairs(
    position: np.ndarray, radius: np.ndarray, cell: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find all pairs of grains that overlap, including periodic images: grain (n, 2), shift (n, 3) and overlap (n,).

    The first grain has the lower number, and rows are sorted. The shift, in cell vectors, is added to the position of
    the second grain as given (not wrapped). Pairs of a grain and its own image are left out, as in engines. All
    arguments have the same unit of length. Raises InputError if there are too many pairs for the memory.
    """
    wrapped, home = wrapped_with_images(position, cell)
    reach = 2.0 * radius.max(initial=0.0)
    margin = reach / widths(cell)
    fraction = np.linalg.solve(cell, wrapped.T).T
    count = np.ceil(margin).astype(int)
    shifts = np.array(list(itertools.product(*(range(-n, n + 1) for n in count))))
    owners, images = [], []
    for shift in shifts:
        moved = fraction + shift
        near = np.flatnonzero(((moved > -margin) & (moved < 1.0 + margin)).all(axis=1))
        owners.append(near)
        images.append(np.broadcast_to(shift, (len(near), 3)))
    owner, image = np.concatenate(owners), np.concatenate(images)
    points = wrapped[owner] + image @ cell.T
    tree, others = cKDTree(wrapped), cKDTree(points)
    number = int(tree.count_neighbors(others, reach)) - len(radius)
    if number > max(MOST_PAIRS, MOST_OF_A_GRAIN * len(radius)):
        raise InputError(
            f"each grain has {number / len(radius):.0f} others within the largest diameter: are the sizes "
            "diameters, not radii? is --box right?"
        )
    distances = tree.sparse_distance_matrix(others, reach, output_type="ndarray")
    first, second, distance = distances["i"], owner[distances["j"]], distances["v"]
    overlap = radius[first] + radius[second] - distance
    touching = (first < second) & (overlap > 0.0)
    first, second, overlap = first[touching], second[touching], overlap[touching]
    shift = image[distances["j"][touching]] + home[first] - home[second]
    order = np.lexsort((*shift.T[::-1], second, first))
    return np.stack([first, second], axis=1)[order].astype(np.int32), shift[order].astype(np.int32), overlap[order]


def nearest_shift(position: np.ndarray, cell: np.ndarray, grain: np.ndarray) -> np.ndarray:
    """Return the shift (n, 3), in cell vectors, that brings the second grain of each pair closest to the first.

    A shift in the file is not used, because it may refer to wrapped or to unwrapped positions. Rounding the branch
    vector in cell coordinates yields a candidate; in a tilted cell, a neighbour of the candidate may be closer.
    """
    branch = position[grain[:, 1]] - position[grain[:, 0]]
    candidate = -np.rint(np.linalg.solve(cell, branch.T).T).astype(int)
    base = branch + candidate @ cell.T
    distance = np.stack([((base + image @ cell.T) ** 2).sum(axis=1) for image in IMAGES])
    return (candidate + IMAGES[np.argmin(distance, axis=0)]).astype(np.int32)
