"""The main job in small: a specimen, a CV test on YADE, SFF against Love."""

from __future__ import annotations

import shlex

from labkit.errors import InputError

GRAINS = 4000  # C0 leans on averages over grains: with 1,500 its sampling error alone reaches 3 %
VOID_RATIO = 0.67
STRAIN = 0.1
RECORD_STRAIN = 2e-3
RATE = 20.0  # 1/s: twice the paper's, the inertial number stays below 3e-4 at this pressure


def demo(folder, labkit):
    """Makes specimen, run and verification in `folder`; `labkit(words)` runs a command line, returns its code."""
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be made ({error.strerror}): give another -o") from None
    state, run, figure = (folder / name for name in ("demo.state.nc", "demo.run.nc", "demo.verify.png"))
    name = {path: shlex.quote(str(path)) for path in (state, run, figure)}
    steps = [f"verify {name[run]} -o {name[figure]}"]
    path = f"cv {name[state]} --strain {STRAIN} --rate {RATE:g} --record-strain {RECORD_STRAIN}"
    steps.insert(0, f"run {path} --threads 2 -o {name[run]}")
    if not state.exists():
        steps.insert(0, f"specimen --void-ratio {VOID_RATIO} --grains {GRAINS} --threads 2 -o {name[state]}")
    for words in steps:
        print(f"$ labkit {words}", flush=True)
        code = labkit(words)
        if code:
            return code
    print(f"results: {state} (specimen), {run} (records and contacts), {figure}")
    return 0
