import numpy as np
import pytest

from labkit.engines.yade import YadeEngine
from labkit.errors import InputError, PhysicsError
from labkit.grains.scene import Scene
from labkit.grains.state_file import read_state
from labkit.micro import indicators
from labkit.micro.void_ratio import void_ratio, void_ratio_nominal
from labkit.specimens.recipe import Recipe, side_for
from labkit.specimens.specimen import Equilibrium, insert_grains, settle

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("void_ratio_target", [0.606, 0.67, 0.724, 0.77])
def test_insertion_meets_the_void_ratio_the_side_and_the_sizes_exactly(void_ratio_target):
    state = insert_grains(Scene(), Recipe(void_ratio_target, side=2e-3))
    assert np.isclose(void_ratio_nominal(state.snapshot()), void_ratio_target, rtol=1e-12)
    np.testing.assert_array_equal(state.cell, np.eye(3) * 2e-3)
    assert (np.abs(2 * state.radius / 0.17e-3 - 1) <= 0.2 + 1e-12).all()
    assert ((0 <= state.position) & (state.position < 2e-3)).all()


def test_the_full_cube_holds_as_many_grains_as_in_the_paper():
    assert 13_800 <= insert_grains(Scene(), Recipe(0.724)).number_of_grains
    assert insert_grains(Scene(), Recipe(0.606)).number_of_grains <= 15_000


def test_insertion_depends_only_on_the_seed():
    recipe = Recipe(0.67, side=1.5e-3, seed=4)
    a, b = insert_grains(Scene(), recipe), insert_grains(Scene(), recipe)
    np.testing.assert_array_equal(a.position, b.position)
    np.testing.assert_array_equal(a.radius, b.radius)
    other = insert_grains(Scene(), Recipe(0.67, side=1.5e-3, seed=5))
    assert not np.array_equal(a.position[:10], other.position[:10])


def test_neighbours_in_memory_are_neighbours_in_space():
    state = insert_grains(Scene(), Recipe(0.67, side=3e-3))
    steps = np.linalg.norm(np.diff(state.position, axis=0), axis=1)
    assert np.median(steps) < 3 * 0.17e-3


def test_a_cell_of_too_few_grains_is_refused():
    with pytest.raises(InputError, match=r"grains 3 .*100 to 1e\+06"):
        Recipe(0.67, grains=3)
    with pytest.raises(InputError, match=r"side 0\.0002 m would hold 1\.79 grains: give 0\.000772 to 0\.0163 m"):
        insert_grains(Scene(), Recipe(0.67, side=2e-4))


def test_a_size_is_a_side_or_a_number_of_grains():
    with pytest.raises(InputError, match=r"^side 0\.002 and a number of grains are both given: omit one"):
        Recipe(0.67, side=2e-3, grains=1000)
    scene = Scene()
    assert Recipe(0.67).side_of(scene) == 4e-3 and Recipe(0.67, side="2 mm").side_of(scene) == 2e-3
    assert Recipe(0.67, grains=1100).side_of(scene) == side_for(1100, 0.67, scene)
    assert Recipe(0.67, grains=1100).expected_grains(scene) == 1100
    assert abs(insert_grains(scene, Recipe(0.67, grains=1100)).number_of_grains / 1100 - 1) < 0.02


def test_a_specimen_is_at_rest_with_the_scene_of_table_1_and_its_void_ratio(specimen_file):
    state = read_state(specimen_file)
    snapshot = state.snapshot()
    contacts = snapshot.contacts
    assert state.scene == Scene()
    assert np.isclose(void_ratio_nominal(state.snapshot()), 0.67, rtol=1e-12)
    assert 0.67 < void_ratio(snapshot) < 0.672
    assert indicators.unbalanced_force(snapshot) < 1e-4
    assert not state.velocity.any() and not state.velocity_gradient.any()
    tangential = np.linalg.norm(state.tangential_force, axis=1)
    assert (tangential <= 0.4 * contacts.normal_force * (1 + 1e-9)).all()
    moment = np.linalg.norm(state.rolling_moment, axis=1)
    assert (moment <= 0.05 * state.radius[contacts.grain].min(axis=1) * contacts.normal_force * (1 + 1e-9)).all()
    assert 4.5 < 2 * len(contacts) / state.number_of_grains < 6.0


def test_the_same_command_makes_the_same_specimen(labkit_command, specimen_file, tmp_path):
    again = tmp_path / "again.state.nc"
    done = labkit_command(
        "specimen", "--void-ratio", 0.67, "--grains", 300, "--seed", 3, "--engine", "yade", "-o", again
    )
    assert done.returncode == 0, done.stderr
    a, b = read_state(specimen_file), read_state(again)
    np.testing.assert_array_equal(a.position, b.position)
    np.testing.assert_array_equal(a.tangential_force, b.tangential_force)


def test_grains_that_carry_no_load_are_an_error(labkit_command, tmp_path):
    output = tmp_path / "loose.state.nc"
    done = labkit_command("specimen", "--void-ratio", 1.2, "--step1-friction", 0, "--grains", 150, "-o", output)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("labkit: the grains have separated (coordination number")
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_specimen_that_does_not_come_to_rest_within_the_limit_is_an_error():
    inserted = insert_grains(Scene(), Recipe(0.67, side=1.2e-3)).replace(time_step=1e-8)
    with pytest.raises(PhysicsError, match=r"not at rest after 500 steps.*unbalanced force"):
        settle(YadeEngine(inserted), Equilibrium(1e-4, 1e-5, 250, 500), lambda fraction, text: None)
