"""The fused engine against YADE, closed-form solutions and an independent integration."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.kernel import copies
from labkit.engines import Device
from labkit.engines.base import Engine, reload
from labkit.engines.fused import FusedEngine
from labkit.engines.threads import ThreadChoice, warn_once
from labkit.errors import InputError, PhysicsError
from labkit.files.schema import STATE
from labkit.grains.scene import Scene
from labkit.grains.state import State, grains_in_cell
from labkit.grains.state_file import read_state, write_state
from labkit.micro.snapshot import contacts_per_grain
from labkit.paths.standard import ConstantVolume
from labkit.records.energy import balance_error, kinetic_energy, open_ledger
from labkit.servo.plan import prescribed_gradient
from labkit.specimens.recipe import Recipe
from labkit.specimens.specimen import prepare_specimen
from tests.engines.peek import reached
from tests.engines.two_heavy_grains import scene_of

pytestmark = pytest.mark.slow

STILL = np.zeros((3, 3))
R = 85e-6
FUSED = Device("fused")
LINEAR = ("rolling_resistance", "spring_dashpot")  # for other laws see test_laws.py


def shear(state, rate=10.0):
    return prescribed_gradient(ConstantVolume(rate), state.time_step)


@pytest.fixture(scope="module", params=LINEAR)
def specimen(request):
    """About 1,100 grains at rest for each contact law, made by the engine itself."""
    return prepare_specimen(Scene(law=request.param), Recipe(0.67, 0.15, grains=1100), FUSED)


@pytest.fixture(scope="module")
def yade_specimen():
    return prepare_specimen(Scene(), Recipe(0.67, 0.15, grains=1100), FUSED)


def pair(
    scene,
    distance,
    velocity=(0.0, 0.0, 0.0),
    spin=((0, 0, 0), (0, 0, 0)),
    radius=(R, R),
    direction=(0, 0, 1.0),
    cell=None,
    time_step=1e-9,
):
    """Two grains, the second at `distance` in `direction` from the first, moving with `velocity`."""
    unit = np.array(direction) / np.linalg.norm(direction)
    state = grains_in_cell(
        scene, np.array(radius), np.array([np.zeros(3), distance * unit]), np.eye(3) * 20 * R if cell is None else cell
    )
    return state.replace(
        velocity=np.array([np.zeros(3), velocity]), angular_velocity=np.array(spin, float), time_step=time_step
    )


def after(state, steps, gradient=STILL):
    engine = FusedEngine(state)
    engine.advance(steps, gradient)
    return engine.state()


# --- against YADE -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def yade_results(yade_specimen):
    """Velocity gradient, YADE's states and stresses after COUNTS steps, and those for the reverse order of grains."""
    gradient = shear(yade_specimen)
    order = np.arange(yade_specimen.number_of_grains)[::-1]
    results = []
    for by in (order[::-1], order):
        sorted_specimen = yade_specimen.replace(
            radius=yade_specimen.radius[by],
            position=yade_specimen.position[by],
            velocity=yade_specimen.velocity[by],
            angular_velocity=yade_specimen.angular_velocity[by],
            contact_grain=np.argsort(by)[yade_specimen.contact_grain].astype(np.int32),
        )
        results.append(reached(sorted_specimen, COUNTS, gradient))
    return gradient, *results


COUNTS = (1, 100, 2000)


def test_after_one_step_the_forces_are_yades(yade_specimen, yade_results):
    gradient, given, _ = yade_results
    engine = FusedEngine(yade_specimen)
    engine.advance(1, gradient)
    ours, (yades, stress) = engine.state(), given[0]
    assert len(ours.contact_grain) > 2500
    for name in ("contact_grain", "contact_shift", "cell"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(yades, name))
    force, expected = ours.snapshot().contacts.force_on_first(), yades.snapshot().contacts.force_on_first()
    assert np.abs(force - expected).max() < 1e-12 * np.abs(expected).max()
    for name in ("tangential_force", "rolling_moment"):
        a, b = getattr(ours, name), getattr(yades, name)
        assert np.abs(a - b).max() < 1e-12 * np.abs(b).max()
    assert np.abs(engine.stress() - stress).max() < 1e-12 * np.abs(stress).max()


