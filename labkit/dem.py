"""Former package: see labkit.grains, paths, servo, records, specimens and others, or `labkit` itself."""

from __future__ import annotations

from labkit.former import moved

__getattr__ = moved(__name__, "grains", "quantities", "paths", "servo", "records", "engines", "specimens")
