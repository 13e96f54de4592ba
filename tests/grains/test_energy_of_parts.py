"""Two grains in plain Python: all combinations of parts store or lose the work done on them.

Left out: dashpots, whose force is a velocity times a stiffness and whose work is counted to first order in the time
step (tests/engines/test_law_parts.py), and YADE's factor against ratcheting, whose work is not mechanical.
"""

import itertools

import numpy as np
import pytest

from labkit.grains.columns import history_fields
from labkit.grains.laws import (
    LAWS,
    Adhesion,
    Bridge,
    Contact,
    ContactLaw,
    Coulomb,
    HertzSpring,
    LinearSpring,
    Midpoint,
    Mindlin,
    Neck,
    ParallelBond,
    RescaledMindlin,
    Rolling,
    RollingOfYade,
    Twisting,
    TwistingOfYade,
    Vector,
)  # fmt: skip
from labkit.grains.laws.vectors import ZERO
from labkit.grains.registration import register_law
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell

pytestmark = pytest.mark.slow

A, B = 9e-5, 8e-5  # radii, m
SPRINGS = [(LinearSpring, Coulomb), (HertzSpring, Mindlin), (HertzSpring, RescaledMindlin)]
COHESION = [None, Adhesion, Bridge, Neck]
ROLLING, TWISTING = [None, Rolling, RollingOfYade], [None, Twisting, TwistingOfYade]
BOND = [(None, 0.4), (ParallelBond, 0.4), (None, 0.0)]  # with friction


def scene_of(kinds, friction):
    name = "_".join(kind.__name__ for kind in kinds).lower()
    if name not in LAWS:
        parts = sum((kind() for kind in kinds[1:]), kinds[0]())
        register_law(type(name, (ContactLaw,), {"name": name, "parts": parts, "kinematics": Midpoint}))
    given = {"young_modulus": 5e9 if HertzSpring in kinds else 0.15e9, "friction": friction}
    given |= {"twisting_friction": 0.15} if {Twisting, TwistingOfYade} & set(kinds) else {}
    given |= {"adhesion_energy": 10.0} if {Adhesion, Neck} & set(kinds) else {}
    given |= {"surface_tension": 2.0, "bridge_volume": 1e-7} if Bridge in kinds else {}
    given |= {"bond_modulus": 1e8, "bond_strength": 1e9, "bond_shear_strength": 1e9} if ParallelBond in kinds else {}
    return Scene(law=name, **given)


def stored(scene, branch, history):
    """Energy of the contact, J, by the function that the energy balance of a specimen uses."""
    state = grains_in_cell(scene, np.array([A, B]), np.array([[5e-4] * 3, 5e-4 + branch]), 1e-3 * np.eye(3))
    known = {name: np.array([value]) for name, value in history._asdict().items()}
    pair = {"contact_grain": np.array([[0, 1]], np.int32), "contact_shift": np.zeros((1, 3), np.int32)}
    return scene.contact_law.elastic_energy(
        state.replace(**pair, **history_fields(scene.contact_law.columns, known, 1)).snapshot()
    )


def error(scene, steps):
    """Work minus losses minus stored energy, over the work, in two oscillations that part grains and break bridges."""
    law, dt = scene.contact_law, 1e-4 / steps
    composition, numbers = law.composition(scene), law.numbers(scene)
    phase = (np.arange(steps) + 0.5) * 4.0 * np.pi / steps
    motion = np.stack([3.0 * np.cos(phase), -2.0 * np.sin(phase), 0.7 * np.cos(2.0 * phase)], axis=1) * 4.0 * np.pi
    velocities, spin_a, spin_b = (
        3e-7 / 1e-4 * motion,
        2e-3 / 1e-4 * motion[:, [2, 0, 1]],
        3e-3 / 1e-4 * motion[:, [1, 2, 0]],
    )
    coefficient = float(law.normal_stiffness(scene, np.array(A), np.array(B)))
    branch = np.array([A + B - 3e-7, 0.0, 0.0])
    known = {"joined": 1.0, "bond_length": branch[0]}
    history = composition.make_history(*(known.get(name, ZERO) for name in composition.columns))
    energy, work, losses, total, last = stored(scene, branch, history), 0.0, 0.0, 0.0, None
    for k in range(steps):
        v, a, b = velocities[k], spin_a[k], spin_b[k]
        branch = branch + dt * v
        d = float(np.linalg.norm(branch))
        vectors = (Vector(*x.tolist()) for x in (branch, branch / d, v, a, b))
        contact = Contact(coefficient, A, B, A + B - d, 1.0 / d, *vectors)
        r = composition.pair(contact, history, numbers, dt)
        history = r.history
        now = [np.array(x) for x in (r.force, r.torque_a, r.torque_b)]
        force, torque_a, torque_b = [0.5 * (x + y) for x, y in zip(now, last or now, strict=True)]
        last, done = now, dt * (force @ v - torque_a @ a - torque_b @ b)
        work, total = work + done, total + abs(done)
        losses += sum(r.losses)
    return (work - losses - stored(scene, branch, history) + energy) / total


PAIRS = [  # JKR's neck is one of Hertz's contact
    pair for pair in itertools.product(SPRINGS, COHESION) if pair[1] is not Neck or HertzSpring in pair[0]
]


@pytest.mark.parametrize(("springs", "cohesion"), PAIRS)
def test_all_work_is_stored_or_lost(springs, cohesion):
    """The error is proportional to the time step, as a force jumps within a step; extrapolated to none it is 0."""
    for rolling, twisting, (bond, friction) in itertools.product(ROLLING, TWISTING, BOND):
        kinds = [kind for kind in (*springs, cohesion, rolling, twisting, bond) if kind]
        scene = scene_of(kinds, friction)
        assert abs(2.0 * error(scene, 800) - error(scene, 400)) < 2e-4, (scene.law, friction)
