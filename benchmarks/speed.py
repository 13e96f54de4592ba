"""Measures, in a separate process, the speed of an engine in a CV test and the cost of a record and of the stress.

`python -P -m benchmarks.speed ENGINE STATE STEPS THREADS` prints one line for each quantity.
"""

from __future__ import annotations

import os
import subprocess
import sys

from labkit.engines import Device
from labkit.errors import PhysicsError
from labkit.grains.state_file import read_state
from labkit.plugins.campaigns.speeds import measure_speed


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


if __name__ == "__main__":
    name, file, steps, threads = sys.argv[1:]
    for quantity, value in measure_speed(Device(name, int(threads)), read_state(file), int(steps)).items():
        print(quantity, value)
