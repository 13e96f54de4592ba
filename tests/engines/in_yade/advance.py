"""Takes a state through YADE: writes it after each of the given numbers of steps of one velocity gradient.

advance.py ROOT OUTPUT STATE STEPS,STEPS,... GRADIENT(nine numbers, comma separated)
"""

import os
import sys

sys.path.append(os.path.join(sys.argv[1], "tests/engines/in_yade"))
import common
import numpy as np

from labkit.dem.state import read_state, write_state
from labkit.engines.yade import YadeEngine

file, counts, numbers = common.words
gradient = np.array([float(x) for x in numbers.split(",")]).reshape(3, 3)
engine = YadeEngine(read_state(file))
result = {"files": [], "stress": []}
done = 0
for count in (int(x) for x in counts.split(",")):
    while done < count:  # in pieces, as a run does
        engine.advance(min(50, count - done), gradient)
        done = min(done + 50, count)
    result["files"].append(f"{common.output}.{count}.state.nc")
    write_state(result["files"][-1], engine.state())
    result["stress"].append(engine.stress().tolist())
common.write(result)
