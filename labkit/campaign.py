"""Former package: see labkit.campaigns."""

from __future__ import annotations

from labkit.former import moved

__getattr__ = moved(__name__, "campaigns")
