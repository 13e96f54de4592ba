"""The constitutive laws, name -> class: labkit's model, and peers to compare it with."""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.extensions import Registry

if TYPE_CHECKING:
    from labkit.model.law import ConstitutiveLaw

MODELS: Registry[type[ConstitutiveLaw]] = Registry(
    "model",
    {
        "labkit": "labkit.model.parameters:Model",
        "hypoplasticity": "labkit.model.peers.hypoplasticity:Hypoplasticity",
        "sanisand": "labkit.model.peers.sanisand:Sanisand",
        "norsand": "labkit.model.peers.norsand:NorSand",
        "acst": "labkit.model.peers.acst:AnisotropicCriticalState",
    },
)
