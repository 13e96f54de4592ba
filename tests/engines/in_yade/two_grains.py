"""Two grains in YADE: stiffness, sliding, rolling, twist and separation for one pair of radii."""

import os
import sys

sys.path.append(os.path.join(sys.argv[1], "tests/engines/in_yade"))
import common
import numpy as np

from labkit.dem.scene import Scene
from labkit.dem.state import grains_in_cell
from labkit.engines.yade import YadeEngine

DT = 1e-9
STILL = np.zeros((3, 3))
radius = np.array([float(x) for x in common.arguments])
scene = Scene(local_damping=0.0)
overlap = 0.01 * radius.sum()
normal = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
tangent = np.array([2.0, -1.0, 0.0]) / np.sqrt(5.0)
axis = np.cross(normal, tangent)
cell = np.eye(3) * 20 * radius.max()


def pair(velocity=0.0, spin=(0.0, 0.0), gap=None):
    """Two overlapping grains, of which the second moves and both may spin."""
    distance = radius.sum() - (overlap if gap is None else -gap)
    position = np.array([np.zeros(3), distance * normal])
    state = grains_in_cell(scene, radius, position, cell)
    spins = np.array([spin[0] * axis, spin[1] * axis]) if np.ndim(spin[0]) == 0 else np.array(spin)
    return state.replace(
        velocity=np.array([np.zeros(3), velocity * np.ones(3) if np.ndim(velocity) == 0 else velocity]),
        angular_velocity=spins,
        time_step=DT,
    )


def after(state, steps):
    engine = YadeEngine(state)
    engine.advance(steps, STILL)
    return engine.state()


result = {}
first = after(pair(), 0).snapshot().contacts
result["normal_force"] = float(O.interactions[0, 1].phys.normalForce.norm())
result["kn_delta"] = float(scene.normal_stiffness(*radius) * overlap)
result["normal_force_of_state"] = float(first.normal_force[0])

# one step of tangential motion: the increment of ft is kt v dt times YADE's anti-ratcheting factor
speed = 1e-3
moved = after(pair(velocity=speed * tangent), 1)
result["kt"] = float(np.linalg.norm(moved.tangential_force[0]) / (speed * DT))
result["kt_formula"] = float(scene.tangential_stiffness(*radius))
result["ratcheting_factor"] = float(radius.sum() / (radius.sum() - overlap))
# the force on the first grain points along the motion of the second
result["drag_direction"] = float(moved.tangential_force[0] @ tangent / np.linalg.norm(moved.tangential_force[0]))

# large displacement: sliding at mu fn
slid = after(pair(velocity=200.0 * tangent), 20)
contact = slid.snapshot().contacts
result["sliding"] = float(np.linalg.norm(slid.tangential_force[0]) / contact.normal_force[0])

# rolling without sliding: w1 R1 + w2 R2 = 0
spin = 1.0
rolled = after(pair(spin=(spin, -spin * radius[0] / radius[1])), 1)
bend = spin * (1.0 + radius[0] / radius[1]) * DT
result["kr"] = float(np.linalg.norm(rolled.rolling_moment[0]) / bend)
result["tangential_while_rolling"] = float(np.linalg.norm(rolled.tangential_force[0]))
result["rolling_direction"] = float(rolled.rolling_moment[0] @ axis / np.linalg.norm(rolled.rolling_moment[0]))
over = after(pair(spin=(2e6, -2e6 * radius[0] / radius[1])), 20)
result["rolling_limit"] = float(np.linalg.norm(over.rolling_moment[0]) / over.snapshot().contacts.normal_force[0])

# twist about the normal: no moment
twisted = after(pair(spin=(1e5 * normal, -1e5 * normal)), 20)
result["twist_moment"] = float(np.linalg.norm(twisted.rolling_moment[0]))
result["twist_torque"] = float(O.forces.t(0, True).norm())

# separated: no contact, no force, no tension
apart = after(pair(velocity=overlap / (10 * DT) * normal), 20)
result["contacts_apart"] = len(apart.contact_grain)
result["force_apart"] = float(np.linalg.norm(O.forces.f(0, True)))
common.write(result)
