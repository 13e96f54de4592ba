"""A relaxed specimen in YADE: stress compared with getStress, and a run through a state file with an unbroken run."""

import os
import sys
import time

sys.path.append(os.path.join(sys.argv[1], "tests/engines/in_yade"))
import common
import numpy as np
from yade import utils

from labkit.dem.energy import kinetic_energy
from labkit.dem.paths import ConstantVolume
from labkit.dem.servo import velocity_gradient
from labkit.dem.state import STATE, read_state, write_state
from labkit.engines.yade import YadeEngine
from labkit.micro.stress import love_stress

specimen = read_state(common.arguments[0])
gradient = velocity_gradient(ConstantVolume(10.0), 1.0, specimen.time_step)
engine = YadeEngine(specimen)
engine.advance(2000, gradient)
half = engine.state()
ours = love_stress(half.snapshot())
result = {"love": ours.tolist(), "get_stress": np.array(utils.getStress()).reshape(3, 3).tolist()}
result["engine_stress"] = engine.stress().tolist()
result["kinetic_energy"] = kinetic_energy(half)
result["kinetic_energy_yade"] = float(utils.kineticEnergy())


def difference(a, b):
    """Largest difference of each array, divided by its largest value."""
    if len(a.contact_grain) != len(b.contact_grain):
        return {"contacts": float("inf")}
    return {
        name: float(np.abs(getattr(a, name) - getattr(b, name)).max() / max(np.abs(getattr(a, name)).max(), 1e-300))
        for name in STATE
    }


def continued(engine):
    engine.advance(100, gradient)
    return engine.state()


# an unbroken run, and a run through a file
unbroken = continued(engine)
path = common.output + ".state.nc"
write_state(path, half)
through = continued(YadeEngine(read_state(path)))
result["through_file"] = difference(unbroken, through)

# a run with a checkpoint, and the run resumed from it
engine = YadeEngine(specimen)
engine.advance(500, gradient)
checkpoint = engine.reload()
result["checkpoint"] = difference(continued(engine), continued(YadeEngine(checkpoint)))
result["repeated"] = difference(continued(YadeEngine(specimen)), continued(YadeEngine(specimen)))

# no mass scaling
result["density"] = float(O.bodies[0].state.mass / (4 / 3 * np.pi * O.bodies[0].shape.radius ** 3))
result["time_step"] = float(O.dt)
result["density_scaling"] = sorted({float(b.state.densityScaling) for b in O.bodies if b})

# cost of reading the contacts, in time steps
engine = YadeEngine(specimen)
engine.advance(200, gradient)
begin = time.perf_counter()
engine.advance(500, gradient)
per_step = (time.perf_counter() - begin) / 500
reading = []
for _ in range(7):
    begin = time.perf_counter()
    engine.state().snapshot()
    reading.append(time.perf_counter() - begin)
result["reading_in_steps"] = float(np.median(reading) / per_step)
common.write(result)
