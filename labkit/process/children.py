"""Prevents a Python process that labkit starts from importing modules from the current folder."""

from __future__ import annotations

import os
from collections.abc import Mapping


def without_current_folder(environment: Mapping[str, str], *first: str) -> dict[str, str]:
    """Return the environment of a child process, with the folders `first` in front of the entries of PYTHONPATH.

    An empty entry, which stands for the current folder, is dropped; relative entries become absolute paths.
    """
    places = filter(None, [*first, *environment.get("PYTHONPATH", "").split(os.pathsep)])
    safe = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(map(os.path.abspath, places))}
    return {**environment, **safe}
