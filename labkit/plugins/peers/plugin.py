"""The plug-in peers: registers constitutive laws by other authors."""

from __future__ import annotations

from labkit.model.registry import MODELS

MODELS.offer("hypoplasticity", "labkit.plugins.peers.hypoplasticity:Hypoplasticity")
MODELS.offer("sanisand", "labkit.plugins.peers.sanisand:Sanisand")
MODELS.offer("norsand", "labkit.plugins.peers.norsand:NorSand")
MODELS.offer("acst", "labkit.plugins.peers.acst:AnisotropicCriticalState")
