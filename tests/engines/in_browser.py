"""Takes specimens along 100 time steps, natively at the level `plain` and in a browser, for test_browser.py.

    python in_browser.py FOLDER CASE ...    # makes the specimens and writes what they become

`after(FOLDER, CASE)` returns what they become where it is called. A case is the name of a law, `clumps`, or
`frictionless`, whose scene switches parts of its law off.
"""

import dataclasses
import hashlib
import json
import os
import pickle
import sys
from pathlib import Path

import numpy as np

RATE = 20.0
INTERVALS = (5,) * 20  # steps between two corrections of the servo


def after(folder, case):
    """Return the hash of each array of the State after the steps, its stress (Pa) and its number of contacts."""
    from labkit.engines.fused import FusedEngine

    state, corrections = pickle.loads(Path(folder, f"{case}.pickle").read_bytes())
    engine = FusedEngine(state)
    engine.follow(corrections)
    end = engine.state()
    arrays = {name: hashlib.sha256(values.tobytes()).hexdigest() for name, values in end.arrays.items()}
    return {"arrays": arrays, "stress": engine.stress().tolist(), "contacts": len(end.contact_grain)}


def make(folder, case):
    """Make a specimen, and the corrections of a test at constant mean stress."""
    import labkit as lk
    from labkit.paths.step import Here
    from labkit.servo.correction import STANDARD, cell_stiffness
    from labkit.servo.plan import correcting_of, corrections_of

    scene = lk.Scene(law="rolling_resistance" if case in ("clumps", "frictionless") else case)
    shape = {"shape": "rod", "void_ratio": 0.5} if case == "clumps" else {"void_ratio": 0.6}
    state = lk.make_specimen(lk.Recipe(grains=100, seed=1, **shape), scene, progress=False)
    fraction, exponent = np.frexp(state.radius)  # NumPy's power is exact, on any computer, for radii of 16 bits
    state = state.replace(radius=np.ldexp(np.round(fraction * 2**16), exponent - 16))
    if case == "frictionless":
        state = state.replace(scene=dataclasses.replace(scene, friction=0.0, rolling_friction=0.0))
    pressure = 1.001 * float(lk.mean_stress(lk.love_stress(state.snapshot())))
    step = next(iter(lk.paths.ConstantMeanStress(strain=0.1, pressure=pressure, rate=RATE).steps_from(Here())))
    stiffness = cell_stiffness(state.snapshot(), step.held.components)
    servo = correcting_of(step, RATE, stiffness, state.time_step, STANDARD)
    accumulated = [RATE * state.time_step * sum(INTERVALS[:number]) for number in range(len(INTERVALS))]
    corrections = corrections_of(step, RATE, state.time_step, servo, INTERVALS, accumulated)
    assert corrections.plan.controlled  # the plan, which the corrections keep, is made here
    Path(folder, f"{case}.pickle").write_bytes(pickle.dumps((state, corrections)))


if __name__ == "__main__":
    os.environ |= {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    from labkit.engines.kernel import host

    host.level = lambda: "plain"
    for case in sys.argv[2:]:
        make(sys.argv[1], case)
        Path(sys.argv[1], f"{case}.json").write_text(json.dumps(after(sys.argv[1], case)))
