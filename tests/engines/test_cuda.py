"""The cuda engine in Numba's simulator of a GPU, which runs the kernels as plain Python, against the fused engine."""

import os

import numpy as np
import pytest

from labkit.engines import starter
from labkit.engines.base import reload
from labkit.engines.fused import FusedEngine
from labkit.errors import InputError, PhysicsError
from labkit.grains.laws import LAWS
from labkit.grains.laws.named import SpringDashpot
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell, write_state
from labkit.io.schema import STATE
from labkit.micro.snapshot import love_stress
from labkit.servo.plan import Corrections
from labkit.specimens.specimen import Recipe, prepare_specimen
from tests.engines.simulated_gpu import LOST, Batch, CudaEngine, bits, build, lattice, memory

pytestmark = pytest.mark.slow

TOUCHING = [law for law in LAWS if not LAWS[law]().keeps_links]

SHEAR = np.array([[3e3, 2e3, 0.0], [0.0, 2e3, 0.0], [0.0, 0.0, -6e3]])  # 1/s; the neighbours change every few steps


@pytest.fixture(scope="module")
def specimen():
    """About 100 grains."""
    return prepare_specimen(Scene(law="spring_dashpot"), Recipe(0.67, 0.15, grains=100), starter("fused"))


@pytest.fixture(scope="module")
def small(specimen):
    """The first 60 grains of the specimen in its cell."""
    kept = (specimen.contact_grain < 60).all(axis=1)
    of_grains = {name: getattr(specimen, name)[:60] for name in ("radius", "position", "velocity", "angular_velocity")}
    of_contacts = {name: getattr(specimen, name)[kept] for name in STATE if STATE[name].dimensions[0] == "contact"}
    return specimen.replace(**of_grains, **of_contacts)


def sheared(state, scene):
    """The state with another scene, after steps of fast shear: grains that move, spin and slide."""
    engine = FusedEngine(state.replace(scene=scene))
    engine.advance(20, SHEAR)
    return engine.state()


def require_equal(ours, others, stress, other_stress, tolerance):
    np.testing.assert_array_equal(ours.contact_grain, others.contact_grain)
    np.testing.assert_array_equal(ours.contact_shift, others.contact_shift)
    force, other = (s.snapshot().contacts.force_on_first() for s in (ours, others))
    assert np.abs(force - other).max() < tolerance * np.abs(other).max()
    for name in ("position", "velocity", "angular_velocity", "tangential_force", "rolling_moment", "cell"):
        a, b = getattr(ours, name), getattr(others, name)
        assert np.abs(a - b).max() <= tolerance * np.abs(b).max(), name
    assert np.abs(stress - other_stress).max() < tolerance * np.abs(other_stress).max()
    losses, other_losses = ours.ledger, others.ledger
    for name, value in vars(other_losses).items():
        assert np.isclose(getattr(losses, name), value, rtol=10.0 * tolerance, atol=0.0), name


@pytest.mark.parametrize("law", TOUCHING)
def test_after_one_step_the_forces_are_those_of_fused(law, small):
    state = sheared(small, Scene(law=law, friction=0.3))
    state = state.replace(scene=Scene(law=law, friction=0.25))  # rounding must not decide whether a contact slides
    ours, fused = CudaEngine(state), FusedEngine(state)
    for engine in (ours, fused):
        engine.advance(1, SHEAR)
    end = ours.state()
    assert np.abs(end.tangential_force).max() > 0.0 and end.ledger.friction_loss > 0.0
    assert (end.step, end.time) == (state.step + 1, state.time + state.time_step)
    require_equal(end, fused.state(), ours.stress(), fused.stress(), 1e-12)


@pytest.mark.parametrize("law", ["rolling_resistance", "spring_dashpot"])
def test_in_mixed_precision_forces_are_those_of_fused_within_rounding(law, small):
    """A run that passes a checkpoint has the bits of one resumed from it."""
    state = sheared(small, Scene(law=law, friction=0.3)).replace(scene=Scene(law=law, friction=0.25))
    ours, fused = CudaEngine(state, precision="mixed"), FusedEngine(state, precision="mixed")
    for engine in (ours, fused):
        engine.advance(1, SHEAR)
    end = ours.state()
    require_equal(end, fused.state(), ours.stress(), fused.stress(), 1e-6)
    assert end.precision == "mixed"
    assert np.array_equal(end.tangential_force, end.tangential_force.astype(np.float32))
    resumed = CudaEngine(reload(ours), precision="mixed")
    for engine in (ours, resumed):
        engine.advance(1, SHEAR)
    assert bits(ours.state()) == bits(resumed.state())


