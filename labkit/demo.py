"""The main job in small: a specimen, a CV test on YADE, SFF against Love."""

from __future__ import annotations

import shlex

from labkit.errors import InputError

GRAINS = 1600
VOID_RATIO = 0.67
STRAIN = 0.1


def demo(folder, labkit):
    """Makes specimen, run and verification in `folder`; `labkit(words)` runs a command line, returns its code."""
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be made ({error.strerror}): give another -o") from None
    state, run, figure = (folder / name for name in ("demo.state.nc", "demo.run.nc", "demo.verify.png"))
    name = {path: shlex.quote(str(path)) for path in (state, run, figure)}
    steps = [f"verify {name[run]} -o {name[figure]}"]
    steps.insert(0, f"run cv {name[state]} --strain {STRAIN} --threads 2 -o {name[run]}")
    if not state.exists():
        steps.insert(0, f"specimen --void-ratio {VOID_RATIO} --grains {GRAINS} --threads 2 -o {name[state]}")
    for words in steps:
        print(f"$ labkit {words}", flush=True)
        code = labkit(words)
        if code:
            return code
    print(f"results: {state} (specimen), {run} (records and contacts), {figure}")
    return 0
