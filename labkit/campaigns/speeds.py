"""Speed of the engines: a table of typical values, which `labkit campaign --measure` replaces by measured ones.

An engine takes a + b N seconds for a step of N grains; a and b are measured on two specimens of different size.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from labkit.engines import Device
from labkit.engines.base import Progress
from labkit.grains.scene import Scene
from labkit.grains.state import State, read_state
from labkit.paths.rates import on_grains
from labkit.paths.standard import ConstantVolume
from labkit.records.instant import Instant
from labkit.runs.run.cost import TYPICAL, Speed, supports
from labkit.runs.run.tasks import SpecimenTask, execute
from labkit.servo.plan import prescribed_gradient
from labkit.specimens.specimen import Recipe

SIZES = (150, 1000)  # grains of the two specimens


def measure_speeds(engines: Sequence[str], progress: Progress) -> dict[str, Speed]:
    """Measure speeds, engine -> Speed. Raises PhysicsError if an engine does not run."""
    speeds = {}
    with tempfile.TemporaryDirectory(prefix="labkit-") as folder:
        for number, engine in enumerate(engines):
            progress(number / len(engines), f"measuring {engine}")
            law = Scene().law if supports(engine, Scene()) else "spring_dashpot"
            speeds[engine] = _measure_speed(engine, [_specimen(grains, law, Path(folder)) for grains in SIZES])
    progress(1.0, "speeds measured")
    return speeds


def _specimen(grains: int, law: str, folder: Path) -> Path:
    """Return the state file of a specimen, which is made if it is missing."""
    file = folder / f"n{grains}-{law}.state.nc"
    if not file.exists():
        recipe = Recipe(void_ratio=0.67, grains=grains, size_classes=16)
        execute(SpecimenTask(recipe=recipe, material=Scene(law=law), output=str(file)))
    return file


def _measure_speed(engine: str, files: Sequence[Path]) -> Speed:
    """Measure an engine on specimens of SIZES."""
    steps = 3000 if engine == "fused" else 500
    first, last = (measure_speed(Device(engine), read_state(file), steps) for file in files)
    small, large = (1.0 / values["steps_per_second"] for values in (first, last))
    grain_step = max((large - small) / (SIZES[1] - SIZES[0]), 0.1 * large / SIZES[1])
    start = TYPICAL.get(engine, TYPICAL["yade"]).start
    step = max(small - grain_step * SIZES[0], 0.0)
    return Speed(start, step, grain_step, last["steps_per_record"], last["steps_per_stress"])


def measure_speed(start: Device, state: State, steps: int) -> dict[str, float]:
    """Measure steps per second, and the cost of a stress evaluation and of a record in equivalent steps."""
    gradient = prescribed_gradient(on_grains(ConstantVolume(), state.scene), state.time_step)
    engine = start(state)
    engine.advance(max(1, steps // 5), gradient)
    rate = steps / _seconds(lambda: engine.advance(steps, gradient))
    engine.stress()

    def stress() -> None:  # YADE computes the stress when it stops, fused on demand
        engine.advance(0, gradient)
        engine.stress()

    return {
        "steps_per_second": rate,
        "steps_per_stress": rate * _seconds(stress, 20),
        "steps_per_record": rate * _seconds(lambda: Instant(engine.state()).measure(state.cell), 3),
    }


def _seconds(work: Callable[[], object], times: int = 1) -> float:
    """Time that work takes, s."""
    begin = time.perf_counter()
    for _ in range(times):
        work()
    return (time.perf_counter() - begin) / times
