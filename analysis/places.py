"""Where the studies of this clone keep what they find."""

from __future__ import annotations

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
STUDIES = Path(__file__).resolve().parent


def results_folder(name: str = "") -> str:
    """The folder results/NAME of this clone, relative to the current folder."""
    return os.path.relpath(ROOT / "results" / name)
