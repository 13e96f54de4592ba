"""Adhesion, necks, capillary bridges and bonds of two grains, in plain Python, against closed forms."""

import math

import numpy as np
import pytest

from labkit.grains.laws import Contact, Vector
from labkit.grains.laws.bond import stiffness_of
from labkit.grains.laws.vectors import ZERO
from labkit.grains.scene import Scene

R = 8.5e-5  # m; the reduced radius of two equal grains is R/2
PULL = math.pi * 0.05 * R  # 2 pi W R*


def stretch(scene, overlaps, spin=ZERO, dt=1e-7, shear=0.0):
    """Move two grains along x; return normal force, N, breaking loss, J, at each overlap, m, and last history.

    With a speed of `shear`, m/s, across it, return the tangential force on the first grain, N, in place of the losses.
    """
    law = scene.contact_law
    composition, numbers = law.composition(scene), law.numbers(scene)
    stiffness = float(law.normal_stiffness(scene, R, R))
    known = {"joined": 0.0, "bond_length": 2.0 * R - overlaps[0]}
    history = composition.make_history(*(known.get(name, ZERO) for name in composition.columns))
    force, loss, n = [], [], Vector(1.0, 0.0, 0.0)
    for overlap in overlaps:
        d = 2.0 * R - overlap
        contact = Contact(stiffness, R, R, overlap, 1.0 / d, d * n, n, Vector(0.0, shear, 0.0), ZERO, spin)
        r = composition.pair(contact, history, numbers, dt)
        history = r.history if shear else r.history._replace(tangential_force=ZERO)
        force.append(-r.force.x)
        loss.append(r.history.tangential_force.y if shear else r.losses.breaking_loss)
    return np.array(force), np.array(loss), history


def separation(scene, start, end):
    """Overlaps, forces, losses of grains that are pulled apart slowly."""
    overlaps = np.linspace(start, end, 3001)
    return overlaps, *stretch(scene, overlaps)[:2]


@pytest.mark.parametrize("law, pull_off", [("dmt", PULL), ("jkr", 0.75 * PULL)])
def test_the_pull_off_force(law, pull_off):
    _, force, _ = separation(Scene(law=law, rolling_friction=0.0), 1e-7, -1e-7)
    assert force.min() == pytest.approx(-pull_off, rel=6e-3)


@pytest.mark.parametrize("law, end", [("dmt", -1e-8), ("jkr", -1e-7), ("capillary", -3e-5), ("bonded", -1.5e-6)])
def test_the_work_of_pulling_apart_is_stored_and_then_lost(law, end):
    scene = Scene(law=law) if law in ("capillary", "bonded") else Scene(law=law, rolling_friction=0.0)
    overlaps, force, loss = separation(scene, 1e-8, end)
    work = np.trapezoid(force, overlaps)  # the work of pulling
    spring = scene.contact_law.normal.energy(float(scene.normal_stiffness(R, R)), 1e-8)
    assert loss.sum() == pytest.approx(work + spring, abs=5e-3 * np.abs(loss).max())
    assert (loss != 0.0).sum() == (1 if law == "bonded" else 2)
    assert not force[-1]


def test_jkr_at_rest_and_at_the_first_touch():
    """a0^3 = 9/2 pi W R*^2/E* and delta0 = a0^2/(3 R*) without load; P = -4/3 pi W R* where grains join."""
    scene = Scene(law="jkr", rolling_friction=0.0)
    modulus, radius = scene.young_modulus / (2.0 * (1.0 - scene.poisson_ratio**2)), R / 2.0
    a0 = (4.5 * math.pi * 0.05 * radius**2 / modulus) ** (1.0 / 3.0)
    force, loss, history = stretch(scene, [-1e-12, 0.0, a0**2 / (3.0 * radius)])
    assert force[0] == loss[0] == 0.0 and history.joined == 1.0 and loss[1] > 0.0
    assert force[1] == pytest.approx(-4.0 / 3.0 * math.pi * 0.05 * radius, rel=1e-9)
    assert abs(force[2]) < 1e-9 * PULL


