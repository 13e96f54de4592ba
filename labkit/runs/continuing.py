"""Going on from a state of an earlier run: the grains keep their motion, and the specimen its stress.

A State whose `step` is not zero is one of a run (`run.state`, `labkit.read_state` of a run file); `state.at_rest()`
makes it an ordinary specimen.
"""

from __future__ import annotations

import numpy as np

from labkit.grains.state import State
from labkit.micro.stress import love_stress, mean_stress
from labkit.micro.tensors import symmetric, to_six
from labkit.paths.path import Path
from labkit.paths.step import Here
from labkit.servo.reach import ERROR, errors


def goes_on(path: Path, state: State) -> bool:
    """True if a path starts from a state as it is: one of a run, with the stresses that the path holds within 2 %.

    Any other specimen is first consolidated if the path has a start pressure.
    """
    if state.step == 0:
        return False
    stress = love_stress(state.snapshot())
    held = next(iter(path.steps_from(Here(stress)))).held
    if path.start_pressure() is None:
        return True
    return held is not None and not path.phases and float(errors(held, stress, 0.0).max()) <= ERROR


def default_pressure(path: Path, state: State) -> float:
    """The pressure of a path that gives none, Pa: the mean stress of a specimen.

    For a state of a run it is the one at which the path holds the stresses as they are, on average.
    """
    stress = love_stress(state.snapshot())
    mean = float(mean_stress(stress))
    if state.step == 0 or mean <= 0.0 or path.phases:
        return mean
    held = next(iter(path.starting_at(mean).steps_from(Here(stress)))).held
    if held is None or not (loaded := held.at(0.0) != 0.0).any():
        return mean
    shares = (held.measure @ to_six(symmetric(stress)))[loaded] / held.at(0.0)[loaded]
    return mean * float(np.mean(shares))
