"""Keeps a Python that labkit starts from importing modules of the folder in which it starts."""

from __future__ import annotations

import os
from collections.abc import Mapping


def without_current_folder(environment: Mapping[str, str], *first: str) -> dict[str, str]:
    """Return the variables for a child process, with the folders `first` before those of PYTHONPATH.

    An empty entry of PYTHONPATH stands for the current folder, and a relative one for another folder elsewhere.
    """
    places = filter(None, [*first, *environment.get("PYTHONPATH", "").split(os.pathsep)])
    own = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(map(os.path.abspath, places))}
    return {**environment, **own}
