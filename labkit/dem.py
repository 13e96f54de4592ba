"""Former package: see labkit.grains, paths, servo, records, specimens and others, or `labkit` itself."""

from __future__ import annotations

from labkit.former import redirect

__getattr__ = redirect(__name__, "grains", "quantities", "paths", "servo", "records", "engines", "specimens")
