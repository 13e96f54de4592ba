"""Speed of labkit's YADE engine on a CV scene, and what a record costs it; run by `labkit bench`.

    yade -n -x yade_scripts/speed.py s.state.nc 500
"""

import os
import sys
import time

sys.path.append(os.environ.get("LABKIT_ROOT") or os.path.dirname(os.path.dirname(os.path.abspath(sys.argv[0]))))

from labkit.engines.yade import YadeEngine  # noqa: E402
from labkit.measure import measure  # noqa: E402
from labkit.paths import ConstantVolume  # noqa: E402
from labkit.servo import velocity_gradient  # noqa: E402
from labkit.state import read_state  # noqa: E402

state, steps = read_state(sys.argv[1]), int(sys.argv[2])
gradient = velocity_gradient(ConstantVolume(), 1.0, state.time_step)
machine = YadeEngine(state, O.numThreads)  # noqa: F821
machine.advance(max(1, steps // 5), gradient)
begin = time.perf_counter()
machine.advance(steps, gradient)
rate = steps / (time.perf_counter() - begin)
print("steps_per_second", rate)
begin = time.perf_counter()
for _ in range(20):
    machine.stress()
print("steps_per_stress", rate * (time.perf_counter() - begin) / 20)
begin = time.perf_counter()
for _ in range(3):
    measure(machine.state(), state.cell)
print("steps_per_record", rate * (time.perf_counter() - begin) / 3)
