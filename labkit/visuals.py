"""Former package: see labkit.figures."""

from __future__ import annotations

from labkit.former import redirect

__getattr__ = redirect(__name__, "figures")
