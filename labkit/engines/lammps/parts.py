"""The grains and contacts that one rank owns, as arrays, and the State assembled from the parts of all ranks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from labkit.engines.sorting import sort_contacts
from labkit.grains.laws.named import SpringDashpot

if TYPE_CHECKING:
    from labkit.engines.lammps.domain import Domain

Part = dict[str, np.ndarray]  # arrays of the grains (g, ...) and contacts (c, ...) of one rank


def part_of(domain: Domain) -> Part:
    """Return the grains and contacts of this rank, in SI units; each contact is on exactly one rank.

    The arrays of grains are `number`, from 0, position, velocity and angular_velocity; those of contacts are `pair`,
    the indices of the two grains, the `branch` between them, and the tangential_force and rolling_moment that the
    springs exert on the first grain. The domain must contain the velocities half a step earlier.
    """
    lmp, n = domain.lmp, domain.lmp.extract_global("nlocal")
    grains = {name: domain.array(name) for name in ("x", "v", "omega", "radius")}
    local = _rows(lmp.numpy.extract_compute("pair", 2, 2), 9)
    number = _rows(lmp.numpy.extract_compute("grains", 2, 2), 2).astype(np.int64) - 1
    ids = domain.array("id").astype(np.int64) - 1
    order = np.argsort(ids, kind="stable")
    first, second = (order[np.searchsorted(ids[order], column)] for column in number.T)
    branch = -local[:, :3]
    radii = np.stack([grains["radius"][first], grains["radius"][second]], axis=1)
    slip = _slip(domain, grains, first, second, branch, radii)
    scene = domain.scene
    ct = SpringDashpot().tangents(scene, radii[:, 0], radii[:, 1], np.zeros(len(radii))).tangential_dashpot
    tangential = local[:, 3:6] + ct[:, None] * slip  # without the dashpot
    length = np.sqrt(np.einsum("ci,ci->c", branch, branch))
    reduced = radii.prod(axis=1) / radii.sum(axis=1)
    return {
        "number": ids[:n],
        "position": grains["x"][:n].copy(),
        "velocity": grains["v"][:n].copy(),
        "angular_velocity": grains["omega"][:n].copy(),
        "pair": number,
        "branch": branch,
        "tangential_force": tangential if scene.friction else np.zeros_like(tangential),
        "rolling_moment": np.cross(-branch / length[:, None], reduced[:, None] * local[:, 6:]),
    }


def _rows(values: np.ndarray | None, columns: int) -> np.ndarray:
    """Return a copy of the result of a local compute, (c, columns); without contacts it is empty."""
    return np.zeros((0, columns)) if values is None else np.array(values).reshape(-1, columns)


def _slip(
    domain: Domain,
    grains: dict[str, np.ndarray],
    first: np.ndarray,
    second: np.ndarray,
    branch: np.ndarray,
    radii: np.ndarray,
) -> np.ndarray:
    """Return the velocity of the first grain relative to the second at the contact as in LAMMPS, (c, 3), in m/s."""
    x, v, w = grains["x"], grains["v"], grains["omega"]
    H = domain.cell
    shift = np.round(np.linalg.solve(H, (x[first] + branch - x[second]).T).T)
    relative = v[first] - v[second] - shift @ domain.rate.T
    length = np.sqrt(np.einsum("ci,ci->c", branch, branch))
    n = -branch / length[:, None]  # normal of LAMMPS, from the second grain to the first
    relative -= np.einsum("ci,ci->c", relative, n)[:, None] * n
    turning = radii[:, :1] * w[first] + radii[:, 1:] * w[second]
    return relative - np.cross(turning, n)


def gather_parts(parts: Sequence[Part], cell: np.ndarray) -> dict[str, np.ndarray]:
    """Return the arrays of a State from all parts; cell (3, 3), in m."""
    values = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order, pair = np.argsort(values["number"]), values["pair"]
    arrays = {name: values[name][order] for name in ("position", "velocity", "angular_velocity")}
    position = arrays["position"]
    offset = position[pair[:, 0]] + values["branch"] - position[pair[:, 1]]
    shift = np.round(np.linalg.solve(cell, offset.T).T).astype(np.int32)
    arrays["contact_grain"], arrays["contact_shift"], by, sign = sort_contacts(pair, shift)
    return arrays | {name: sign * values[name][by] for name in ("tangential_force", "rolling_moment")}
