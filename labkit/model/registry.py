"""The constitutive laws, name -> class: labkit's model, and users' laws."""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.extensions import Registry

if TYPE_CHECKING:
    from labkit.model.law import ConstitutiveLaw

MODELS: Registry[type[ConstitutiveLaw]] = Registry("model", {"labkit": "labkit.model.parameters:Model"})
