"""The YADE engine against formulas and YADE's own results. All tests run real YADE."""

import numpy as np
import pytest

from labkit.engines.base import reload
from labkit.engines.yade import YadeEngine
from labkit.grains.scene import Scene
from labkit.grains.state import STATE, grains_in_cell
from labkit.grains.state_file import read_state, write_state
from labkit.micro.snapshot import love_stress
from labkit.paths.standard import ConstantVolume
from labkit.records.energy import kinetic_energy
from labkit.servo.plan import prescribed_gradient
from tests.engines.peek import PeekingEngine

pytestmark = [pytest.mark.slow, pytest.mark.yade]

PAIRS = {"equal": (85e-6, 85e-6), "1.5": (102e-6, 68e-6), "1/1.5": (68e-6, 102e-6)}
DT = 1e-9
STILL = np.zeros((3, 3))
NORMAL = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
TANGENT = np.array([2.0, -1.0, 0.0]) / np.sqrt(5.0)
AXIS = np.cross(NORMAL, TANGENT)
UNDAMPED = Scene(local_damping=0.0)


def pair(radius, velocity=0.0, spin=(0.0, 0.0)):
    """Two overlapping grains; the second moves, and both may spin."""
    position = np.array([np.zeros(3), 0.99 * radius.sum() * NORMAL])
    state = grains_in_cell(UNDAMPED, radius, position, np.eye(3) * 20 * radius.max())
    spins = np.array([spin[0] * AXIS, spin[1] * AXIS]) if np.ndim(spin[0]) == 0 else np.array(spin)
    velocities = np.array([np.zeros(3), velocity * np.ones(3)])
    return state.replace(velocity=velocities, angular_velocity=spins, time_step=DT)


@pytest.fixture(scope="module", params=PAIRS.values(), ids=PAIRS)
def two_grains(request):
    radius = np.array(request.param)
    return radius, measured(radius)


def measured(radius):
    """Drag, rolling, twist and separation of two grains; for normal and tangential forces see test_laws.py."""
    engine = PeekingEngine(pair(radius))

    def after(state, steps):
        engine.load(state)
        engine.advance(steps, STILL)
        return engine.state()

    overlap = 0.01 * radius.sum()
    result = {}
    moved = after(pair(radius, 1e-3 * TANGENT), 1)
    result["drag_direction"] = moved.tangential_force[0] @ TANGENT / np.linalg.norm(moved.tangential_force[0])

    # rolling without sliding: w1 R1 + w2 R2 = 0
    ratio = radius[0] / radius[1]
    rolled = after(pair(radius, spin=(1.0, -ratio)), 1)
    result["kr"] = np.linalg.norm(rolled.rolling_moment[0]) / ((1.0 + ratio) * DT)
    result["tangential_while_rolling"] = np.linalg.norm(rolled.tangential_force[0])
    result["rolling_direction"] = rolled.rolling_moment[0] @ AXIS / np.linalg.norm(rolled.rolling_moment[0])
    over = after(pair(radius, spin=(2e6, -2e6 * ratio)), 20)
    result["rolling_limit"] = np.linalg.norm(over.rolling_moment[0]) / over.snapshot().contacts.normal_force[0]

    twisted = after(pair(radius, spin=(1e5 * NORMAL, -1e5 * NORMAL)), 20)
    result["twist_moment"] = np.linalg.norm(twisted.rolling_moment[0])
    result["twist_torque"] = engine.evaluate("O.forces.t(0, True).norm()")

    apart = after(pair(radius, overlap / (10 * DT) * NORMAL), 20)
    result["contacts_apart"] = len(apart.contact_grain)
    result["force_apart"] = engine.evaluate("O.forces.f(0, True).norm()")
    return result


