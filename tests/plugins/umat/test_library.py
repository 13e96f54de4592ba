"""The compiled law against the Python equations: update, tangent; and hard increments."""

import dataclasses
import os
import re

import numpy as np
import pytest

from labkit.errors import InputError
from labkit.model import rates
from labkit.model.controls import model_path
from labkit.model.driver import drive
from labkit.model.equations import stress_of
from labkit.model.parameters import (
    MEASURED,
    MEASURED_REVERSALS,
    READINGS,
    DensityDependence,
    LodeDependence,
    Reversals,
)
from labkit.model.state import isotropic_state
from labkit.plugins.umat.fortran import equations
from labkit.plugins.umat.material_point import update
from labkit.plugins.umat.props import PointStart, properties
from tests.plugins.umat.points import deviators, random_increments, random_states

pytestmark = pytest.mark.slow

POINTS = int(os.environ.get("LABKIT_UMAT_POINTS", 3000))  # 100000 for the full check
OTHER = {name: choices[1] for name, choices in READINGS.items()}
AMENDED = {"force_rate": "distance", "line_void_ratio": "reported", "compression": "parallel"}
DENSE = DensityDependence(A_Z=-0.27, Ft_Z=0.39, F_d=0.49, Ft_d=0.18)


def other_numbers(model):
    """The model with every parameter changed, each by another factor, so that an exchange of two cannot be missed."""
    parameters = dataclasses.asdict(model.parameters)
    return model.with_parameters(**{name: v * (1.0 + 0.003 * k) for k, (name, v) in enumerate(parameters.items(), 1)})


@pytest.mark.parametrize("lode", [LodeDependence(), MEASURED], ids=["paper", "lode"])
@pytest.mark.parametrize("reversals", [Reversals(), MEASURED_REVERSALS], ids=["", "reversals"])
@pytest.mark.parametrize("readings", [{}, OTHER, AMENDED], ids=["default", "alternatives", "amended"])
def test_increments_agree_with_python(model, load, readings, reversals, lode):
    amendment = 5.0 if readings is AMENDED else 0.0
    terms = {"c_dLam": amendment, "density": DENSE if amendment else DensityDependence(), "reversals": reversals}
    model = dataclasses.replace(other_numbers(model).reading(**readings), lode=lode, **terms)
    n, rng = POINTS, np.random.default_rng(2)
    states, increments = random_states(rng, n), random_increments(rng, n, 10.0 ** rng.uniform(-6, -3, n))
    found, expected = load(model).update(states, increments), update(model, states, increments)
    np.testing.assert_array_equal(found.status, expected.status)
    fine = expected.status == 0
    assert fine.mean() > 0.98
    same = (found.substeps == expected.substeps) & fine  # rounding may change the number of substeps of a rare point
    assert same.sum() > 0.9999 * fine.sum()
    for one, other in ((found.state, expected.state), (found.stress, expected.stress)):
        size = np.abs(other).max(axis=1, keepdims=True)[same]
        np.testing.assert_allclose(one[same] / size, other[same] / size, rtol=1e-9, atol=1e-13)
    size = np.abs(expected.tangent).max(axis=(1, 2), keepdims=True)[same]
    np.testing.assert_allclose(found.tangent[same] / size, expected.tangent[same] / size, rtol=0, atol=1e-11)


