"""Which parameters make a run another run, and how their differences are said."""

from __future__ import annotations

from collections.abc import Mapping

from labkit.errors import as_typed

Parameters = Mapping[str, object]

CODE_OF_LAW = "code_of_law"  # setting: a hash of the code of a user-defined contact law
NAMES = ("label", "durations")  # fields of steps that only appear in messages and output
MOST_SHOWN, LONGEST = 3, 60  # differences in a message, and characters of a value


def differences(stored: Parameters, requested: Parameters) -> str:
    """Return the parameters and settings in which two runs differ, each with both values; empty if they are the same.

    The label of a step is no difference, nor is the code of a law that the file of an earlier version lacks. If the
    path differs, only the path is named.

    Args:
        stored: `path` and the attribute `path_parameters` of the run in the file.
        requested: Those of the run to be carried out.
    """
    if stored["path"] != requested["path"]:
        stored, requested = {"path": stored["path"]}, {"path": requested["path"]}
    ours, theirs = _flat(stored), _flat(requested)
    ours.setdefault(CODE_OF_LAW, theirs.get(CODE_OF_LAW))
    names = [name for name in {**ours, **theirs} if ours.get(name) != theirs.get(name)]
    said = [_said(name, ours.get(name, "not set"), theirs.get(name, "not set")) for name in names[:MOST_SHOWN]]
    return "; ".join(said) + (f"; {len(names) - MOST_SHOWN} more differ" if len(names) > MOST_SHOWN else "")


def _flat(parameters: Parameters) -> dict[str, object]:
    """Return name -> value, with the fields of each step of a path by names such as `strain of step 2`."""
    flat: dict[str, object] = {}
    for name, value in parameters.items():
        if isinstance(value, list) and value and all(isinstance(each, Mapping) for each in value):
            flat[f"number of {name}"] = len(value)
            for number, each in enumerate(value, 1):
                of_step = f"of step {number}" if name == "steps" else f"of {name} {number}"
                flat |= {f"{field} {of_step}": value for field, value in each.items() if field not in NAMES}
        else:
            flat[name] = value
    return flat


def _said(name: str, *values: object) -> str:
    """Say both values of a parameter, with all digits if the shortened values look the same."""
    short = [as_typed(tuple(value) if isinstance(value, list) else value) for value in values]
    texts = short if short[0] != short[1] else [repr(value) for value in values]
    if any(len(text) > LONGEST for text in texts):
        return f"{name} differs"
    return f"{name} is {texts[0]} in the file, {texts[1]} here"
