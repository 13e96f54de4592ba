"""Two heavy grains driven through slip cycles, and light ones that collide; the same for both engines."""

import numpy as np

from labkit.grains.scene import Scene, used_parameters
from labkit.grains.state import grains_in_cell

R = 85e-6
RADIUS = np.array([1.2 * R, 0.8 * R])
NORMAL = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
TANGENT = np.array([2.0, -1.0, 0.0]) / np.sqrt(5.0)
OVERLAPS = (1e-8, 1e-7, 1e-6)  # m
CYCLED, SLIP = 3e-7, 1e-6  # m, overlap and half the range of a slip cycle
NEARLY_NONE = 1e-12  # rolling and damping: with them the kernels of an ordinary scene are used, not compiled again
STILL = np.zeros((3, 3))


def scene_of(law, **changes):
    nearly_none = dict.fromkeys(("rolling_friction", "local_damping", "beta_n", "beta_t"), NEARLY_NONE)
    return Scene(**used_parameters({**nearly_none, "law": law, **changes}))


def pair(scene, overlap, velocity=(0.0, 0.0, 0.0), time_step=1e-9):
    """The second grain moves; the first is at rest."""
    position = np.array([np.zeros(3), (RADIUS.sum() - overlap) * NORMAL])
    state = grains_in_cell(scene, RADIUS, position, np.eye(3) * 20 * R)
    return state.replace(velocity=np.array([np.zeros(3), velocity]), time_step=time_step)


def slip_cycles(engine, law, cycles=2, steps=300):
    """Energies and forces of heavy grains sliding back and forth by SLIP: (loss of the last cycle, ft of one step)."""
    scene = scene_of(law, density=1e9)
    speed = SLIP / (steps * 1e-9)
    state = pair(scene, CYCLED, speed * TANGENT)
    first = engine(state)
    first.advance(1, STILL)
    increment = np.linalg.norm(first.state().tangential_force[0]) / (speed * 1e-9)
    losses = []
    for leg in range(1 + 4 * cycles):  # SLIP forward, then twice SLIP back and forth
        sign = 1.0 if leg in (0,) or (leg - 1) // 2 % 2 else -1.0
        state = state.replace(
            velocity=np.array([np.zeros(3), sign * speed * TANGENT]), angular_velocity=np.zeros((2, 3))
        )
        run = engine(state)
        run.advance(steps, STILL)
        state = run.state()
        losses.append(state.ledger.friction_loss)
    return losses[-1] - losses[-5], increment


def collision(engine, scene, speed, steps=6000):
    """(largest overlap, restitution) of a head-on collision."""
    state = pair(scene, -1e-10, -speed * NORMAL, time_step=5e-9)
    run = engine(state)
    deepest = 0.0
    for _ in range(steps // 10):
        run.advance(10, STILL)
        x = run.state()
        gap = np.linalg.norm(x.position[1] - x.position[0])
        deepest = max(deepest, RADIUS.sum() - gap)
        if gap > RADIUS.sum() and deepest > 0.0:
            break
    return deepest, float((x.velocity[1] - x.velocity[0]) @ NORMAL) / speed


def measured(engine, law):
    """All results of one law on one engine."""
    forces = [float(engine(pair(scene_of(law), overlap)).stress() @ NORMAL @ NORMAL) for overlap in OVERLAPS]
    forces = [f * (20 * R) ** 3 / (RADIUS.sum() - overlap) for f, overlap in zip(forces, OVERLAPS, strict=True)]
    loss, increment = slip_cycles(engine, law)
    result = {"normal_force": forces, "loss": float(loss), "kt": float(increment)}
    for speed in (0.01, 0.05):
        result[f"collision_{speed}"] = collision(engine, scene_of(law), speed)
        damped = scene_of(law, beta_n=0.1)
        result[f"damped_{speed}"] = collision(engine, damped, speed)
    return result