def test_after_2000_steps_positions_and_stress_are_yades(yade_specimen, yade_results):
    """The difference is below 1e-8 D, or at most ten times that of YADE with its grains in another order.

    Rounding errors grow in a specimen whose contacts open and slide, in YADE too.
    """
    gradient, given, reverse = yade_results
    diameter = 2 * yade_specimen.radius.mean()
    engine, done = FusedEngine(yade_specimen), 0
    for count, (yades, stress), (other, other_stress) in zip(COUNTS, given, reverse, strict=True):
        engine.advance(count - done, gradient)
        done = count
        ours = engine.state()
        own = np.abs(other.position[::-1] - yades.position).max() / diameter
        assert np.abs(ours.position - yades.position).max() / diameter < max(1e-8, 10 * own)
        own = np.abs(other_stress - stress).max() / np.abs(stress).max()
        assert np.abs(engine.stress() - stress).max() / np.abs(stress).max() < max(1e-8, 10 * own)


def test_work_and_losses_are_yades(yade_specimen, yade_results):
    gradient, given, _ = yade_results
    ours = after(yade_specimen, 2000, gradient).ledger
    yades = given[-1][0].ledger
    assert np.isclose(ours.cell_work, yades.cell_work, rtol=1e-3)  # YADE's value is a trapezoidal sum over 50 steps
    for name in ("friction_loss", "rolling_loss", "damping_loss"):
        assert np.isclose(getattr(ours, name), getattr(yades, name), rtol=1e-2), name


def test_a_state_passes_from_yade_to_fused_and_back_without_a_jump(yade_specimen, yade_results):
    gradient, given, _ = yade_results
    (half, stress), (_, end_stress) = given[1], given[2]
    engine = FusedEngine(half)
    assert np.abs(engine.stress() - stress).max() < 1e-12 * np.abs(stress).max()
    engine.advance(950, gradient)
    (_, first), (_, last) = reached(engine.state(), (0, 950), gradient)
    assert np.abs(engine.stress() - first).max() < 1e-12 * np.abs(stress).max()
    assert np.abs(end_stress - last).max() < 1e-6 * np.abs(stress).max()


# --- contact laws -----------------------------------------------------------------------------------------------


def column(scene, radius=(R, R), overlap=0.01):
    """Two grains in a cell as high as both: they touch twice, above and below."""
    a, b = radius
    distance = (a + b) * (1 - overlap)
    cell = np.diag([20 * R, 20 * R, 2 * distance])
    return pair(scene, distance, radius=radius, cell=cell, time_step=1e-8)


def test_rolling_moments_stop_two_grains():
    """Equal grains with opposite spins roll without sliding: the spin decreases at the rate 2 mu_r r* fn/I."""
    radius = np.array([R, R])
    scene = Scene(law="spring_dashpot", beta_t=0.0)
    state = column(scene, radius)
    contacts = after(state, 0).snapshot().contacts
    assert len(contacts) == 2
    moment = 2 * 0.1 * radius.prod() / radius.sum() * contacts.normal_force[0]
    inertia = scene.moment_of_inertia(radius)
    spin = 4e4 * np.array([1.0, -1.0])
    state = state.replace(angular_velocity=np.array([[w, 0.0, 0.0] for w in spin]))
    rolling, slowed = after(state, 100), after(state, 200)  # at the rolling limit by then
    fall = np.sign(spin) * moment / inertia * 100 * state.time_step
    assert (np.abs(slowed.angular_velocity[:, 0]) > 0.2 * np.abs(spin)).all()
    np.testing.assert_allclose((rolling.angular_velocity - slowed.angular_velocity)[:, 0], fall, rtol=1e-3)
    assert kinetic_energy(after(state, 4000)) < 0.03 * kinetic_energy(state)  # the springs may still oscillate


def test_the_rolling_moment_limit_of_each_law():
    radius = np.array([1.2 * R, 0.8 * R])
    arms = {"spring_dashpot": 0.1 * radius.prod() / radius.sum(), "rolling_resistance": 0.05 * radius.min()}
    for law, arm in arms.items():
        state = column(Scene(law=law), radius).replace(angular_velocity=np.array([[4e4, 0, 0], [-4e4, 0, 0]]))
        state = after(state, 30)
        moment = np.linalg.norm(state.rolling_moment, axis=1)
        np.testing.assert_allclose(moment, arm * state.snapshot().contacts.normal_force, rtol=1e-12)