def test_the_tangential_stiffness_of_jkr_is_that_of_its_contact_area():
    """kt = 8 G* a and a limit mu (P + 2 P_c) without load, at delta = 0 and where the grains part, at P = -5/9 P_c."""
    scene = Scene(law="jkr", rolling_friction=0.0)
    modulus, radius, work = scene.young_modulus / (2.0 * (1.0 - scene.poisson_ratio**2)), R / 2.0, 0.05
    shear = scene.young_modulus / (4.0 * (1.0 + scene.poisson_ratio) * (2.0 - scene.poisson_ratio))  # G*
    c = math.sqrt(2.0 * math.pi * work / modulus)
    law, (a, b) = scene.contact_law, np.full((2, 1), R)
    unloaded, parting = (4.5 * math.pi * work * radius**2 / modulus) ** (1 / 3), (radius * c / 4.0) ** (2 / 3)
    for size in (unloaded, (radius * c) ** (2 / 3), 1.0001 * parting):
        overlap = size**2 / radius - c * math.sqrt(size)
        sheared = stretch(scene, [1e-9, overlap, overlap], shear=1e-9, dt=1.0)[1]
        assert sheared[2] - sheared[1] == pytest.approx(8.0 * shear * size * 1e-9, rel=1e-3)
        assert law.tangents(scene, a, b, np.array([overlap])).tangential == pytest.approx(8.0 * shear * size, rel=1e-6)
        slid = stretch(scene, [1e-9, overlap, overlap], shear=1e-7, dt=1.0)[1]
        normal, _ = law.forces(scene, np.stack([a, b]), np.array([overlap]), {"joined": np.ones(1)})
        assert slid[2] == pytest.approx(scene.friction * (normal[0] + 1.5 * PULL), rel=1e-6)
    assert normal == pytest.approx(-5.0 / 9.0 * 0.75 * PULL, rel=1e-2)


def test_a_dmt_contact_in_tension_slides_at_the_friction_of_its_elastic_force():
    """mu (fn + 2 pi W R*), which falls to zero at pull-off; YADE takes |fn| and would hold more."""
    scene = Scene(law="dmt", rolling_friction=0.0)
    spring = scene.contact_law.normal_stiffness(scene, R, R)
    for share in (-0.7, -0.4, 0.5):  # of the pull-off force
        overlap = ((1.0 + share) * PULL / spring) ** (2.0 / 3.0)
        force = stretch(scene, [overlap, overlap])[0]
        assert force[1] == pytest.approx(share * PULL, rel=1e-9)
        slid = stretch(scene, [overlap] * 3, shear=1e-6, dt=1.0)[1]
        assert slid[2] == pytest.approx(scene.friction * (1.0 + share) * PULL, rel=1e-9)


def test_the_force_of_a_bridge_against_distance():
    """Within 3 % of its largest force of the fit of Willett et al. to numerical solutions, up to rupture."""
    scene = Scene(law="capillary", contact_angle=20.0)
    largest = 2.0 * math.pi * scene.surface_tension * R * math.cos(math.radians(20.0))
    rupture = R * (1.0 + math.radians(10.0)) * (0.01 ** (1 / 3) + 0.1 * 0.01 ** (2 / 3))
    gap = np.linspace(0.0, rupture * 0.999999, 200)
    force = stretch(scene, -gap)[0]
    s = gap / R / math.sqrt(0.01)
    fit = 1.0 / (1.0 + 1.05 * s + 2.5 * s * s)
    assert force[0] == pytest.approx(-largest, rel=1e-12) and np.abs(-force / largest - fit).max() < 0.03
    force, loss, history = stretch(scene, [0.0, -0.999999 * rupture, -1.000001 * rupture, -0.5 * rupture])
    assert force[1] < 0.0 and force[2] == force[3] == history.joined == 0.0 and loss[2] > 0.0


def test_a_bond_fails_exactly_at_its_strength():
    scene = Scene(law="bonded", bond_strength=2e6, bond_shear_strength=1e6)
    area, limit = math.pi * R**2, 2e6 / scene.bond_modulus * 2.0 * R
    force, loss, *_ = stretch(scene, np.array([0.0, -limit * (1 - 1e-9), -limit * (1 + 1e-9)]))
    assert force[1] == pytest.approx(-2e6 * area, rel=1e-8) and force[2] == 0.0
    assert loss[2] == pytest.approx(0.5 * 2e6 * area * limit, rel=1e-8)
    for axis, strength, lever in (("x", 1e6, R / 2.0), ("y", 2e6, R / 4.0)):  # torque T = tau J/r, moment M = sigma I/r
        stiffness = stiffness_of(scene.contact_law.bond.numbers(scene), R, R, 2.0 * R)
        moment = strength * area * lever
        angle = moment / stiffness[3 if axis == "x" else 2]
        for share, whole in ((1 - 1e-9, True), (1 + 1e-9, False)):
            spin = Vector(**{**dict.fromkeys("xyz", 0.0), axis: share * angle})
            history = stretch(scene, np.zeros(1), spin, dt=1.0)[2]
            assert (history.bond_length > 0.0) == whole
            if whole:
                assert getattr(history.bond_moment, axis) == pytest.approx(moment, rel=1e-8)