SEEN, pair_of_law = set(), SpringDashpot.pair


def watched(contact, t, m, dt, energy, shear, friction, rolling, twisting, dashpots, whole, *history):
    """Compute `pair` of a law, and note the types of the numbers that it gets and returns."""
    response = pair_of_law(contact, t, m, dt, energy, shear, friction, rolling, twisting, dashpots, whole, *history)
    forces = response[: response._fields.index("breaking_loss")]  # a law without cohesion has no further arguments
    for value in (*contact, t, m, dt, shear, friction, rolling, dashpots, *forces):
        SEEN.update(map(type, value if isinstance(value, tuple) else (value,)))
    return response


def test_in_mixed_precision_all_arguments_of_a_law_are_single(small, monkeypatch):
    """A single double would turn most of its arithmetic on the GPU into double precision."""
    monkeypatch.setattr(SpringDashpot, "pair", staticmethod(watched))
    build.kernels_of.cache_clear()
    CudaEngine(small, precision="mixed").advance(1, SHEAR)
    build.kernels_of.cache_clear()
    assert SEEN == {np.float32}


def test_without_friction_the_forces_are_those_of_fused(small):
    state = sheared(small, Scene(friction=0.0, rolling_friction=0.0))
    ours, fused = CudaEngine(state), FusedEngine(state)
    for engine in (ours, fused):
        engine.advance(2, SHEAR)
    require_equal(ours.state(), fused.state(), ours.stress(), fused.stress(), 1e-12)


def test_grains_that_meet_their_own_images_are_found():
    """2 x 2 x 2 grains in a cell of 1.9 diameters: each pair meets across both sides."""
    scene = Scene(law="spring_dashpot")
    radius, spacing = np.full(8, 85e-6), 0.95 * 170e-6
    position = spacing * np.stack(np.meshgrid(*3 * [[0.0, 1.0]]), axis=-1).reshape(-1, 3)
    state = grains_in_cell(scene, radius, position, 2 * spacing * np.eye(3))
    state = state.replace(angular_velocity=np.random.default_rng(1).normal(0.0, 100.0, (8, 3)))
    ours, fused = CudaEngine(state), FusedEngine(state)
    for engine in (ours, fused):
        engine.advance(2, SHEAR)
    assert len(ours.state().contact_grain) == 24
    require_equal(ours.state(), fused.state(), ours.stress(), fused.stress(), 1e-12)
    for engine in (ours, fused):
        engine.stop_grains()
    assert not ours.state().velocity.any() and not ours.state().angular_velocity.any()
    assert np.isclose(ours.state().ledger.damping_loss, fused.state().ledger.damping_loss, rtol=1e-12)


def test_after_50_steps_100_grains_are_those_of_fused(specimen):
    ours, fused = CudaEngine(specimen), FusedEngine(specimen)
    for engine in (ours, fused):
        engine.advance(50, SHEAR)
    end, expected = ours.state(), fused.state()
    assert len(set(map(tuple, end.contact_grain)) - set(map(tuple, specimen.contact_grain))) > 5
    require_equal(end, expected, ours.stress(), fused.stress(), 1e-9)


