"""Speed of an engine in a CV test, and the cost of writing a record and of evaluating the stress for the servo."""

from __future__ import annotations

import time
from collections.abc import Callable

from labkit.dem.engine import Start
from labkit.dem.measure import measure
from labkit.dem.paths import ConstantVolume
from labkit.dem.servo import velocity_gradient
from labkit.dem.state import State


def measure_speed(start: Start, state: State, steps: int) -> dict[str, float]:
    """Steps per second over `steps` steps, and the cost of a stress evaluation and of a record in equivalent steps."""
    gradient = velocity_gradient(ConstantVolume().for_scene(state.scene), 1.0, state.time_step)
    engine = start(state)
    engine.advance(max(1, steps // 5), gradient)
    rate = steps / _seconds(lambda: engine.advance(steps, gradient))
    stress = [
        lambda: engine.advance(0, gradient),
        engine.stress,
    ]  # YADE computes the stress when it stops, fused on demand
    _seconds(stress[1])
    return {
        "steps_per_second": rate,
        "steps_per_stress": rate * _seconds(lambda: [f() for _ in range(20) for f in stress]) / 20,
        "steps_per_record": rate * _seconds(lambda: [measure(engine.state(), state.cell) for _ in range(3)]) / 3,
    }


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
