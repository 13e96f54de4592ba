"""Contact network: strong contacts, the stress of selected contact sides, and lifetimes over several snapshots."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from labkit.micro.contact_sides import normalisation
from labkit.micro.snapshot import Snapshot, contact_arms, contact_dyads
from labkit.micro.stress import stress_of_forces


def strong_by_force(snapshot: Snapshot) -> np.ndarray:
    """Mark the strong contacts by the usual definition, f_n above its mean; (n, 2) of bool, equal on both sides."""
    contacts = snapshot.contacts
    if len(contacts) == 0:
        return np.zeros((0, 2), dtype=bool)
    strong = contacts.normal_force > contacts.normal_force.mean()
    return np.stack([strong, strong], axis=1)


def strong_by_normalised_force(snapshot: Snapshot, volume: np.ndarray | None = None) -> np.ndarray:
    """Mark the strong contact sides as defined in section 3, f~_n above its mean over all sides; (n, 2) of bool.

    `volume`: see `normalisation`.
    """
    size = normalisation(snapshot, volume) * snapshot.contacts.normal_force[:, None]
    return size > size.mean() if size.size else np.zeros((0, 2), dtype=bool)


def network_stress(snapshot: Snapshot, side: np.ndarray) -> np.ndarray:
    """Return the stress of the contact sides selected by `side` (n, 2), -(1/V) sum of l (x) f (Eq. 4), (3, 3), in Pa.

    With all sides selected, this is Love's stress.
    """
    contacts = snapshot.contacts
    if contacts.vectors is not None:
        return -contact_dyads(snapshot)[side].sum(axis=0) / snapshot.volume
    arm = np.where(side, contact_arms(snapshot), 0.0).sum(axis=1)
    return stress_of_forces(arm[:, None] * contacts.normal, contacts.force_on_first(), snapshot.volume)


@dataclasses.dataclass(frozen=True, eq=False)
class Lives:
    """Lifetimes of L contacts over K snapshots.

    A contact that opens and closes again between two snapshots is treated as never opened.

    Args:
        contacts: Number of contacts in each snapshot, (K,).
        gained: Number of contacts gained since the previous snapshot, 0 in the first, (K,).
        lost: Number of contacts lost since the previous snapshot, (K,).
        kept: Number of contacts that also existed in the previous snapshot, (K,).
        pair: The two grains of each contact, (L, 2).
        birth: First snapshot with the contact, (L,).
        death: First later snapshot without the contact, (L,); K if the contact exists in the last snapshot.
    """

    contacts: np.ndarray
    gained: np.ndarray
    lost: np.ndarray
    kept: np.ndarray
    pair: np.ndarray
    birth: np.ndarray
    death: np.ndarray

    def age_sum(self, times: np.ndarray) -> np.ndarray:
        """Return the sum of the ages of all contacts in each snapshot, (K,); `times` of the snapshots, (K,)."""
        K = len(self.contacts)
        born = np.bincount(self.birth, minlength=K)[:K]
        died = np.bincount(self.death, minlength=K + 1)[:K]
        births = np.bincount(self.birth, times[self.birth], K)[:K]
        ended = np.bincount(self.death, times[self.birth], K + 1)[:K]
        return np.cumsum(born - died) * times - np.cumsum(births - ended)


def follow(pairs_of_snapshots: Iterable[np.ndarray], grains: int) -> Lives:
    """Return the Lives of the contacts in a series of snapshots.

    Only two snapshots are in memory at a time. Two contacts between the same two grains, which occur in a cell hardly
    wider than a grain, are treated as a single contact.

    Args:
        pairs_of_snapshots: Pairs of grains in contact, (n, 2), in each snapshot, in chronological order.
        grains: Number of grains.
    """
    counts, gained, lost, kept = [], [], [], []
    alive, birth = np.zeros(0, np.int64), np.zeros(0, np.int64)
    lives = []
    snapshot = -1
    for snapshot, pairs in enumerate(pairs_of_snapshots):
        pairs = np.sort(np.asarray(pairs, np.int64), axis=1)
        now = np.unique(pairs[:, 0] * grains + pairs[:, 1])
        stays = np.isin(alive, now, assume_unique=True)
        lives.append((alive[~stays], birth[~stays], np.full((~stays).sum(), snapshot)))
        born = np.full(len(now), snapshot)
        born[np.isin(now, alive, assume_unique=True)] = birth[stays]  # both are sorted
        counts.append(len(now))
        kept.append(stays.sum())
        gained.append(len(now) - stays.sum() if snapshot else 0)
        lost.append((~stays).sum())
        alive, birth = now, born
    lives.append((alive, birth, np.full(len(alive), snapshot + 1)))
    key, birth, death = (np.concatenate(column).astype(np.int64) for column in zip(*lives, strict=True))
    pair = np.stack([key // grains, key % grains], axis=1) if grains else np.zeros((0, 2), np.int64)
    per_snapshot = {"contacts": counts, "gained": gained, "lost": lost, "kept": kept}
    arrays = {name: np.array(values, dtype=np.int64) for name, values in per_snapshot.items()}
    return Lives(**arrays, pair=pair, birth=birth, death=death)