def test_a_state_in_a_batch_has_the_bits_of_a_single_one(specimen, small):
    """This holds even if another state fails, and if they differ in size, friction, gradient and steps."""
    broken = small.replace(velocity=np.where(np.arange(len(small.radius))[:, None] == 3, np.nan, small.velocity))
    slippery = sheared(small, Scene(law="spring_dashpot", friction=0.1))
    states, steps = [slippery, broken, specimen], np.array([7, 7, 4])
    gradients = np.stack([SHEAR, SHEAR, -2.0 * SHEAR])
    batch = Batch(states)
    batch.advance(steps, gradients)
    assert batch.failures == [None, LOST, None]
    batch.advance(np.array([0, 3, 2]), gradients)
    stresses = batch.stress()
    for i, several in ((0, (7,)), (2, (4, 2))):
        single = CudaEngine(states[i])
        for n in several:
            single.advance(n, gradients[i])
        assert bits(batch.state(i)) == bits(single.state())
        assert np.array_equal(stresses[i], single.stress())
        assert batch.state(i).step == states[i].step + sum(several)
    batch.load(1, small)
    before = bits(batch.state(2))
    batch.begin(1, Corrections.constant(1, gradients[1]))
    batch.launch()
    assert batch.going.any() and bits(batch.state(2)) == before  # while another state is advancing
    batch.look()
    assert not batch.going.any()
    single = CudaEngine(small)
    single.advance(1, SHEAR)
    assert batch.failures == [None, None, None] and bits(batch.state(1)) == bits(single.state())
    with pytest.raises(PhysicsError, match="a grain is lost"):
        CudaEngine(broken).advance(1, SHEAR)


def test_the_skin_changes_no_bit(small, monkeypatch):
    """Lists are sorted, so sums of forces depend neither on which neighbours they hold nor on when they are made."""
    ends = []
    for skin in (0.01, 0.1):
        monkeypatch.setattr("labkit.engines.cuda.batch.SKIN", skin)
        engine = CudaEngine(small)
        engine.advance(4, SHEAR)
        ends.append([getattr(engine.state(), name) for name in STATE])
    for one, other in zip(*ends, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    "scene", [*(Scene(law=law) for law in TOUCHING), Scene(planar=True)], ids=[*TOUCHING, "planar"]
)
def test_the_stiffness_found_on_the_device_is_that_of_the_host(scene):
    state = lattice(2, 1, scene)
    state = state.replace(radius=state.radius * np.linspace(0.999, 1.04, 8))
    engine = CudaEngine(state)
    found, wanted = engine.stress(), love_stress(engine.state().snapshot())
    assert found.any() and np.abs(found - wanted).max() < 1e-12 * np.abs(wanted).max()


def test_states_with_different_laws_are_refused(small):
    other = small.replace(scene=Scene(law="rolling_resistance"))
    with pytest.raises(InputError, match="the contact law of state 1, or its features"):
        Batch([small, other])


@pytest.mark.parametrize("precision", ["double", "mixed"])
def test_the_memory_is_that_of_the_arrays(specimen, precision):
    batch = Batch([specimen], precision)
    arrays = [array for part in (batch._grains, batch._lists, batch._grid) for array in part]
    actual = sum(array.size * array.dtype.itemsize for array in arrays)
    ratio = memory.memory_of(specimen.number_of_grains, precision) / actual
    assert 0.9 < ratio < 1.35  # slices are shorter in the simulator, so there is less padding


def test_a_specimen_that_does_not_fit_is_refused_in_one_line(small, monkeypatch):
    class Full:
        free, total = 1e5, 1e9

        def get_memory_info(self):
            return self

    monkeypatch.setattr(memory.cuda, "current_context", Full)
    many = small.replace(radius=np.full(10**6, 85e-6), position=np.zeros((10**6, 3)))
    with pytest.raises(InputError, match=r"^1,000,000 grains need about 2\.\d GB of the GPU's memory, of which 0\.0 "):
        CudaEngine(many)


def test_without_a_gpu_the_message_is_one_line(small, tmp_path, labkit_process):
    write_state(tmp_path / "s.state.nc", small)
    words = ["run", "cv", tmp_path / "s.state.nc", "--engine", "cuda", "-o", tmp_path / "r.run.nc"]
    done = labkit_process(*words, environment={**os.environ, "NUMBA_DISABLE_CUDA": "1"})
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and "pip install 'labkit[cuda]'" in done.stderr
    assert not (tmp_path / "r.run.nc").exists()


def test_contacts_at_a_distance_are_refused():
    with pytest.raises(InputError, match="contacts across a gap, as in the law jkr: give fused"):
        CudaEngine.abilities.require_scene(Scene(law="jkr"))
