"""Speed of the engines: a table of typical values, which `labkit campaign --measure` replaces by measured values.

An engine takes a + b N seconds for a step of N grains; a and b are measured on two specimens of different size.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Sequence

from labkit.engines import Device
from labkit.engines.base import Progress
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.paths.rates import on_grains
from labkit.paths.standard import ConstantVolume
from labkit.records.instant import Instant
from labkit.servo.plan import prescribed_gradient
from labkit.simulation.cost import TYPICAL, Speed, supports
from labkit.simulation.tasks import SpecimenTask, execute
from labkit.specimens.recipe import Recipe

SIZES = (150, 1000)  # numbers of grains in the two specimens


def measure_speeds(engines: Sequence[str], progress: Progress) -> dict[str, Speed]:
    """Measure speeds, engine -> Speed. Raises PhysicsError if an engine does not run."""
    speeds = {}
    for number, engine in enumerate(engines):
        progress(number / len(engines), f"measuring {engine}")
        scene = Scene() if supports(engine, Scene()) else Scene(law="spring_dashpot")
        values = [
            measure_speed(Device(engine), _specimen(grains, scene), 3000 if engine == "fused" else 500)
            for grains in SIZES
        ]
        small, large = (1.0 / one["steps_per_second"] for one in values)
        grain_step = max((large - small) / (SIZES[1] - SIZES[0]), 0.1 * large / SIZES[1])
        start, step = TYPICAL.get(engine, TYPICAL["yade"]).start, max(small - grain_step * SIZES[0], 0.0)
        costs = values[1]["steps_per_record"], values[1]["steps_per_stress"]
        speeds[engine] = Speed(start, step, grain_step, *costs)
    progress(1.0, "speeds measured")
    return speeds


@functools.cache
def _specimen(grains: int, scene: Scene) -> State:
    return execute(SpecimenTask(recipe=Recipe(void_ratio=0.67, grains=grains, size_classes=16), material=scene))


def measure_speed(device: Device, state: State, steps: int) -> dict[str, float]:
    """Measure steps per second, and the cost of a stress evaluation and of a record in equivalent steps."""
    gradient = prescribed_gradient(on_grains(ConstantVolume(), state.scene), state.time_step)
    engine = device(state)
    engine.advance(max(1, steps // 5), gradient)
    rate = steps / _seconds(lambda: engine.advance(steps, gradient))
    engine.stress()

    def stress() -> None:  # YADE computes the stress when it stops, the engine fused on demand
        engine.advance(0, gradient)
        engine.stress()

    return {
        "steps_per_second": rate,
        "steps_per_stress": rate * _seconds(stress, 20),
        "steps_per_record": rate * _seconds(lambda: Instant(engine.state()).measure(state.cell), 3),
    }


def _seconds(work: Callable[[], object], times: int = 1) -> float:
    """Return the mean time that `work` takes, s."""
    begin = time.perf_counter()
    for _ in range(times):
        work()
    return (time.perf_counter() - begin) / times
