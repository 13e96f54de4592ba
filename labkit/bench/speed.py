"""Speed of an engine on a CV scene, and what a record and the servo cost it; run by `labkit bench` in processes of
its own: yade_scripts/speed.py inside YADE, `python -m labkit.bench.speed STATE STEPS THREADS` for the engine fused."""

from __future__ import annotations

import sys
import time

from labkit.engines import start_engine
from labkit.dem.measure import measure
from labkit.dem.paths import ConstantVolume
from labkit.dem.servo import velocity_gradient
from labkit.dem.state import read_state


def print_speed(engine, file, steps, threads):
    """Prints steps per second, and how many steps a stress and a record take."""
    state = read_state(file)
    gradient = velocity_gradient(ConstantVolume(), 1.0, state.time_step)
    machine = start_engine(engine, state, threads)
    machine.advance(max(1, steps // 5), gradient)
    rate = steps / _seconds(lambda: machine.advance(steps, gradient))
    print("steps_per_second", rate)
    stress = [lambda: machine.advance(0, gradient), machine.stress]  # YADE sums when it stops, fused when asked
    _seconds(stress[1])
    print("steps_per_stress", rate * _seconds(lambda: [f() for _ in range(20) for f in stress]) / 20)
    print("steps_per_record", rate * _seconds(lambda: [measure(machine.state(), state.cell) for _ in range(3)]) / 3)


def _seconds(work):
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


if __name__ == "__main__":
    print_speed("fused", sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
