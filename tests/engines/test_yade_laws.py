"""Laws in YADE, composed of what their parts say."""

import numpy as np
import pytest

import labkit as lk
from labkit.grains.laws import (
    LAWS,
    Adhesion,
    CoulombOfYade,
    DashpotsOfYade,
    HertzSpring,
    LinearSpring,
    LocalDamping,
    Mindlin,
    RollingOfYade,
    WithoutRatcheting,
)

ON_YADE = {"rolling_resistance", "hertz_mindlin", "hertz_mindlin_dashpot"}


class Slightly(LinearSpring):
    """A subclass of a part that YADE has, which may have another force."""


class Sliding(lk.ContactLaw):
    name, kinematics, avoids_ratcheting = "sliding_only", WithoutRatcheting, True
    parts = LinearSpring() + CoulombOfYade() + LocalDamping()


class Undamped(lk.ContactLaw):
    name, parts = "undamped_hertz", HertzSpring() + Mindlin()


class OtherKinematics(lk.ContactLaw):
    name, parts = "sliding_otherwise", LinearSpring() + CoulombOfYade() + LocalDamping()


class TwoFunctors(lk.ContactLaw):
    name, kinematics = "two_functors", WithoutRatcheting
    parts = HertzSpring() + Mindlin() + RollingOfYade() + LocalDamping()


class Frictionless(lk.ContactLaw):
    name, kinematics, parts = "no_tangential_part", WithoutRatcheting, LinearSpring() + LocalDamping()


class Changed(lk.ContactLaw):
    name, kinematics, parts = "changed_part", WithoutRatcheting, Slightly() + CoulombOfYade() + LocalDamping()


class StickyDashpots(lk.ContactLaw):
    name, parts = "sticky_dashpots", HertzSpring() + Mindlin() + DashpotsOfYade() + Adhesion()


@pytest.fixture(autouse=True)
def own_laws(monkeypatch):
    """The laws of this file, for one test."""
    own = (Sliding, Undamped, OtherKinematics, TwoFunctors, Frictionless, Changed, StickyDashpots)
    monkeypatch.setattr(LAWS, "_entries", {**LAWS._entries, **{law.name: law for law in own}})


@pytest.mark.parametrize("name", sorted(ON_YADE | {"spring_dashpot", "dmt", "jkr", "bonded", "capillary"}))
def test_yade_has_the_laws_of_labkit_whose_parts_it_has(name):
    scene = lk.Scene(law=name)
    assert (scene.contact_law.yade(scene) is not None) == (name in ON_YADE)


@pytest.mark.parametrize("law", [OtherKinematics, TwoFunctors, Frictionless, Changed, StickyDashpots])
def test_yade_refuses_sums_that_it_would_compute_otherwise(law):
    scene = lk.Scene(law=law.name)
    assert scene.contact_law.yade(scene) is None


@pytest.mark.slow
@pytest.mark.parametrize("law", [Sliding, Undamped])
def test_a_users_sum_of_parts_is_the_same_on_yade(law):
    recipe = lk.Recipe(grains=100, preparation="compression", pressure="100 kPa")
    state = lk.make_specimen(recipe, lk.Scene(law=law.name))
    path = lk.paths.ConstantMeanStress(pressure="100 kPa", strain=0.001, rate=10)
    stress = [lk.run(state, path, engine=engine).data["stress"].values[-1] for engine in ("fused", "yade")]
    np.testing.assert_allclose(stress[1], stress[0], rtol=0.0, atol=1e-9 * np.abs(stress[0]).max())