def test_an_opened_contact_has_no_tension_and_loses_its_history():
    scene = Scene(law="spring_dashpot")
    apart = after(pair(scene, 0.999 * 2 * R, velocity=(0.3, 0, 1.0)), 2000)
    assert len(apart.contact_grain) == 0
    again = after(apart.replace(position=np.array([[0, 0, 0], [0, 0, 1.99 * R]]), velocity=0 * apart.velocity), 0)
    assert np.abs(again.tangential_force).max() == 0.0 and len(again.contact_grain) == 1


def orbit(state, gradient, time, kt=None):
    """Integrate Eqs. 1-3 for two grains with solve_ivp; an independent formulation in the x-z plane.

    Returns the final vector of `rates`: positions, velocities relative to the mean field, spins, tangential force as a
    scalar, branch. The friction limit must not be reached.
    """
    scene, radius = state.scene, state.radius
    kn = scene.normal_stiffness(*radius)
    kt = scene.tangential_stiffness(*radius) if kt is None else kt
    mass, inertia = scene.mass(radius), scene.moment_of_inertia(radius)
    shift = np.linalg.inv(state.cell) @ (state.position[1] - state.position[0])
    period = -np.round(shift)
    L = gradient

    def rates(t, y):
        xa, xb, ca, cb = y[0:3], y[3:6], y[6:9], y[9:12]
        wa, wb, T, d = y[12], y[13], y[14], y[15:18]
        distance = np.linalg.norm(d)
        n = d / distance
        tangent = np.array([n[2], 0.0, -n[0]])  # y x n
        overlap = radius.sum() - distance
        relative = L @ d + cb - ca
        arm = radius - overlap / 2
        if overlap < 0:
            force, torque, dT = np.zeros(3), 0.0, 0.0
        else:
            force = -kn * overlap * n + T * tangent
            torque = T  # about y: n x (y x n) = y
            dT = kt * (relative @ tangent - (arm[0] * wa + arm[1] * wb))
        return np.concatenate(
            [
                L @ xa + ca,
                L @ xb + cb,
                force / mass[0],
                -force / mass[1],
                [arm[0] * torque / inertia[0], arm[1] * torque / inertia[1], dT],
                relative,
            ]
        )

    c = state.velocity - state.position @ L.T
    start = np.concatenate(
        [
            state.position[0],
            state.position[1],
            c[0],
            c[1],
            state.angular_velocity[:, 1],
            [0.0],
            state.position[1] + state.cell @ period - state.position[0],
        ]
    )

    def touch(t, y):
        return radius.sum() - np.linalg.norm(y[15:18])

    touch.terminal, touch.direction = True, 1
    first = solve_ivp(rates, (0, time), start, method="DOP853", rtol=1e-10, atol=1e-15, events=touch)
    rest = solve_ivp(rates, (first.t[-1], time), first.y[:, -1], method="DOP853", rtol=1e-10, atol=1e-15)
    return rest.y[:, -1]


