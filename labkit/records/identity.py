"""When two runs are the same: their physics is. Labels, comments, line numbers and blanks in conditions make none."""

from __future__ import annotations

import re
from collections.abc import Mapping

from labkit.errors import as_typed

TEXTS = ("until", "stop_when")  # conditions, in which blanks have no meaning
LONGEST = 60  # characters of a value in a message
MOST = 3  # differences that a message names


def physics(value: object, name: str = "") -> object:
    """Return the values of a run (JSON) without what does not change its result."""
    if isinstance(value, Mapping):
        return {key: physics(one, key) for key, one in value.items() if key != "label"}
    if isinstance(value, list | tuple):
        return [physics(one) for one in value]
    return re.sub(r"\s+", "", value) if name in TEXTS and isinstance(value, str) else value


def difference(stored: Mapping[str, object], requested: Mapping[str, object]) -> str:
    """Return how two runs differ, in words: their path, else the first few parameters; empty if they are the same."""
    kept = [name for name in {**stored, **requested} if name != "label"]
    names = [name for name in kept if physics(stored.get(name), name) != physics(requested.get(name), name)]
    names.sort(key=lambda name: name != "steps")  # from which other values follow
    names = ["path"] if "path" in names else names
    said = [_said(name, stored.get(name, "not set"), requested.get(name, "not set")) for name in names[:MOST]]
    return "; ".join([*said, *[f"{len(names) - MOST} more"] * (len(names) > MOST)])


def _said(name: str, a: object, b: object) -> str:
    """Return the difference of a parameter as text; of a list of steps, that of the first step that differs."""
    if name == "steps" and isinstance(a, list) and isinstance(b, list):
        if len(a) != len(b):
            return f"it has {len(a)} steps in the file, {len(b)} here"
        differing = ((number, difference(*pair)) for number, pair in enumerate(zip(a, b, strict=True), start=1))
        return next(f"step {number}: {text}" for number, text in differing if text)
    short = [as_typed(tuple(value) if isinstance(value, list) else value) for value in (a, b)]
    texts = short if short[0] != short[1] else [repr(a), repr(b)]
    cut = [text if len(text) <= LONGEST else f"{text[:LONGEST]}..." for text in texts]
    return f"{name} is {cut[0]} in the file, {cut[1]} here"
