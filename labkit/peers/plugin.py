"""The plug-in peers: registers constitutive laws by other authors."""

from __future__ import annotations

from labkit.model.registry import MODELS

MODELS.offer("hypoplasticity", "labkit.peers.hypoplasticity:Hypoplasticity")
MODELS.offer("sanisand", "labkit.peers.sanisand:Sanisand")
MODELS.offer("norsand", "labkit.peers.norsand:NorSand")
MODELS.offer("acst", "labkit.peers.acst:AnisotropicCriticalState")