@pytest.mark.parametrize("size", [1e-5, 1e-4, 1e-3])
def test_tangent_is_the_derivative_of_the_stress(model, load, size):
    """Where the increment is one substep; central differences of fourth order."""
    law, rng, n = load(model, tolerance=1.0), np.random.default_rng(3), POINTS
    states, increments = random_states(rng, n), random_increments(rng, n, size)
    found, h = law.update(states, increments), 3e-4 * size
    single = (found.substeps == 1) & (np.abs(increments[:, :3].sum(axis=1)) > 10 * h)
    difference = np.empty((n, 6, 6))
    for k, unit in enumerate(np.eye(6)):
        near, far = [
            [law.update(states, increments + sign * step * unit, tangent=False) for sign in (1, -1)]
            for step in (h, 2 * h)
        ]
        for moved in (*near, *far):
            single &= moved.substeps == 1
        change = 8 * (near[0].stress - near[1].stress) - (far[0].stress - far[1].stress)
        difference[:, :, k] = change / (12 * h)
    assert single.mean() > 0.95
    error = np.abs(found.tangent - difference).max(axis=(1, 2)) / np.abs(found.tangent).max(axis=(1, 2))
    assert error[single].max() < 1e-7


def test_isotropic_and_zero_increments(model, load):
    rng = np.random.default_rng(4)
    for readings in ({}, {"strain_rate": "total"}):
        changed = model.reading(**readings)
        states = random_states(rng, 20)
        increments = np.outer(np.repeat([1e-4, -1e-4, 0.0, 1e-7], 5), [1.0, 1, 1, 0, 0, 0])
        found, expected = load(changed).update(states, increments), update(changed, states, increments)
        np.testing.assert_allclose(found.tangent, expected.tangent, atol=1e-12 * np.abs(expected.tangent).max())
        np.testing.assert_array_equal(found.state[10:15], states[10:15])


def hard_points(rng, n):
    """States near every boundary of the equations, with increments up to 10 %."""
    states = random_states(rng, n)
    states[:, 0] = rng.choice([0.02, 0.5, 0.7599, 0.76 - 1e-12, 0.76, 0.9], n)
    states[:, 1] = rng.choice([1e-3, 2.0, 4.0, 5.0, 9.0], n)
    states[:, 2] = rng.choice([1e-12, 1e-6, 1e-3, 0.05], n)
    states[:, 3:9] = deviators(rng, rng.choice([0.0, 0.5, 2.0], n) + 1e-300)
    increments = random_increments(rng, n, rng.choice([1e-12, 1e-4, 1e-2, 0.1], n))
    increments[::7] = increments[::7, :1] * [1, 1, 1, 0, 0, 0]
    return states, increments


@pytest.mark.parametrize("beyond", ["error", "flat"])
def test_no_increment_gives_nan_and_failures_leave_the_state(model, load, beyond):
    model = model.reading(beyond_e_cmax=beyond)
    states, increments = hard_points(np.random.default_rng(5), 80)
    law = load(model, tolerance=1e-2)
    found = law.update(states, increments)
    assert all(np.isfinite(array).all() for array in (found.state, found.stress, found.tangent))
    failed = found.status != 0
    assert 0.1 < failed.mean() < 0.9
    np.testing.assert_array_equal(found.state[failed], states[failed])
    before = np.array([stress_of(y, model.constants) for y in states])
    inside = failed & np.array([rates.outside(y, model.constants) == rates.FINE for y in states])
    np.testing.assert_allclose(found.stress[inside], before[inside], rtol=1e-12, atol=1e-6)
    np.testing.assert_array_equal(found.status, update(model, states, increments, tolerance=1e-2).status)


def test_invalid_increments_have_a_status(model, load):
    states = random_states(np.random.default_rng(6), 3)
    increments = np.array([[np.nan] * 6, [np.inf, 0, 0, 0, 0, 0], [1e-4, 0, 0, 0, 0, 0]])
    found = load(model).update(states, increments)
    assert list(found.status) == [rates.NOT_FINITE, rates.NOT_FINITE, rates.FINE]
    assert np.isfinite(found.stress).all() and np.isfinite(found.tangent).all()


