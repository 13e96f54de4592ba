"""Measures, in a separate process, the speed of an engine in a CV test and the cost of a record and of the stress.

`python -P -m benchmarks.speed ENGINE STATE STEPS THREADS` prints one line for each quantity.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable

from labkit.engines import Device
from labkit.errors import PhysicsError
from labkit.grains.state import State
from labkit.grains.state_file import read_state
from labkit.paths.rates import on_grains
from labkit.paths.standard import ConstantVolume
from labkit.records.instant import Instant
from labkit.servo.plan import prescribed_gradient


def speed(engine: str, file: str | os.PathLike[str], steps: int, threads: int = 1) -> dict[str, float]:
    """Measure the quantities of `measure_speed` for an engine and the specimen of a state file, quantity -> value.

    Raises PhysicsError if the engine fails.
    """
    command = [sys.executable, "-P", "-m", "benchmarks.speed", engine, str(file), str(steps), str(threads)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    values = read_speeds(done.stdout)
    if done.returncode or not values:
        reason = done.stderr.strip()[-300:]
        raise PhysicsError(f"the speed measurement ended with exit status {done.returncode}: {reason}")
    return values


def read_speeds(text: str) -> dict[str, float]:
    """Read the values from the output of a measurement."""
    lines = (line.split() for line in text.splitlines() if line.startswith("steps_per_"))
    return {name: float(value) for name, value in lines}


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


if __name__ == "__main__":
    name, file, steps, threads = sys.argv[1:]
    for quantity, value in measure_speed(Device(name, int(threads)), read_state(file), int(steps)).items():
        print(quantity, value)
