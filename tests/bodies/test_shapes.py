"""Shapes of clumps: volume and inertia with overlaps counted once, against closed forms."""

import dataclasses

import numpy as np
import pytest

from labkit.bodies.clumps import rotation_matrices
from labkit.bodies.shapes import SHAPES, Rod, Shape, Tetrapod, measure_shape, moments, read_shape, register_shape
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
from labkit.grains.state_file import read_state, write_state
from labkit.micro.void_ratio import lens_volume
from labkit.specimens.recipe import Recipe
from tests.bodies.clumped import clumped


class Lump(Shape):
    name = "lump"
    centers = ((0, 0, 0), (1.0, 0, 0), (0.3, 0.8, 0.2))
    radii = (1, 0.7, 0.6)


def spheres(grains=4, seed=1):
    position = np.random.default_rng(seed).random((grains, 3)) * 2e-3
    return grains_in_cell(Scene(), np.full(grains, 8.5e-5), position, np.eye(3) * 2e-3)


@pytest.mark.parametrize("distance", [0.3, 1.0, 1.7])
def test_two_spheres_have_volume_and_moments_of_the_closed_form(distance):
    a, b, d = 1.0, 0.8, distance
    volume, first, second = moments(np.array([[0.0, 0, 0], [0.0, 0, d]]), np.array([a, b]))
    z = np.polynomial.Polynomial([0.0, 1.0])
    plane = (d * d + a * a - b * b) / (2 * d)  # plane of the circle in which the spheres meet
    lower, upper = np.pi * (a * a - z**2), np.pi * (b * b - (z - d) ** 2)  # sections of the two spheres

    def integral(power):
        parts = (lower * z**power).integ(), (upper * z**power).integ()
        return parts[0](plane) - parts[0](-a) + parts[1](d + b) - parts[1](plane)

    assert integral(0) == pytest.approx(4 / 3 * np.pi * (a**3 + b**3) - lens_volume(a, b, a + b - d))
    assert volume == pytest.approx(integral(0), rel=1e-5)
    assert first == pytest.approx([0, 0, integral(1)], rel=1e-5, abs=1e-9)
    assert second[2, 2] == pytest.approx(integral(2), rel=1e-5)


@pytest.mark.parametrize("shape", [Rod(2.0, 2), Rod(1.5), Tetrapod(), Lump()], ids=lambda shape: shape.name)
def test_a_clump_has_the_volume_of_its_sphere_and_its_centre_at_the_origin(shape):
    made = measure_shape(shape)
    volume, first, second = moments(made.arm, made.radius)
    assert volume == pytest.approx(4 / 3 * np.pi, rel=1e-4)
    assert np.abs(first).max() < 1e-4
    inertia = np.trace(second) * np.eye(3) - second
    assert inertia == pytest.approx(np.diag(made.inertia), abs=2e-4)
    assert (np.diff(made.inertia) >= 0.0).all()  # the long axis comes first


def test_a_sphere_has_exact_properties_and_a_rod_of_length_one_is_a_sphere():
    assert measure_shape(read_shape("sphere")).inertia == pytest.approx(8 / 15 * np.pi, rel=1e-15)
    assert measure_shape(Rod(1.0)).inertia == pytest.approx(8 / 15 * np.pi, rel=1e-4)


def test_shapes_are_read_from_text_and_from_a_user(monkeypatch):
    monkeypatch.setattr(SHAPES, "_entries", dict(SHAPES._entries))
    register_shape(Lump)
    assert isinstance(read_shape("lump"), Lump)
    assert read_shape("rod aspect_ratio=1.8 members=4") == Rod(1.8, 4)
    for text, said in (("rot", "rod"), ("rod ratio=2", "aspect_ratio"), ("lump size=2", "lump alone")):
        with pytest.raises(InputError, match=said):
            read_shape(text)


def test_spheres_that_do_not_touch_are_no_clump():
    class Apart(Shape):
        name, centers, radii = "apart", ((0, 0, 0), (3, 0, 0)), (1, 1)

    with pytest.raises(InputError, match="touch"):
        measure_shape(Apart())
    with pytest.raises(InputError, match="members"):
        Rod(1.5, 9)


def test_clumps_keep_volume_centres_and_members_and_survive_a_file(tmp_path):
    start = spheres()
    state = clumped(start, [Rod(1.5), Lump()], seed=3)
    clumps = state.clumps
    assert np.bincount(clumps.body).tolist() == [3, 3, 3, 3]
    assert state.body_radius == pytest.approx(start.radius, rel=1e-15)
    assert clumps.body_position == pytest.approx(start.position)
    assert state.position == pytest.approx(
        start.position[clumps.body]
        + np.einsum("gij,gj->gi", rotation_matrices(clumps.orientation)[clumps.body], clumps.arm)
    )
    write_state(tmp_path / "s.state.nc", state)
    again = read_state(tmp_path / "s.state.nc")
    for name, values in state.arrays.items():
        assert np.array_equal(again.arrays[name], values), name
    assert again.digest() == state.digest() != start.digest()
    wrong = state.replace(clumps=dataclasses.replace(clumps, body=clumps.body[::-1].copy()))
    with pytest.raises(InputError, match="does not list the spheres"):
        write_state(tmp_path / "w.state.nc", wrong)


def test_the_first_of_several_wrong_parameters_is_named_in_every_process():
    """A set has another order in each process."""
    with pytest.raises(InputError, match="'a'"):
        read_shape("rod " + " ".join(f"{name}=1" for name in "fbdace"))


@pytest.mark.parametrize("text", ["sphere ", " sphere", "sphere, sphere"])
def test_spheres_are_spheres_however_they_are_written(text):
    assert Recipe(0.67, shape=text) == Recipe(0.67)