def test_an_increment_after_a_reversal_equals_its_halves(model, load):
    """Large increments against the direction of A and F, in which dilation turns to compression of the contacts."""
    law, rng, n = load(model, tolerance=1e-8), np.random.default_rng(7), 100
    states = random_states(rng, n)
    against = -states[:, 3:9] / np.linalg.norm(states[:, 3:9], axis=1, keepdims=True)
    whole = law.update(states, 2e-3 * against, tangent=False)
    half = law.update(law.update(states, 1e-3 * against, tangent=False).state, 1e-3 * against, tangent=False)
    fine = (whole.status == 0) & (half.status == 0)
    assert fine.mean() > 0.9
    size = np.abs(whole.stress[fine]).max(axis=1, keepdims=True)
    np.testing.assert_allclose(half.stress[fine] / size, whole.stress[fine] / size, atol=1e-4)


def test_an_increment_of_one_percent_in_which_the_stress_reverses_equals_its_hundredths(model, load):
    """Constant volume, against the direction of A, F and F^t, from loaded states: q changes sign in the increment."""
    law = load(model, tolerance=1e-7)
    sheared = drive(model, model_path("cv", 0.5e6, strain=0.02), isotropic_state(model, 0.67, 0.5e6), 1e-3).require()
    states = sheared.vector[5:12, :21]
    back = np.tile(np.array([0.5, 0.5, -1.0, 0.0, 0.0, 0.0]) * 1e-2 / np.sqrt(1.5), (len(states), 1))
    before, whole = law.update(states, 0.0 * back), law.update(states, back)
    parts = before
    for _ in range(100):
        parts = law.update(parts.state, 0.01 * back)
        assert not parts.status.any()
    assert not whole.status.any()
    q_before, q_after = (found.stress[:, 2] - found.stress[:, 0] for found in (before, whole))
    assert (q_before > 1e5).all() and (q_after < -1e5).all()
    size = np.abs(parts.stress).max(axis=1, keepdims=True)
    np.testing.assert_allclose(whole.stress / size, parts.stress / size, atol=1e-5)
    np.testing.assert_allclose(whole.state, parts.state, rtol=1e-5, atol=1e-6)


def test_initial_states(model, load):
    law = load(model, PointStart(0.67, 0.2e6))
    expected = isotropic_state(model, 0.67, 0.5e6).vector()[:21]
    np.testing.assert_allclose(law.initial_state(np.array([5e5, 5e5, 5e5, 0, 0, 0])), expected, rtol=1e-14)
    np.testing.assert_allclose(
        law.initial_state(np.zeros(6)), isotropic_state(model, 0.67, 0.2e6).vector()[:21], rtol=1e-14
    )
    geostatic = np.array([4e4, 5e4, 1e5, 0.0, 3e3, 1e3])
    y = law.initial_state(geostatic)
    np.testing.assert_allclose(stress_of(y, model.constants), geostatic, atol=1e-9 * 1e5)
    np.testing.assert_array_equal(y[[*range(3, 9), *range(15, 21)]], 0.0)
    with pytest.raises(InputError, match="initial void ratio"):
        load(model).initial_state(geostatic)


def test_the_equations_contain_every_constant_and_reading(model):
    """A field of Constants that no equation reads, or that the translation loses, fails here."""
    text = equations()
    assert [name for name in model.constants._fields if not re.search(rf"c%{name}\b", text)] == ["flat"]  # in `outside`


def test_properties_name_every_constant(model):
    names = list(properties(model))
    assert names[:23] == list(model.constants._fields[:23]) and len(names) == 30
    assert properties(model, stress_unit=1e3)["E"] == model.young_modulus / 1e3
    assert len(properties(dataclasses.replace(model, c_dLam=5.0))) == 51
    first = [name for name in OTHER if name != "line_void_ratio"]
    assert [properties(model.reading(**{name: OTHER[name]}))[name] for name in first] == [1.0] * 4
    assert [properties(model.reading(**AMENDED))[name] for name in ("distance", "reported", "parallel")] == [1.0] * 3
    for wrong in (
        lambda: properties(model, tolerance=0.0),
        lambda: PointStart(-1.0),
        lambda: properties(model, None, 1, 0),
    ):
        with pytest.raises(InputError):
            wrong()
