"""Former package: see labkit.figures."""

from __future__ import annotations

from labkit.former import moved

__getattr__ = moved(__name__, "figures")
