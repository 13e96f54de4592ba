"""Measures, in a separate process, the speed of an engine in a CV test and the cost of a record and of the stress.

`python -P -m labkit.engines.speed ENGINE STATE STEPS THREADS` prints one line for each quantity.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable

from labkit.engines.device import Device
from labkit.errors import PhysicsError
from labkit.grains.state import State, read_state
from labkit.paths.rates import on_grains
from labkit.paths.standard import ConstantVolume
from labkit.records.instant import Instant
from labkit.servo.plan import prescribed_gradient


def speed(engine: str, file: str | os.PathLike[str], steps: int, threads: int = 1) -> dict[str, float]:
    """Measure the quantities of `measure_speed` for an engine and the specimen of a state file, quantity -> value.

    Raises PhysicsError if the engine fails.
    """
    command = [sys.executable, "-P", "-m", "labkit.engines.speed", engine, str(file), str(steps), str(threads)]
    done = subprocess.run(command, capture_output=True, text=True)
    values = read_speeds(done.stdout)
    if done.returncode or not values:
        reason = done.stderr.strip()[-300:]
        raise PhysicsError(f"the speed measurement ended with exit status {done.returncode}: {reason}")
    return values


def read_speeds(text: str) -> dict[str, float]:
    """Read the values from the output of a measurement."""
    lines = (line.split() for line in text.splitlines() if line.startswith("steps_per_"))
    return {name: float(value) for name, value in lines}


def measure_speed(start: Device, state: State, steps: int) -> dict[str, float]:
    """Measure steps per second, and the cost of a stress evaluation and of a record in equivalent steps."""
    gradient = prescribed_gradient(on_grains(ConstantVolume(), state.scene), state.time_step)
    engine = start(state)
    engine.advance(max(1, steps // 5), gradient)
    rate = steps / _seconds(lambda: engine.advance(steps, gradient))
    stress = [
        lambda: engine.advance(0, gradient),
        engine.stress,
    ]  # YADE computes the stress when it stops, fused on demand
    _seconds(stress[1])
    record = [lambda: Instant(engine.state()).measure(state.cell)] * 3
    return {
        "steps_per_second": rate,
        "steps_per_stress": rate * _seconds(lambda: [f() for _ in range(20) for f in stress]) / 20,
        "steps_per_record": rate * _seconds(lambda: [f() for f in record]) / 3,
    }


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


if __name__ == "__main__":
    name, file, steps, threads = sys.argv[1:]
    for quantity, value in measure_speed(Device(name, int(threads)), read_state(file), int(steps)).items():
        print(quantity, value)
