"""A small stratified layer in YADE: forces differ between the strata, normalised forces do not."""

import numpy as np
import pytest

from analysis.__main__ import main
from analysis.stratified.layer import Layer, insert_layer, strata, stratum_of
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.grains.state_file import read_state
from labkit.micro.snapshot import love_stress

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def layer_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("layer")
    file = folder / "layer.state.nc"
    assert main(["stratified", "--width", "20", "--height", "14", "--seed", "1", "-o", str(file)]) == 0
    assert (folder / "layer.png").read_bytes()[:4] == b"\x89PNG"
    assert "upper, coarse" in (folder / "layer.csv").read_text()
    return file


def test_the_layer_reaches_its_stress_ratio_in_its_plane(layer_file):
    state = read_state(layer_file)
    stress = love_stress(state.snapshot())
    assert np.isclose(stress[2, 2] / stress[0, 0], 2.0, rtol=3e-3)
    assert np.isclose(stress[0, 0], 0.1e6, rtol=2e-3) and not stress[1].any() and not stress[:, 1].any()
    assert np.ptp(state.position[:, 1]) == 0.0
    assert not state.tangential_force[:, 1].any() and not state.rolling_moment[:, [0, 2]].any()


def test_mean_force_differs_by_stratum_and_normalised_force_does_not(layer_file):
    coarse, fine = strata(read_state(layer_file))
    assert coarse.mean_force > 1.4 * fine.mean_force
    assert np.isclose(coarse.mean_normalised_force, fine.mean_normalised_force, rtol=0.25)
    assert coarse.strong_by_force > 1.3 * fine.strong_by_force
    assert np.isclose(coarse.strong_by_normalised_force, fine.strong_by_normalised_force, rtol=0.25)


def test_a_disc_has_the_same_stiffness_whatever_its_size_on_yade_too(layer_file):
    """The first test fails if YADE uses another kn: the servo reads the stress from YADE, the state computes it."""
    scene = read_state(layer_file).scene
    assert scene.planar
    stiffness = scene.normal_stiffness(np.array([1e-4, 2e-4]), np.array([1e-4, 4e-4]))
    assert stiffness[0] == stiffness[1] == np.pi / 4 * scene.young_modulus * scene.mean_diameter


def test_strata_fill_their_halves_at_the_plane_void_ratio():
    layer = Layer(width=20.0, height=16.0, size_ratio=3.0)
    state = insert_layer(layer, Scene(planar=True))
    half = state.cell[0, 0] * state.cell[2, 2] / 2
    upper = stratum_of(state) == 1
    for stratum in (upper, ~upper):
        area = np.pi * np.sum(state.radius[stratum] ** 2)
        assert np.isclose(half / area - 1, layer.void_ratio, atol=0.03)
    assert (state.position[upper, 2] >= state.cell[2, 2] / 2).all()
    assert np.isclose(state.radius[upper].mean() / state.radius[~upper].mean(), 3.0, rtol=0.03)


def test_discs_that_fill_a_stratum_keep_the_mean_diameter_whatever_its_spread():
    scene = Scene(planar=True, diameter_spread=0.5)
    state = insert_layer(Layer(width=40.0, height=40.0), scene)
    lower = state.position[:, 2] < state.cell[2, 2] / 2
    assert np.isclose(2 * state.radius[lower].mean(), scene.mean_diameter, rtol=0.03)


@pytest.mark.parametrize("name", ["size_ratio", "width", "pressure", "ratio"])
def test_values_out_of_range_are_refused(name):
    with pytest.raises(InputError) as refused:
        Layer(**{name: -1.0})
    assert (refused.value.field, refused.value.value) == (name, -1.0)
