"""The YADE engine against formulas and YADE's own results. All tests run real YADE."""

import numpy as np
import pytest

from labkit.dem.scene import Scene

PAIRS = {"equal": (85e-6, 85e-6), "1.5": (102e-6, 68e-6), "1/1.5": (68e-6, 102e-6)}


@pytest.fixture(scope="module", params=PAIRS.values(), ids=PAIRS)
def two_grains(request, in_yade):
    return np.array(request.param), in_yade("two_grains.py", *request.param)


def test_normal_stiffness_is_the_papers(two_grains):
    radius, measured = two_grains
    d_star = 2 * radius.prod() / radius.sum()
    assert np.isclose(measured["kn_delta"] / (0.01 * radius.sum()), np.pi / 2 * 0.15e9 * d_star, rtol=1e-12)
    assert np.isclose(measured["normal_force"], measured["kn_delta"], rtol=1e-9)
    assert np.isclose(measured["normal_force_of_state"], measured["normal_force"], rtol=1e-12)


def test_tangential_stiffness_is_the_papers_except_for_the_ratcheting_factor(two_grains):
    """YADE multiplies the relative velocity by 1/(1 - delta/(Ra + Rb)), a deviation of 1 % from Eq. 2 here."""
    _, measured = two_grains
    assert np.isclose(measured["kt"] / measured["kt_formula"], measured["ratcheting_factor"], rtol=1e-6)


def test_the_second_grain_drags_the_first_along(two_grains):
    assert two_grains[1]["drag_direction"] > 0.5


def test_sliding_at_mu_fn(two_grains):
    assert np.isclose(two_grains[1]["sliding"], 0.4, rtol=1e-9)


def test_rolling_stiffness_deviates_from_the_paper_as_stated(two_grains):
    radius, measured = two_grains
    kt = np.pi / 4 * 0.15e9 * 2 * radius.prod() / radius.sum()
    paper = kt * (radius.prod() / radius.sum()) ** 2
    deviation = measured["kr"] / paper - 1
    assert np.isclose(deviation, radius.sum() ** 2 / (4 * radius.prod()) - 1, atol=1e-6)
    assert np.isclose(deviation, 0.0 if radius[0] == radius[1] else 0.0417, atol=1e-4)
    assert measured["tangential_while_rolling"] < 1e-6 * measured["kr"]
    assert abs(measured["rolling_direction"]) > 1 - 1e-6


def test_rolling_limit_deviates_from_the_paper_as_stated(two_grains):
    radius, measured = two_grains
    paper = 0.1 * radius.prod() / radius.sum()
    deviation = measured["rolling_limit"] / paper - 1
    assert np.isclose(measured["rolling_limit"], 0.05 * radius.min(), rtol=1e-6)
    assert np.isclose(deviation, 0.0 if radius[0] == radius[1] else -1 / 6, atol=1e-6)


def test_the_scale_that_corrects_the_mean_rolling_limit():
    """1.064 for radii within 20 %: ratio of the means of mu_r r* and of mu_r min(R)/2 over random pairs."""
    rng = np.random.default_rng(0)
    a, b = rng.uniform(0.8, 1.2, (2, 400_000))
    scale = np.mean(a * b / (a + b)) / np.mean(np.minimum(a, b) / 2)
    assert np.isclose(scale, 1.064, atol=0.001)
    assert "1.064" in Scene.__doc__


def test_no_twist_and_no_tension(two_grains):
    measured = two_grains[1]
    assert measured["twist_moment"] < 1e-20  # N m; the rolling limit is about 1e-7
    assert measured["twist_torque"] < 1e-20
    assert measured["contacts_apart"] == 0
    assert measured["force_apart"] == 0.0


@pytest.fixture(scope="module")
def specimen(in_yade, specimen_file):
    return in_yade("specimen.py", specimen_file)


def test_loves_stress_equals_yades_stress_in_all_components(specimen):
    love, yade = np.array(specimen["love"]), -np.array(specimen["get_stress"]).T
    assert np.abs(love - yade).max() < 1e-9 * np.abs(yade).max()
    assert np.abs(love - love.T).max() > 1e-7 * np.abs(love).max()  # so that a missing transposition would show
    np.testing.assert_allclose(specimen["engine_stress"], yade, rtol=1e-12)


def test_a_run_through_a_state_file_continues_without_a_jump(specimen):
    """After 100 steps only rounding differs, because YADE's lists have another order."""
    assert max(specimen["through_file"].values()) < 1e-9


def test_a_run_is_bit_identical_to_the_run_resumed_from_its_checkpoint(specimen):
    assert set(specimen["checkpoint"].values()) == {0.0}
    assert set(specimen["repeated"].values()) == {0.0}


def test_kinetic_energy_is_yades_own(specimen):
    """The mean field of a CV test does not rotate, and YADE uses the same velocities."""
    assert np.isclose(specimen["kinetic_energy"], specimen["kinetic_energy_yade"], rtol=1e-5)


def test_a_contact_that_yade_stores_in_reverse_is_loaded_with_the_right_sign(in_yade, specimen_file):
    measured = in_yade("reversed.py", specimen_file)
    assert measured["reversed"] > 50
    assert measured["difference"] < 1e-12


def test_density_and_time_step_are_not_scaled(specimen):
    assert np.isclose(specimen["density"], 2650.0, rtol=1e-12)
    assert specimen["time_step"] == Scene().time_step
    assert specimen["density_scaling"] in ([1.0], [-1.0])  # -1: never set


def test_reading_the_contacts_costs_less_than_a_twentieth_of_the_run(specimen):
    """Records are 857 steps apart by default; the cost is counted in steps, not seconds."""
    steps_per_record = 1e-3 / (10.0 * specimen["time_step"])
    assert specimen["reading_in_steps"] < 0.05 * steps_per_record
