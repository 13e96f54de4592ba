"""Registers constitutive laws by other authors: `labkit model cp --model sanisand --use analysis/peers/laws.py`."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2]))  # the clone, which contains the package `analysis`

from analysis.peers.acst import AnisotropicCriticalState
from analysis.peers.hypoplasticity import Hypoplasticity
from analysis.peers.norsand import NorSand
from analysis.peers.sanisand import Sanisand
from labkit.model import MODELS, RateLaw

PEERS: tuple[type[RateLaw], ...] = (Hypoplasticity, Sanisand, NorSand, AnisotropicCriticalState)
for law in PEERS:
    MODELS.register(law)
