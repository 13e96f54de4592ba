"""An element in memory: the stress of a run over the same strain, the same bits again, and a stiffness that fits."""

import signal
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest

import labkit as lk
from labkit.engines import Device
from labkit.micro.tensors import symmetric, to_six
from tests.conftest import PATIENCE

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
    with warnings.catch_warnings(action="ignore"):  # the mean overlap
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


@pytest.mark.parametrize("strain", [1e-6, 1e-9, 1e-300])
def test_the_tangent_of_a_rotation_with_little_strain_is_that_of_none(resting, strain):
    """A rotation of 1e-3 changes the stress by more than a strain of 1e-6 does."""
    rotation = np.array([[0.0, 0.0, 1e-3], [0.0, 0.0, 0.0], [-1e-3, 0.0, 0.0]])
    update, still = (resting.strain(rotation + np.diag([0.0, 0.0, x])) for x in (strain, 0.0))
    np.testing.assert_allclose(update.tangent, still.tangent, rtol=1e-3, atol=1e-3 * still.tangent.max())


@pytest.mark.parametrize(
    "increment",
    [
        [1e-3, 0.0],
        "abc",
        [[1e-3], [1e-3, 0.0]],
        np.full(6, 1e-4j),
        np.full(6, np.nan),
        np.ma.masked_equal([1e-3] * 6, 1e-3),
        [True] * 6,
        [10**400] * 6,
        None,
    ],
    ids=["two", "text", "ragged", "complex", "nan", "masked", "flags", "long", "none"],
)
def test_what_is_not_an_increment_is_refused(soft_specimen, increment):
    with pytest.raises(lk.InputError, match="increment is not an increment of strain: give a tensor"):
        lk.Element(soft_specimen).strain(increment)


def test_mistakes_are_named(soft_specimen):
    for rate in (0, np.inf, np.nan, -10, True):
        with pytest.raises(lk.InputError, match=rf"^rate {rate} "):
            lk.Element(soft_specimen, rate=rate)
    for rate in (10**400, "fast", 10j, [10.0]):
        with pytest.raises(lk.InputError, match=r"^rate "):
            lk.Element(soft_specimen, rate=rate)
    assert lk.Element(soft_specimen, rate="10").rate == lk.Element(soft_specimen, rate="10 1/s").rate == 10.0
    for large in (1e9, 1e300):
        with pytest.raises(lk.InputError, match=r"^increment .*: give strains as fractions"):
            lk.Element(soft_specimen).strain(large * INCREMENT)
    with pytest.raises(lk.InputError, match=r"^increment .*: give a strain that takes at most 1e\+09 steps"):
        lk.Element(soft_specimen, rate=1e-9).strain(INCREMENT)


LONG = """
import sys
import numpy as np
import labkit as lk
from labkit.engines import Device
state = lk.read_state(sys.argv[1])
element = lk.Element(state, rate=1e-6)
element.strain(np.zeros((3, 3)))
print("begun", flush=True)
element.strain(np.diag([0.0, 0.0, 1e-4])) if sys.argv[2] == "Element" else Device(
    "fused", precision=sys.argv[2]
)(state).advance(10**9, np.zeros((3, 3)))
"""


@pytest.mark.slow
@pytest.mark.parametrize("what", ["Element", "double", "mixed"])
def test_ctrl_c_is_heard_within_a_long_computation_without_signal_handlers(what, soft_specimen, tmp_path):
    """It would take hours: some 10^9 time steps, of which the compiled loop makes 1000 at a time."""
    lk.write_state(tmp_path / "s.state.nc", soft_specimen)
    command = [sys.executable, "-W", "ignore", "-c", LONG, str(tmp_path / "s.state.nc"), what]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "begun\n"
            time.sleep(0.5)  # within the compiled loop
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert said.splitlines()[-1] == "KeyboardInterrupt"


def test_pieces_of_a_long_computation_change_no_bits(soft_specimen):
    whole, pieces = (lk.Element(soft_specimen).strain(2.0 * INCREMENT).state for _ in range(2))
    assert whole.step > 2000
    engine = Device()(lk.Element(soft_specimen)._begin)
    gradient = np.array(whole.velocity_gradient)
    for steps in (1, 999, 1000, 7, whole.step - 2007):
        engine.advance(steps, gradient)
    for name, values in engine.state().arrays.items():
        np.testing.assert_array_equal(values, pieces.arrays[name], name)


def test_the_state_of_an_element_cannot_be_exchanged(soft_specimen):
    element = lk.Element(soft_specimen)
    with pytest.raises(AttributeError):
        element.state = None
    assert element.state is soft_specimen
