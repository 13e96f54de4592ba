"""A third program on the contact law: LIGGGHTS, if it is installed (Debian's package liggghts), for two grains.

Its `hooke/stiffness`, `tangential history` and `rolling_friction epsd2` have the terms of Eqs. 1-3. Each is compared by
itself, in a time step so short that it makes no difference where in the step a term is evaluated.
"""

import shutil
import subprocess

import numpy as np
import pytest

import labkit as lk
from labkit.engines.fused import FusedEngine
from labkit.grains.state import grains_in_cell

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not shutil.which("liggghts"), reason="needs LIGGGHTS: apt-get install liggghts"),
]
RADII, OVERLAP, SIDE = np.array([8.5e-5, 1.02e-4]), 1e-6, 1.5e-3  # m
PLACE = 0.4 * SIDE * np.ones((2, 3)) + [[0.0, 0.0, 0.0], [RADII.sum() - OVERLAP, 0.0, 0.0]]  # normal: x
STEP, STILL = 1e-13, (0.0, 0.0)  # s, rad/s
ROLLING = (-1e-3 / RADII[0], 1e-3 / RADII[1])  # rad/s about y; the surfaces do not slip
UNDAMPED = {"beta_n": 0.0, "beta_t": 0.0}
INPUT = """
units si
atom_style granular
boundary m m m
newton off
communicate single vel yes
region cell block 0 {side} 0 {side} 0 {side} units box
create_box 1 cell
neighbor 1e-4 bin
fix p1 all property/global kn peratomtypepair 1 {kn!r}
fix p2 all property/global kt peratomtypepair 1 {kt!r}
fix p3 all property/global gamman_abs peratomtypepair 1 {gamma_n!r}
fix p4 all property/global gammat_abs peratomtypepair 1 {gamma_t!r}
fix p5 all property/global coefficientFriction peratomtypepair 1 {friction!r}
fix p6 all property/global coefficientRollingFriction peratomtypepair 1 {rolling_friction!r}
pair_style gran model hooke/stiffness tangential history rolling_friction epsd2 absolute_damping on
pair_coeff * *
timestep {dt!r}
{grains}
fix motion all nve/sphere
dump out all custom 1 out.txt id x y z fx fy fz tqx tqy tqz
dump_modify out sort id format "%d %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g"
run {steps}
"""


def two_grains(scene, velocity, spins):
    """Two overlapping grains; velocity (3,) is that of the second, spins (2,) about y."""
    state = grains_in_cell(scene, RADII, PLACE, SIDE * np.eye(3))
    spin = np.zeros((2, 3))
    spin[:, 1] = spins
    return state.replace(time_step=STEP, velocity=np.array([(0, 0, 0), velocity], float), angular_velocity=spin)


def liggghts(state, folder, steps=0):
    """Normal and tangential force and torque on the second grain.

    At the start LIGGGHTS has extended the rolling spring by one step but not the tangential one.
    """
    scene, law = state.scene, state.scene.contact_law
    kn, kt = float(law.normal_stiffness(scene, *RADII)), float(law.tangential_stiffness(scene, *RADII))
    gamma_n, gamma_t = (float(value) for value in law.tangents(scene, *RADII, np.float64(0.0))[4:])
    lines = []
    for number, (r, x, v, w) in enumerate(
        zip(state.radius, state.position, state.velocity, state.angular_velocity, strict=True), start=1
    ):
        lines += [
            "create_atoms 1 single " + " ".join(repr(float(value)) for value in x) + " units box",
            f"set atom {number} diameter {float(2 * r)!r} density {scene.density!r}",
            f"set atom {number} vx {float(v[0])!r} vy {float(v[1])!r} vz {float(v[2])!r} omegay {float(w[1])!r}",
        ]
    text = INPUT.format(
        **{
            "side": SIDE,
            "kn": kn,
            "kt": kt,
            "gamma_n": gamma_n,
            "gamma_t": gamma_t,
            "dt": state.time_step,
            "steps": steps,
        },
        **{"friction": scene.friction, "rolling_friction": scene.rolling_friction, "grains": "\n".join(lines)},
    )
    (folder / "two.in").write_text(text)
    subprocess.run(["liggghts", "-in", "two.in"], cwd=folder, check=True, capture_output=True)
    rows = [line.split() for line in (folder / "out.txt").read_text().splitlines()[-2:]]
    place, force, torque = np.array(rows, float)[:, 1:].reshape(2, 3, 3).swapaxes(0, 1)
    normal = (place[1] - place[0]) / np.linalg.norm(place[1] - place[0])
    along = force[1] @ normal
    return along, np.linalg.norm(force[1] - along * normal), np.linalg.norm(torque[1])


def fused(state):
    """Force (3,) on the second grain in fused, from the change of its velocity in one step, and the State after it."""
    engine = FusedEngine(state)
    engine.advance(1, np.zeros((3, 3)))
    after = engine.state()
    return state.scene.mass(RADII[1]) * (after.velocity - state.velocity)[1] / state.time_step, after


def scene(**changes):
    return lk.Scene(law="spring_dashpot", **changes)


@pytest.mark.parametrize("damping", [UNDAMPED, {}], ids=["spring", "dashpot"])
def test_the_normal_force_is_equal(damping, tmp_path):
    state = two_grains(scene(**damping), (-0.01, 0, 0), STILL)
    normal, _, _ = liggghts(state, tmp_path)
    force, _ = fused(state)
    assert force[0] == pytest.approx(normal, rel=1e-8, abs=0.0)


@pytest.mark.parametrize("limit", [{}, {"friction": 1e-6}], ids=["spring", "limit"])
def test_the_tangential_force_is_equal(limit, tmp_path):
    state = two_grains(scene(**UNDAMPED, **limit), (0, 100.0, 0), STILL)
    _, tangential, _ = liggghts(state, tmp_path, steps=1)
    _, after = fused(state)
    assert np.linalg.norm(after.tangential_force) == pytest.approx(tangential, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("limit", [{}, {"rolling_friction": 1e-12}], ids=["spring", "limit"])
def test_the_rolling_moment_is_equal(limit, tmp_path):
    state = two_grains(scene(**UNDAMPED, **limit), (0, 0, 0), ROLLING)
    _, _, torque = liggghts(state, tmp_path)
    _, after = fused(state)
    assert np.linalg.norm(after.rolling_moment) == pytest.approx(torque, rel=1e-9, abs=0.0)
