"""Speed of an engine, measured in a separate process: YADE for the YADE engine, Python for the others.

`python -m labkit.engines.speed ENGINE STATE STEPS THREADS` prints the same lines as yade_scripts/speed.py inside YADE.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence

from labkit.dem.speed import measure_speed
from labkit.dem.state import read_state
from labkit.engines import ENGINES, starter
from labkit.engines.yade_process import find_script, find_yade, yade_environment
from labkit.errors import PhysicsError


def speed(engine: str, file: str | os.PathLike[str], steps: int, threads: int = 1) -> dict[str, float]:
    """Measure labkit.dem.speed's quantities for an engine on the specimen of a state file, quantity -> value.

    Raises PhysicsError if the engine fails.
    """
    kind = ENGINES.require(engine)
    if not kind.here() and kind.parallel == "threads":  # one rank of MPI needs no mpiexec
        return in_yade("speed.py", file, steps, threads)
    command = [sys.executable, "-m", "labkit.engines.speed", engine, str(file), str(steps), str(threads)]
    return _quantities(command, None)


def in_yade(script: str, file: str | os.PathLike[str], steps: int, threads: int = 1) -> dict[str, float]:
    """Run a measuring script of yade_scripts in a separate YADE process, quantity -> value. Raises PhysicsError."""
    command = [find_yade(), "-n", "-x", f"-j{threads}", str(find_script(script)), str(file), str(steps)]
    return _quantities(command, yade_environment())


def _quantities(command: Sequence[str], environment: Mapping[str, str] | None) -> dict[str, float]:
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    lines = [line.split() for line in done.stdout.splitlines() if line.startswith("steps_per_")]
    if done.returncode or not lines:
        reason = done.stderr.strip()[-300:]
        raise PhysicsError(f"the speed measurement ended with exit status {done.returncode}: {reason}")
    return {name: float(value) for name, value in lines}


def print_speed(engine: str, file: str, steps: int, threads: int) -> None:
    """Measure the speed in this process and print one line per quantity."""
    for name, value in measure_speed(starter(engine, threads), read_state(file), steps).items():
        print(name, value)


if __name__ == "__main__":
    print_speed(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
