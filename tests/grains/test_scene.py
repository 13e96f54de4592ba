import dataclasses

import numpy as np
import pytest

from labkit.errors import InputError
from labkit.grains.scene import Scene


def test_table_1_and_the_contact_law_below_equation_3():
    scene = Scene()
    R = 85e-6
    assert np.isclose(scene.normal_stiffness(R, R), np.pi / 2 * 0.15e9 * R)  # D* = D/2 = R
    assert np.isclose(scene.tangential_stiffness(R, R) * 2, scene.normal_stiffness(R, R))
    assert np.isclose(scene.mass(R), 2650 * np.pi / 6 * (2 * R) ** 3)
    assert np.isclose(scene.moment_of_inertia(R), 0.4 * scene.mass(R) * R**2)
    assert np.isclose(scene.time_step, 0.2 * np.sqrt(scene.mass(R) / scene.normal_stiffness(R, R)))


def test_a_scene_is_a_value_and_survives_json():
    scene = Scene(friction=0.3)
    assert Scene.from_json(scene.to_json()) == scene
    with pytest.raises(dataclasses.FrozenInstanceError):
        scene.friction = 0.1


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("friction", -0.1),
        ("friction", float("nan")),
        ("density", 0.0),
        ("local_damping", 1.0),
        ("law", "hertz"),
        ("young_modulus", "stiff"),
        ("diameter_spread", 1.0),
    ],
)
def test_values_out_of_range_are_refused(field, value):
    with pytest.raises(InputError, match=field.split("_")[0]):
        Scene(**{field: value})


@pytest.mark.parametrize("text", ["", "[]", "{", '{"colour": 1}', "null"])
def test_text_that_is_not_a_scene_is_refused(text):
    with pytest.raises(InputError, match="not a labkit scene"):
        Scene.from_json(text)


@pytest.mark.parametrize(("earlier", "name"), [("yade", "rolling_resistance"), ("paper", "spring_dashpot")])
def test_laws_keep_their_names_of_version_0_1_0(earlier, name):
    scene = Scene(law=earlier)
    assert scene.law == name and scene == Scene(law=name) and scene.contact_law.name == name
    assert Scene.from_json(scene.to_json().replace(name, earlier)) == scene
