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


def test_mistakes_are_named(soft_specimen):
    with pytest.raises(lk.InputError, match="increment is not an increment of strain: give a tensor"):
        lk.Element(soft_specimen).strain([1e-3, 0.0])
    with pytest.raises(lk.InputError, match=r"^rate 0 "):
        lk.Element(soft_specimen, rate=0)
