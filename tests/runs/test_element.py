"""An element in memory: the stress of a run over the same strain, the same bits again, and a stiffness that fits."""

import numpy as np
import pytest

import labkit as lk
from labkit.micro.tensors import symmetric, to_six

INCREMENT = np.array([[-5e-4, 0.0, 2e-4], [0.0, -5e-4, 0.0], [2e-4, 0.0, 1e-3]])


@pytest.fixture(scope="module")
def first(soft_specimen):
    return lk.Element(soft_specimen).strain(INCREMENT)


def test_the_same_increment_has_the_same_bits_and_leaves_the_element_where_it_is(soft_specimen, first):
    element = lk.Element(soft_specimen)
    element.strain(-INCREMENT)
    again = element.strain(to_six(INCREMENT))
    np.testing.assert_array_equal(again.stress, first.stress)
    np.testing.assert_array_equal(again.state.position, first.state.position)
    assert element.state is soft_specimen


def test_it_has_the_stress_of_a_run(soft_specimen, first):
    """The time steps are the same; a run has the same strain rates."""
    rate = 10.0 / np.linalg.norm(INCREMENT)
    path = lk.paths.Mixed(strain_rate=INCREMENT * rate, strain=1.0 / rate, rate=1.0)
    run = lk.run(soft_specimen, path, progress=False, snapshots=0)
    assert run.steps == pytest.approx(first.state.step, abs=1)
    np.testing.assert_allclose(run.data["stress"].values[-1], first.stress, atol=100.0)


def test_the_tangent_gives_the_stress_change(soft_specimen, first):
    change = first.stress - lk.love_stress(soft_specimen.snapshot())
    np.testing.assert_allclose(first.tangent @ to_six(INCREMENT), to_six(symmetric(change)), rtol=1e-9, atol=1e-3)
    second = lk.Element(first.state).strain(INCREMENT)
    np.testing.assert_allclose(second.tangent @ to_six(INCREMENT), to_six(symmetric(second.stress - first.stress)))
    halves = [lk.Element(soft_specimen).strain(0.5 * INCREMENT)]
    halves.append(lk.Element(halves[0].state).strain(0.5 * INCREMENT))
    np.testing.assert_allclose(halves[1].stress, first.stress, atol=100.0)


@pytest.fixture(scope="module", params=[("rolling_resistance", 0.15e9, 0.58, 2), ("hertz_mindlin", 5e9, 0.65, 3)])
def resting(request):
    law, modulus, void_ratio, seed = request.param
    recipe = lk.Recipe(void_ratio=void_ratio, grains=300, seed=seed)
    state = lk.make_specimen(recipe, lk.Scene(law=law, young_modulus=modulus), progress=False)
    return lk.Element(lk.consolidate(state, 300e3, progress=False))


@pytest.mark.parametrize("component", [2, 4], ids=["zz", "xz"])
def test_the_tangent_of_a_small_increment_is_the_central_difference(resting, component):
    """Both specimens are elastic up to 1e-4. Without strain, the stress changes by 3e-5 and 9e-5 p.

    Their bits depend on the processor, by the products of BLAS. The tolerance contains a hundredth of that change.
    """
    direction = np.eye(6)[component]
    for size in (1e-7, 1e-6, 1e-5, 1e-4):
        up, down = (resting.strain(sign * size * direction) for sign in (1.0, -1.0))
        central = to_six(symmetric(up.stress - down.stress))[component] / (2.0 * size)
        tolerance = pytest.approx(central, rel=0.02, abs=1e-6 * 300e3 / size)
        for update in (up, down):
            assert update.tangent[component, component] == tolerance, size


@pytest.mark.parametrize("size", [9e-8, 1e-12, 1e-300, 5e-324])
def test_the_tangent_of_an_increment_lost_in_noise_is_that_of_none(resting, size):
    update, still = (resting.strain(np.diag([0.0, 0.0, x])) for x in (size, 0.0))
    np.testing.assert_allclose(update.tangent, still.tangent, rtol=1e-3, atol=1e-3 * still.tangent.max())
    np.testing.assert_allclose(update.stress, still.stress, atol=1e-4 * still.stress.max())


@pytest.mark.parametrize(
    "increment",
    [
        [1e-3, 0.0],
        "abc",
        [[1e-3], [1e-3, 0.0]],
        np.full(6, 1e-4j),
        np.full(6, np.nan),
        np.ma.masked_equal([1e-3] * 6, 1e-3),
    ],
    ids=["two", "text", "ragged", "complex", "nan", "masked"],
)
def test_what_is_not_an_increment_is_refused(soft_specimen, increment):
    with pytest.raises(lk.InputError, match="increment is not an increment of strain: give a tensor"):
        lk.Element(soft_specimen).strain(increment)


def test_mistakes_are_named(soft_specimen):
    for rate in (0, np.inf, np.nan):
        with pytest.raises(lk.InputError, match=rf"^rate {rate} "):
            lk.Element(soft_specimen, rate=rate)
    for large in (1e9, 1e300):
        with pytest.raises(lk.InputError, match=r"^increment .*: give strains as fractions"):
            lk.Element(soft_specimen).strain(large * INCREMENT)
    with pytest.raises(lk.InputError, match=r"^increment .*: give a strain that takes at most 1e\+09 steps"):
        lk.Element(soft_specimen, rate=1e-9).strain(INCREMENT)
