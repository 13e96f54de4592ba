"""Folders in which the studies of this clone keep their results."""

from __future__ import annotations

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
STUDIES = Path(__file__).resolve().parent


def results_folder(name: str = "") -> str:
    """Path of results/NAME in this clone, relative to the current folder."""
    return os.path.relpath(ROOT / "results" / name)
