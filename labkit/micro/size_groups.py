"""Stresses of grain-size groups (Eqs. 13-18); their weighted sum is Love's stress for any partition of the grains."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.errors import InputError
from labkit.micro.snapshot import Snapshot, contact_dyads
from labkit.micro.void_ratio import grain_volume
from labkit.parameters import Parameter

GROUPS = Parameter("groups", low=1, high=1000, kind=int)


@dataclasses.dataclass(frozen=True, eq=False)
class GroupStresses:
    """Stresses and weights of K groups of grains. The stresses of a group without contacts are NaN (undefined).

    Args:
        grains: N_g(k), (K,).
        contacts: N_c(k), contact sides, (K,).
        by_contacts: N_c(k)/N_c, the weights of Eq. 15, (K,).
        coordination_ratio: Z(k)/Z, (K,); multiplied by volume_fraction, it is the weight of Eq. 17.
        volume_fraction: V_g(k)/V_g, (K,).
        per_contact: sigma^N(k) of Eq. 15, (K, 3, 3), in Pa.
        per_volume: sigma^V(k) of Eq. 17, (K, 3, 3), in Pa.
    """

    grains: np.ndarray
    contacts: np.ndarray
    by_contacts: np.ndarray
    coordination_ratio: np.ndarray
    volume_fraction: np.ndarray
    per_contact: np.ndarray
    per_volume: np.ndarray

    @property
    def by_volume(self) -> np.ndarray:
        """Weights of Eq. 17, Z(k)/Z V_g(k)/V_g, shape (K,)."""
        return self.coordination_ratio * self.volume_fraction

    def sum_by_contacts(self) -> np.ndarray:
        """Return the sum of N_c(k)/N_c sigma^N(k) (Eq. 15), shape (3, 3), in Pa."""
        return _weighted_sum(self.by_contacts, self.per_contact)

    def sum_by_volume(self) -> np.ndarray:
        """Return the sum of Z(k)/Z V_g(k)/V_g sigma^V(k) (Eq. 17), shape (3, 3), in Pa."""
        return _weighted_sum(self.by_volume, self.per_volume)


def _weighted_sum(weights, stresses):
    """Return the weighted sum of stresses; groups of zero weight are skipped because their stress may be NaN."""
    counted = weights > 0.0
    return np.einsum("k,kij->ij", weights[counted], stresses[counted])


def diameter_edges(snapshot: Snapshot, groups: int) -> np.ndarray:
    """Return the edges of `groups` equal intervals of the grain diameter, shape (groups + 1,), in m.

    Raises InputError unless the number of groups is 1 to 1000.
    """
    groups = GROUPS.read(groups)
    low, high = 2.0 * snapshot.radius.min(), 2.0 * snapshot.radius.max()
    return np.linspace(low, high, groups + 1)


def groups_by_diameter(snapshot: Snapshot, edges: np.ndarray) -> np.ndarray:
    """Return the size group of each grain, k for edges[k] <= D < edges[k + 1], (grain,); the last interval is closed.

    Raises InputError if the edges, in m, are not ascending, or a grain lies outside them.
    """
    diameter = 2.0 * snapshot.radius
    try:
        edges = np.asarray(edges, dtype=float)
    except (TypeError, ValueError):
        edges = np.zeros(0)
    if edges.ndim != 1 or len(edges) < 2 or not (np.diff(edges) >= 0.0).all():
        raise InputError("the edges of the size groups must be ascending: give at least two diameters in m")
    if len(diameter) and (diameter.min() < edges[0] or diameter.max() > edges[-1]):
        raise InputError(
            f"some grains lie outside the size groups: cover {diameter.min():.6g} to {diameter.max():.6g} m"
        )
    return np.clip(np.searchsorted(edges, diameter, side="right") - 1, 0, len(edges) - 2)


def group_stresses(snapshot: Snapshot, group: np.ndarray, groups: int) -> GroupStresses:
    """Return the GroupStresses of any partition of the grains, by size or by another criterion.

    sigma^V(k) contains the mean grain volume V_g(k)/N_g(k) of the group instead of the pi D_k^3/6 of Eq. 18, because
    with different diameters in a group the sum of Eq. 17 would otherwise differ from Love's stress.

    Args:
        snapshot: The snapshot.
        group: Index of the group of each grain, from 0 to `groups` - 1, (grain,), int.
        groups: Number of groups.

    Raises:
        InputError: If `group` does not have such an index for each grain.
    """
    groups, group = GROUPS.read(groups), np.asarray(group)
    if not (group.shape == snapshot.radius.shape and group.dtype.kind in "iu" and np.isin(group, range(groups)).all()):
        allowed = f"a whole number from 0 to {groups - 1} for each of the {len(snapshot.radius)} grains"
        raise InputError("is not the group of each grain", field="group", allowed=allowed)
    contacts, radius, volume = snapshot.contacts, snapshot.radius, snapshot.volume
    lf = contact_dyads(snapshot).reshape(-1, 2, 9)
    side_group = group[contacts.grain]  # (n, 2)
    moment = np.stack(
        [sum(np.bincount(side_group[:, s], lf[:, s, ij], groups) for s in (0, 1)) for ij in range(9)], axis=1
    ).reshape(groups, 3, 3)
    grains = np.bincount(group, minlength=groups)
    sides = np.bincount(side_group.ravel(), minlength=groups)
    solid = np.bincount(group, 4.0 / 3.0 * np.pi * radius**3, groups)
    total = 2 * len(contacts)
    with np.errstate(divide="ignore", invalid="ignore"):
        per_contact = -(total / volume) * moment / sides[:, None, None]  # Eq. 15
        mean_volume = solid / grains
        Z = total / len(radius)
        e1 = volume / grain_volume(radius)  # 1 + e with the nominal void ratio
        per_volume = -(Z / e1) * moment / (sides * mean_volume)[:, None, None]  # Eq. 18
        coordination = np.where(grains > 0, sides / grains / Z, 0.0) if total else np.zeros(groups)
    undefined = (sides == 0)[:, None, None]
    return GroupStresses(
        grains=grains,
        contacts=sides,
        by_contacts=sides / total if total else np.zeros(groups),
        coordination_ratio=coordination,
        volume_fraction=solid / solid.sum(),
        per_contact=np.where(undefined, np.nan, per_contact),
        per_volume=np.where(undefined, np.nan, per_volume),
    )
