"""Folders in which the studies of this clone keep their results, and readers of their YAML files."""

from __future__ import annotations

import functools
import os
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
STUDIES = Path(__file__).resolve().parent


def results_folder(name: str = "") -> str:
    """Path of results/NAME in this clone, relative to the current folder."""
    return os.path.relpath(ROOT / "results" / name)


@functools.cache
def read_yaml(file: str | Path) -> Any:
    """The contents of a YAML file."""
    return yaml.safe_load(Path(file).read_text(encoding="utf-8"))


def texts(module: str) -> dict[str, Any]:
    """The texts of a study, from `texts.yaml` next to one of its modules."""
    found: dict[str, Any] = read_yaml(Path(module).with_name("texts.yaml"))
    return found
