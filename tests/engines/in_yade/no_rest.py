"""A specimen that has only 500 steps to come to rest, too few."""

import os
import sys

sys.path.append(os.path.join(sys.argv[1], "tests/engines/in_yade"))
import common

from labkit.dem.scene import Scene
from labkit.dem.specimen import Equilibrium, Recipe, insert_grains, settle
from labkit.engines.yade import YadeEngine
from labkit.errors import PhysicsError

inserted = insert_grains(Scene(), Recipe(0.67, side=1.2e-3)).replace(time_step=1e-8)
try:
    settle(YadeEngine(inserted), Equilibrium(1e-4, 1e-5, 250, 500), lambda fraction, text: None)
except PhysicsError as error:
    common.write({"message": str(error)})
