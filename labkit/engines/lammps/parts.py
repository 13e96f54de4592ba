"""The grains and contacts that one rank owns, as arrays, and the State that all parts make."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from labkit.grains.laws.named import SpringDashpot

if TYPE_CHECKING:
    from labkit.engines.lammps.domain import Domain


@dataclasses.dataclass(frozen=True)
class Part:
    """Grains of one rank, and contacts, each of which exactly one rank has. SI units.

    number (g,): of the grains, from 0; position, velocity, angular_velocity (g, 3);
    pair (c, 2): numbers of the two grains; branch (c, 3): from the first to the second grain;
    tangential_force, rolling_moment (c, 3): of the springs, on the first grain.
    """

    number: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    pair: np.ndarray
    branch: np.ndarray
    tangential_force: np.ndarray
    rolling_moment: np.ndarray

    @classmethod
    def of(cls, domain: Domain) -> Part:
        """The part of this rank, while its velocities are those of half a step earlier."""
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
        moment = np.cross(-branch / length[:, None], reduced[:, None] * local[:, 6:])
        swapped = (number[:, 0] > number[:, 1])[:, None]
        sign = np.where(swapped, -1.0, 1.0)
        if not scene.friction:
            tangential = np.zeros_like(tangential)
        return cls(
            ids[:n],
            grains["x"][:n].copy(),
            grains["v"][:n].copy(),
            grains["omega"][:n].copy(),
            np.sort(number, axis=1),
            sign * branch,
            sign * tangential,
            sign * moment,
        )


def _rows(values: np.ndarray | None, columns: int) -> np.ndarray:
    """A copy of what a local compute returns, (c, columns); nothing without contacts."""
    return np.zeros((0, columns)) if values is None else np.array(values).reshape(-1, columns)


def _slip(
    domain: Domain,
    grains: dict[str, np.ndarray],
    first: np.ndarray,
    second: np.ndarray,
    branch: np.ndarray,
    radii: np.ndarray,
) -> np.ndarray:
    """Velocity of the first grain relative to the second at the contact, as LAMMPS defines it, (c, 3), m/s."""
    x, v, w = grains["x"], grains["v"], grains["omega"]
    H = domain.cell
    shift = np.round(np.linalg.solve(H, (x[first] + branch - x[second]).T).T)
    relative = v[first] - v[second] - shift @ domain.rate.T
    length = np.sqrt(np.einsum("ci,ci->c", branch, branch))
    n = -branch / length[:, None]  # LAMMPS's, from the second grain to the first
    relative -= np.einsum("ci,ci->c", relative, n)[:, None] * n
    turning = radii[:, :1] * w[first] + radii[:, 1:] * w[second]
    return relative - np.cross(turning, n)


def gathered(parts: list[Part], cell: np.ndarray) -> dict[str, Any]:
    """The arrays of a State from all parts; cell (3, 3), m."""
    values = {field.name: np.concatenate([getattr(p, field.name) for p in parts]) for field in dataclasses.fields(Part)}
    order = np.argsort(values["number"])
    position = values["position"][order]
    pair, branch = values["pair"], values["branch"]
    by_pair = np.lexsort((pair[:, 1], pair[:, 0]))
    pair, branch = pair[by_pair], branch[by_pair]
    offset = position[pair[:, 0]] + branch - position[pair[:, 1]]
    return {
        "position": position,
        "velocity": values["velocity"][order],
        "angular_velocity": values["angular_velocity"][order],
        "contact_grain": pair.astype(np.int32),
        "contact_shift": np.round(np.linalg.solve(cell, offset.T).T).astype(np.int32),
        "tangential_force": values["tangential_force"][by_pair],
        "rolling_moment": values["rolling_moment"][by_pair],
    }
