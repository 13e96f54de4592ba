"""Specimen and density of each test of the campaign, from the names of the runs; a specimen counts once.

Tests that start from the same packing are tests of one specimen, also after consolidation to different pressures or
with other contact laws and engines. So are those of `dense_high` and `dense`, `medium_high` and `medium`, `loose_low`
and `loose`: they have the same diameters and random starting positions, and differ by the friction in the first step of
their preparation.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

DENSITIES = ("dense", "medium", "loose")
SHARED = ("share", "full")  # tests of one specimen on several engines: share_cv-yade


def specimen_of(run: str) -> str:
    """The specimen: `dense` for `cr_1MPa-dense` and `isod-dense_high`, `medium_more-s2` for `cv-medium_more-s2`."""
    test, _, specimen = re.sub(r"(_high|_low)?( \d+)?$", "", run).partition("-")
    kind = test.partition("_")[0]
    return kind if kind in SHARED else specimen


def specimens_of(runs: Iterable[str]) -> list[str]:
    """Specimens of several runs."""
    return [specimen_of(str(run)) for run in runs]


def density_of(run: str) -> str:
    """`dense`, `medium` or `loose`; the specimen itself if it is none of them."""
    specimen = specimen_of(run)
    return next((density for density in DENSITIES if density in specimen), specimen)