ELASTIC = scene_of("spring_dashpot", friction=10.0)
SLIDE = np.array([[0.0, 0.0, 40.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # dvx/dz, 1/s


def across_the_boundary(gradient, time_step, gap=0.03):
    """Two unequal spinning grains, `gap` R apart, that meet across the upper side of a skewed cell."""
    cell = np.diag([16 * R, 16 * R, 16 * R]) + np.array([[0, 0, 3 * R], [0, 0, 0], [0, 0, 0]])
    offset = (2.0 + gap) * R * np.array([0.45, 0.0, 0.893])
    position = np.array([cell[:, 2] * 0.97, cell[:, 2] * -0.03 + offset])
    c = np.array([[0.0, 0.0, 0.4], [0.02, 0.0, -0.6]])
    return grains_in_cell(ELASTIC, np.array([1.1 * R, 0.9 * R]), position, cell).replace(
        velocity=c + position @ gradient.T,
        velocity_gradient=gradient,
        time_step=time_step,
        angular_velocity=np.array([[0.0, 500.0, 0.0], [0.0, -2000.0, 0.0]]),
    )


def test_a_collision_across_the_boundary_of_a_sheared_cell():
    """The collision has no friction, and starts and ends in free flight."""
    time, steps = 1.0e-5, 10_000
    state = across_the_boundary(SLIDE, time / steps)
    smooth = dataclasses.replace(ELASTIC, friction=1e-15)
    end = after(state.replace(scene=smooth), steps, SLIDE)
    exact = orbit(state, SLIDE, time, kt=0.0)
    assert len(end.contact_grain) == 0
    assert np.linalg.norm(end.velocity - state.velocity, axis=1).min() > 0.5
    np.testing.assert_allclose(end.position.ravel(), exact[:6], atol=1e-6 * R)


@pytest.mark.parametrize("gradient", [STILL, SLIDE], ids=["held", "sheared"])
def test_an_elastic_orbit_converges_with_the_square_of_the_time_step(gradient):
    """With tangential spring and spins; the grains overlap throughout.

    (A contact that forms during a step is counted from the end of the previous step, a first-order error in dt.)
    """
    time = 8e-7
    errors = {"position": [], "tangential force": []}
    exact = orbit(across_the_boundary(gradient, 1e-9, gap=-0.005), gradient, time)
    for steps in (50, 100, 200, 400):
        state = across_the_boundary(gradient, time / steps, gap=-0.005)
        scene, contact = state.scene, after(state, 0).snapshot().contacts
        pull = np.array([1.0, -1.0])[:, None] * contact.force_on_first() / scene.mass(state.radius)[:, None]
        end = after(state.replace(velocity=state.velocity - 0.5 * state.time_step * pull), steps, gradient)
        errors["position"].append(np.abs(end.position.ravel() - exact[:6]).max())
        errors["tangential force"].append(abs(np.linalg.norm(end.tangential_force[0]) - abs(exact[14])))
    assert abs(exact[14]) > 1e-4
    assert errors["position"][-1] < 1e-7 * R and errors["tangential force"][-1] < 1e-4 * abs(exact[14])
    for values in errors.values():
        slope = np.polyfit(np.log([1, 2, 4, 8]), np.log(values), 1)[0]
        assert -2.3 < slope < -1.8, errors


@pytest.mark.parametrize("law", LINEAR)
def test_momentum_is_conserved_to_rounding(law):
    scene = Scene(law=law, local_damping=0.0)
    rng = np.random.default_rng(4)
    state = grains_in_cell(scene, rng.uniform(0.8, 1.2, 60) * R, rng.random((60, 3)) * 8 * R, np.eye(3) * 8 * R)
    state = state.replace(
        velocity=rng.normal(size=(60, 3)), angular_velocity=1e3 * rng.normal(size=(60, 3)), time_step=1e-9
    )
    end = after(state, 2000)
    mass = scene.mass(state.radius)
    assert np.linalg.norm(end.velocity - state.velocity) > 1.0
    assert np.abs(mass @ end.velocity - mass @ state.velocity).max() < 1e-12 * np.sum(mass[:, None] * abs(end.velocity))


# --- energy and the time step -----------------------------------------------------------------------------------


def test_the_energy_balance_of_a_shear_test_closes(specimen):
    state = open_ledger(specimen)
    strain = 0.1
    end = after(state, round(strain / 100.0 / state.time_step), shear(state, 100.0))
    ledger = end.ledger
    assert ledger.cell_work > 3 * ledger.start
    assert ledger.friction_loss > 0.1 * ledger.cell_work and ledger.rolling_loss > 0.0 and ledger.damping_loss > 0.0
    # YADE's anti-ratcheting factor, up to 1 % of the tangential work, is not part of a mechanical balance
    assert abs(balance_error(end)) < (0.01 if state.scene.law == "spring_dashpot" else 0.02)


def test_the_energy_balance_detects_time_steps_that_dashpots_make_unstable():
    """0.41 sqrt(m/k), at which a specimen seems stable, and 0.3, which is stable without dashpots."""
    scene = Scene(law="spring_dashpot")
    for factor in (0.41, 0.3):
        step = factor * scene.time_unit
        recipe = Recipe(0.67, 0.4, grains=600)
        stable = prepare_specimen(scene, recipe, FUSED)
        engine = FusedEngine(open_ledger(stable).replace(time_step=step))
        engine.advance(3000, shear(stable))
        assert abs(balance_error(engine.state())) > 0.05
        with pytest.raises(PhysicsError, match="time step"):
            prepare_specimen(dataclasses.replace(scene, time_step_factor=0.2 * step / scene.time_step), recipe, FUSED)


# --- memory, threads, files -------------------------------------------------------------------------------------


def identical(a, b):
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in STATE) and a.ledger == b.ledger


class Alternating(ThreadChoice):
    """One and two threads in turn, every seven steps."""

    def steps(self, wanted):
        return min(wanted, 7)

    def record(self, steps, seconds):
        self.count = 3 - self.count


@pytest.mark.parametrize("precision", ["double", "mixed"])
def test_the_results_are_bit_identical_for_any_number_of_threads(precision, specimen):
    gradient = shear(specimen)
    state = copies(specimen, (2, 2, 2))  # large enough for several domains
    assert state.number_of_grains > 8000
    results = []
    for threads, choice in ((1, None), (2, None), (2, Alternating(2))):
        engine = FusedEngine(state, threads, precision=precision)
        engine.thread_choice = choice or engine.thread_choice
        engine.advance(150, gradient)
        results.append(engine.state())
    assert identical(results[0], results[1]) and identical(results[0], results[2])


def test_a_small_specimen_uses_one_thread(specimen, caplog):
    """Threads share domains of 3,000 grains."""
    warn_once.cache_clear()
    FusedEngine(specimen, 2).advance(10, shear(specimen))
    assert "runs on 1 thread, not 2: it can use one thread per 3,000 grains" in caplog.text


@pytest.mark.parametrize("precision", ["double", "mixed"])
def test_a_run_with_a_checkpoint_equals_the_run_resumed_from_it(precision, specimen, tmp_path):
    gradient = shear(specimen)
    engine = FusedEngine(open_ledger(specimen), precision=precision)
    engine.advance(700, gradient)
    write_state(tmp_path / "half.state.nc", reload(engine))
    half = read_state(tmp_path / "half.state.nc")
    resumed = FusedEngine(half, precision=precision)
    for either in (engine, resumed):
        either.advance(1300, gradient)
    assert identical(engine.state(), resumed.state())
    assert half.precision == precision and FusedEngine(half).state().precision == "double"


def test_grains_are_stopped_in_place_as_by_loading_them_without_velocities(specimen):
    """Both give the same state to rounding; loading also searches neighbours, which takes much longer."""
    in_place, loaded = (FusedEngine(open_ledger(specimen)) for _ in range(2))
    for engine in (in_place, loaded):
        engine.advance(700, shear(specimen))
    lost = kinetic_energy(in_place.state())
    damped = in_place.state().ledger.damping_loss
    in_place.stop_grains()
    Engine.stop_grains(loaded)
    assert in_place.state().ledger == loaded.state().ledger
    assert in_place.state().ledger.damping_loss == pytest.approx(damped + lost, rel=1e-12)
    for _ in range(2):
        for name in ("position", "velocity", "angular_velocity", "tangential_force", "rolling_moment"):
            a, b = (getattr(engine.state(), name) for engine in (in_place, loaded))
            np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-12 * np.abs(b).max(), err_msg=name)
        for engine in (in_place, loaded):
            engine.advance(1, shear(specimen))


def test_more_threads_than_the_computer_has_are_refused(specimen):
    message = "^threads 10000 are too many for the fused engine on this computer: give at most "
    with pytest.raises(InputError, match=message) as raised:
        FusedEngine(specimen, 10_000)
    assert (raised.value.field, raised.value.value) == ("threads", 10_000)


# --- hard cases -------------------------------------------------------------------------------------------------


def all_contacts(state: State, reach=2):
    """Find overlapping pairs by testing every pair in all nearby periods: a set of (a, b, shift)."""
    shifts = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    fraction = np.linalg.solve(state.cell, state.position.T).T
    period = np.floor(fraction).astype(int)
    wrapped = (fraction - period) @ state.cell.T
    contacts = set()
    for s in shifts:
        d = wrapped[None, :] + state.cell @ s - wrapped[:, None]
        touching = np.einsum("abi,abi->ab", d, d) <= (state.radius[:, None] + state.radius[None]) ** 2
        for a, b in np.argwhere(touching):
            if a < b:
                contacts.add((int(a), int(b), *(int(x) for x in s - period[b] + period[a])))
    return contacts


def listed(state):
    return {(int(a), int(b), *map(int, s)) for (a, b), s in zip(state.contact_grain, state.contact_shift, strict=True)}


def test_no_contacts_and_one_grain():
    for count in (1, 5):
        position = np.arange(count)[:, None] * np.array([4 * R, 0, 0])
        state = grains_in_cell(Scene(), np.full(count, R), position, np.eye(3) * 30 * R)
        state = state.replace(velocity=np.tile([0.1, 0.2, 0.3], (count, 1)))
        end = after(state, 1000)
        assert len(end.contact_grain) == 0 and np.abs(FusedEngine(end).stress()).max() == 0.0
        np.testing.assert_allclose(end.position - state.position, 1000 * state.time_step * state.velocity, rtol=1e-9)


def test_grains_of_very_different_size():
    rng = np.random.default_rng(5)
    scene = Scene(law="spring_dashpot")
    radius = np.concatenate([[20 * R], np.full(700, R)])
    position = np.concatenate([[[25 * R] * 3], rng.random((700, 3)) * 50 * R])
    far = np.linalg.norm(position - 25 * R, axis=1) > 20.8 * R
    far[0] = True
    state = grains_in_cell(scene, radius[far], position[far], np.eye(3) * 50 * R)
    state = state.replace(velocity=rng.normal(size=(len(state.radius), 3)) * 0.3, time_step=1e-9)
    end = after(state, 500)
    assert listed(end) == all_contacts(end, reach=1)
    assert np.isfinite(end.position).all() and contacts_per_grain(end.snapshot())[0] > 3


@pytest.mark.parametrize("law", LINEAR)
def test_a_cell_hardly_wider_than_two_grains(law):
    """Seven grains in a cell 4.1 R wide, compared with 27 copies in a cell three times as wide."""
    rng = np.random.default_rng(6)
    scene = Scene(law=law)
    width = 4.1 * R
    state = grains_in_cell(scene, rng.uniform(0.8, 1.0, 7) * R, rng.random((7, 3)) * width, np.eye(3) * width)
    state = state.replace(time_step=1e-9, velocity=0.1 * rng.normal(size=(7, 3)))
    gradient = np.array([[100.0, 50.0, 0.0], [0.0, -20.0, 0.0], [0.0, 10.0, -90.0]])
    small, large = FusedEngine(state), FusedEngine(copies(state, (3, 3, 3)))
    for engine in (small, large):
        engine.advance(1500, gradient)
    assert np.abs(small.stress() - large.stress()).max() < 1e-9 * np.abs(small.stress()).max()
    a, b = small.state(), large.state()
    assert len(b.contact_grain) == 27 * len(a.contact_grain) > 0
    np.testing.assert_allclose(a.position, b.position[:7], atol=1e-9 * R)
    pairs = {tuple(pair) for pair in a.contact_grain.tolist()}
    assert listed(a) == all_contacts(a) and len(pairs) <= len(a.contact_grain)


def test_a_pair_that_touches_across_two_sides_has_two_contacts():
    state = after(column(Scene()), 0)
    assert len(state.contact_grain) == 2 and len({tuple(s) for s in state.contact_shift.tolist()}) == 2
    assert identical(state.replace(engine_version=""), FusedEngine(state).state().replace(engine_version=""))


@pytest.mark.parametrize("direction", [1.0, -1.0], ids=["compression", "extension"])
def test_a_strongly_deformed_cell(yade_specimen, direction):
    """At 100 % axial strain the contacts are those that a test of all pairs finds."""
    rate = 1000.0
    state = open_ledger(yade_specimen)
    gradient = prescribed_gradient(ConstantVolume(rate, strain=0.4 * direction), state.time_step)
    engine = FusedEngine(state)
    engine.advance(round(1.0 / rate / state.time_step), gradient)
    end = engine.state()
    assert np.isclose(end.cell[2, 2] / state.cell[2, 2], np.exp(-direction), rtol=1e-3)
    assert listed(end) == all_contacts(end)
    assert abs(balance_error(end)) < 0.02


def test_grains_that_cross_the_boundary_every_few_steps():
    """A collision in a moving frame, in which the grains cross the cell every three steps."""
    cell = np.eye(3) * 6 * R
    slow = pair(ELASTIC, 2.02 * R, velocity=(0.2, 0.0, -1.0), direction=(0.3, 0.1, 1.0), cell=cell, time_step=1e-8)
    common = np.array([2 * R / 1e-8, 0.0, 2 * R / 1e-8])
    fast = slow.replace(velocity=slow.velocity + common)
    a, b = after(slow, 1000), after(fast, 1000)
    crossed = (b.position - a.position) / (6 * R)
    np.testing.assert_allclose(crossed[:, 0], 1000 / 3, rtol=1e-6)
    np.testing.assert_allclose(b.velocity - common, a.velocity, atol=1e-4)
    assert np.linalg.norm(a.velocity[0]) > 0.1
