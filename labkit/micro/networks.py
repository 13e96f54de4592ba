"""Parts of the contact network: the stress of chosen contact sides, and the lives of contacts between snapshots."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from labkit.micro.snapshot import Snapshot, contact_arms


def network_stress(snapshot: Snapshot, side: np.ndarray) -> np.ndarray:
    """-(1/V) sum of l (x) f over chosen contact sides (Eq. 4), shape (3, 3), Pa. `side` (n, 2) of bool.

    All sides together give Love's stress.
    """
    contacts = snapshot.contacts
    arm = np.where(side, contact_arms(snapshot), 0.0).sum(axis=1)
    return -((arm[:, None] * contacts.normal).T @ contacts.force_on_first()) / snapshot.volume


@dataclasses.dataclass(frozen=True)
class Lives:
    """Contacts followed through K snapshots; a contact that opens and closes again between two is not seen to open.

    contacts, gained, lost, kept (K,): at each snapshot, against the one before (gained and lost are 0 at the first);
    pair (L, 2): the two grains of each of L lives; birth (L,): snapshot of its first appearance; death (L,): first
    snapshot without it, K while it lives.
    """

    contacts: np.ndarray
    gained: np.ndarray
    lost: np.ndarray
    kept: np.ndarray
    pair: np.ndarray
    birth: np.ndarray
    death: np.ndarray

    def age_sum(self, times: np.ndarray) -> np.ndarray:
        """Sum over the contacts at each snapshot of the time since their birth, shape (K,); `times` (K,)."""
        K = len(self.contacts)
        born = np.bincount(self.birth, minlength=K)[:K]
        died = np.bincount(self.death, minlength=K + 1)[:K]
        births = np.bincount(self.birth, times[self.birth], K)[:K]
        ended = np.bincount(self.death, times[self.birth], K + 1)[:K]
        return np.cumsum(born - died) * times - np.cumsum(births - ended)


def follow(pairs_of_snapshots: Iterable[np.ndarray], grains: int) -> Lives:
    """The Lives of contacts, from the pairs (n, 2) of grains of one snapshot after the other.

    Only two snapshots are held at a time. Two contacts of the same two grains, in a cell hardly wider than a grain,
    count as one. `grains`: number of grains.
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
    return Lives(*(np.array(x, dtype=np.int64) for x in (counts, gained, lost, kept)), pair, birth, death)
