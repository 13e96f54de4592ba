"""Advances a state in YADE with one velocity gradient and writes it after each of the given numbers of steps.

advance.py ROOT OUTPUT STATE STEPS,STEPS,... GRADIENT(nine numbers, comma separated)
"""

import os
import sys

sys.path.append(os.path.join(sys.argv[1], "tests/engines/in_yade"))
import common
import numpy as np

from labkit.dem.state import read_state, write_state
from labkit.engines.yade import YadeEngine

file, counts, numbers = common.arguments
gradient = np.array([float(x) for x in numbers.split(",")]).reshape(3, 3)
engine = YadeEngine(read_state(file))
result = {"files": [], "stress": []}
done = 0
for count in (int(x) for x in counts.split(",")):
    while done < count:  # in parts, as in a run
        engine.advance(min(50, count - done), gradient)
        done = min(done + 50, count)
    result["files"].append(f"{common.output}.{count}.state.nc")
    write_state(result["files"][-1], engine.state())
    result["stress"].append(engine.stress().tolist())
common.write(result)