def test_the_second_grain_drags_the_first_along(two_grains):
    assert two_grains[1]["drag_direction"] > 0.5


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
def specimen(specimen_file, tmp_path_factory):
    """Results of a CV test, in which a state also passes through a file and through a checkpoint."""
    state = read_state(specimen_file)
    gradient = prescribed_gradient(ConstantVolume(10.0), state.time_step)

    def advanced(engine, steps):
        engine.advance(steps, gradient)
        return engine

    engine = advanced(PeekingEngine(state), 2000)
    half = engine.state()
    result = {
        "love": love_stress(half.snapshot()),
        "get_stress": np.array(engine.evaluate("[list(row) for row in utils.getStress()]")),
        "engine_stress": engine.stress(),
        "kinetic_energy": kinetic_energy(half),
        "kinetic_energy_yade": engine.evaluate("utils.kineticEnergy()"),
        "time_step": engine.evaluate("O.dt"),
        "density": engine.evaluate("O.bodies[0].state.mass / (4 / 3 * np.pi * O.bodies[0].shape.radius ** 3)"),
        "density_scaling": engine.evaluate("sorted({float(body.state.densityScaling) for body in O.bodies})"),
    }
    unbroken = advanced(engine, 100).state()
    file = tmp_path_factory.mktemp("yade") / "half.state.nc"
    write_state(file, half)
    result["through_file"] = difference(unbroken, advanced(YadeEngine(read_state(file)), 100).state())
    engine = advanced(YadeEngine(state), 500)
    checkpoint = reload(engine)
    resumed = advanced(YadeEngine(checkpoint), 100).state()
    result["checkpoint"] = difference(advanced(engine, 100).state(), resumed)
    first, second = (advanced(YadeEngine(state), 100).state() for _ in range(2))
    result["repeated"] = difference(first, second)
    return result


def difference(a, b):
    """Largest difference of each array, divided by its largest value."""
    if len(a.contact_grain) != len(b.contact_grain):
        return {"contacts": np.inf}
    return {
        name: np.abs(getattr(a, name) - getattr(b, name)).max() / max(np.abs(getattr(a, name)).max(), 1e-300)
        for name in STATE
    }


def test_loves_stress_equals_yades_stress_in_all_components(specimen):
    love, yade = specimen["love"], -specimen["get_stress"].T
    assert np.abs(love - yade).max() < 1e-9 * np.abs(yade).max()
    assert np.abs(love - love.T).max() > 1e-7 * np.abs(love).max()  # a missing transposition would then show
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


def test_a_contact_that_yade_stores_in_reverse_is_loaded_with_the_right_sign(specimen_file):
    """The reverse order of the grains reverses every contact."""
    state = read_state(specimen_file)
    order = np.arange(state.number_of_grains)[::-1]
    back = np.argsort(order)
    reversed_state = state.replace(
        radius=state.radius[order],
        position=state.position[order],
        velocity=state.velocity[order],
        angular_velocity=state.angular_velocity[order],
        contact_grain=back[state.contact_grain].astype(np.int32),
    )
    assert (reversed_state.contact_grain[:, 0] > reversed_state.contact_grain[:, 1]).sum() > 50
    result = YadeEngine(reversed_state).state()
    # `result` sorts contacts by their new indices (smaller, larger): convert to the old indices with first < second
    pair = order[result.contact_grain]
    swap = (pair[:, 0] > pair[:, 1])[:, None]
    pair = np.sort(pair, axis=1)
    sign, by = np.where(swap, -1.0, 1.0), np.lexsort((pair[:, 1], pair[:, 0]))
    np.testing.assert_array_equal(pair[by], state.contact_grain)
    np.testing.assert_array_equal(np.where(swap, -result.contact_shift, result.contact_shift)[by], state.contact_shift)
    for name in ("tangential_force", "rolling_moment"):
        expected = getattr(state, name)
        assert np.abs((sign * getattr(result, name))[by] - expected).max() < 1e-12 * np.abs(expected).max()


def test_density_and_time_step_are_not_scaled(specimen):
    assert np.isclose(specimen["density"], 2650.0, rtol=1e-12)
    assert specimen["time_step"] == Scene().time_step
    assert specimen["density_scaling"] in ([1.0], [-1.0])  # -1: never set
