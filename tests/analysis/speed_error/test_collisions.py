"""Collisions of two grains on the `fused` engine compared with the closed forms."""

import dataclasses

import numpy as np
import pytest

from analysis.speed_error import collisions
from analysis.speed_error.collisions import collide, collision_errors, restitution
from labkit.errors import InputError, PhysicsError
from labkit.grains.scene import Scene

pytestmark = pytest.mark.long

FRACTIONS = (0.2, 0.1, 0.05, 0.025)
FIRST_ORDER = {(name, "spring_dashpot") for name in ("restitution", "tangential impulse", "tangential restitution")}


@pytest.fixture(scope="module")
def errors():
    return collision_errors(FRACTIONS)


def test_orders_of_convergence(errors):
    """First order if a dashpot starts with the contact, second order for springs and local damping."""
    by_case = {
        key: np.polyfit(np.log(rows["fraction"]), np.log(rows["error"]), 1)[0]
        for key, rows in errors.groupby(["quantity", "law"])
    }
    assert len(by_case) == 8 and FIRST_ORDER < set(by_case)
    for key, order in by_case.items():
        expected, tolerance = (1.0, 0.05) if key in FIRST_ORDER else (2.0, 0.2)
        assert abs(order - expected) < tolerance, (key, order)


def test_sizes_of_the_errors(errors):
    at = errors[errors["fraction"] == 0.1].set_index(["quantity", "law"])
    for key, error in at["error"].items():
        low, high = (0.02, 0.04) if key in FIRST_ORDER else (2e-4, 3e-3)
        assert low < error < high, (key, error)
    finest = errors[errors["fraction"] == FRACTIONS[-1]]
    np.testing.assert_allclose(finest["measured"], finest["exact"], rtol=0.01)


def test_friction_loses_the_push_of_the_dashpot(errors):
    """Jt is low by beta_n w dt, in addition to the error of e; w dt = sqrt(2) fraction."""
    rows = errors[errors["law"] == "spring_dashpot"].pivot(index="fraction", columns="quantity", values="measured")
    share = rows["tangential impulse"] / (0.4 * (1.0 + rows["restitution"]))
    np.testing.assert_allclose(1.0 - share, 0.2 * np.sqrt(2.0) * rows.index, rtol=0.05)


def test_closed_forms():
    assert np.isclose(restitution(Scene(law="spring_dashpot")), 0.527, atol=5e-4)
    for damping in (0.0, 0.5, 0.7):
        scene = Scene(local_damping=damping)
        assert np.isclose(collide(scene, 0.0, 0.01, 0.5)["restitution"], restitution(scene), rtol=1e-3)
    for beta in (0.05, 0.5):
        scene = Scene(law="spring_dashpot", beta_n=beta)
        assert np.isclose(collide(scene, 0.0, 1e-3, 0.5)["restitution"], restitution(scene), rtol=1e-2)


def test_local_damping_is_that_of_the_frame_in_which_it_is_seen(monkeypatch):
    """Seen in the frame of one of the grains, e differs."""
    own = collide(Scene(), 0.0, 0.01, 0.5)["restitution"]
    centre = collisions.approaching

    def from_the_first(*arguments):
        state = centre(*arguments)
        return state.replace(velocity=state.velocity - state.velocity[0])

    monkeypatch.setattr(collisions, "approaching", from_the_first)
    assert abs(collide(Scene(), 0.0, 0.01, 0.5)["restitution"] - own) > 0.01
    undamped = dataclasses.replace(Scene(), local_damping=0.0)
    assert np.isclose(collide(undamped, 0.0, 0.01, 0.5)["restitution"], 1.0, rtol=1e-4)


@pytest.mark.parametrize("fraction", [0.0, -0.1, 1.0, float("nan")])
def test_a_step_that_resolves_no_collision_is_refused(fraction):
    with pytest.raises(InputError, match="below 1"):
        collision_errors([fraction])


def test_a_collision_that_does_not_end_is_no_result():
    with pytest.raises(PhysicsError, match="still touch"):
        collide(Scene(local_damping=0.99), 0.0, 0.1, 0.5)
