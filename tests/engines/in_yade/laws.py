"""The two grains of tests/engines/two_heavy_grains.py in YADE."""

import os
import sys

sys.path.append(os.path.join(sys.argv[1], "tests/engines/in_yade"))
import common

from labkit.engines.yade import YadeEngine

sys.path.append(os.path.join(sys.argv[1], "tests/engines"))
from two_heavy_grains import measured

common.write({law: measured(YadeEngine, law) for law in common.arguments})
