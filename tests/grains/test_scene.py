import copy
import dataclasses
import json
import pickle

import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.grains.laws import LAWS, ContactLaw, Coulomb, HertzSpring
from labkit.grains.laws.parts import PARAMETERS
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
from labkit.grains.state_file import write_state
from labkit.parameters import parameters_of
from labkit.results.info import describe_file


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


@pytest.mark.parametrize("text", ["", "[]", "{", '{"colour": 1}', "null"])
def test_text_that_is_not_a_scene_is_refused(text):
    with pytest.raises(InputError, match="not a labkit scene"):
        Scene.from_json(text)


@pytest.mark.parametrize(
    ("law", "name", "value"),
    [
        ("hertz_mindlin", "rolling_friction", 0.15),
        ("hertz_mindlin", "stiffness_ratio", 3.0),
        ("hertz_mindlin_dashpot", "local_damping", 0.3),
        ("rolling_resistance", "beta_n", 0.3),
        ("spring_dashpot", "poisson_ratio", 0.2),
        ("spring_dashpot", "rolling_limit_scale", 1.064),
    ],
)
def test_a_parameter_that_the_law_does_not_use_is_refused(law, name, value):
    with pytest.raises(
        InputError, match=rf"^{name} {value:g} is not used by the contact law {law}: give none, or a law"
    ):
        Scene(law=law, **{name: value})
    with pytest.raises(InputError, match=f"^{name} "):
        Scene(law=law).replace(**{name: value})
    assert name not in LAWS[law]().parameters


def test_a_resistance_of_zero_and_values_in_files_are_accepted():
    assert Scene(law="hertz_mindlin", rolling_friction=0.0, beta_n=0.0).law == "hertz_mindlin"
    old = Scene.from_json('{"law": "hertz_mindlin", "rolling_friction": 0.15, "young_modulus": 5e9}')
    assert (old.rolling_friction, old.young_modulus) == (Scene.rolling_friction, 5e9)
    assert Scene(rolling_friction=0.3).replace(law="hertz_mindlin").rolling_friction == Scene.rolling_friction
    assert Scene(law="hertz_mindlin").with_friction(0.2, 0.3) == Scene(law="hertz_mindlin", friction=0.2)


def test_a_part_of_a_user_may_use_any_parameter_of_its_kind():
    class Own(HertzSpring):
        pass

    class Sticky(ContactLaw):
        name, parts = "sticky", Own() + Coulomb()

    assert "beta_n" in Sticky().parameters
    assert not {"rolling_friction", "twisting_friction", "limits"} & Sticky().parameters.keys()


def test_a_parameter_of_a_user_belongs_to_the_law_of_a_scene(monkeypatch):
    """Neither a part, nor its law, nor the file in which they are changes a class of labkit."""
    monkeypatch.setenv("LABKIT_USE", "")
    before = dict(vars(Scene)), dict(PARAMETERS), parameters_of(Scene)
    lk.use("examples/van_der_waals.py")
    assert before == (dict(vars(Scene)), dict(PARAMETERS), parameters_of(Scene))
    scene = Scene(law="van_der_waals", hamaker="2e-13 J")
    assert scene.hamaker == 2e-13 != Scene(law="van_der_waals").hamaker and scene != Scene(law="van_der_waals")
    for same in (
        Scene.from_json(scene.to_json()),
        pickle.loads(pickle.dumps(scene)),
        copy.deepcopy(scene),
        dataclasses.replace(scene),
        scene.replace(friction=scene.friction),
    ):
        assert same == scene and hash(same) == hash(scene) and same.hamaker == 2e-13
    assert json.loads(scene.to_json())["hamaker"] == scene.identity()["hamaker"] == 2e-13
    assert scene.replace(hamaker=1e-13).hamaker == dataclasses.replace(scene, hamaker=1e-13).hamaker == 1e-13
    assert scene.replace(law="hertz_mindlin") == Scene(law="hertz_mindlin")
    with pytest.raises(InputError, match=r"^hamaker -1 is not valid: give 0 to 1 J"):
        Scene(law="van_der_waals", hamaker=-1)
    with pytest.raises(InputError, match=r"^hamaker 1e-13 is not used by the contact law jkr: give none, or .*waals"):
        Scene(law="jkr", hamaker=1e-13)
    with pytest.raises(TypeError, match="unexpected keyword argument 'hammaker'"):
        Scene(law="van_der_waals", hammaker=1e-13)
    with pytest.raises(AttributeError, match="hamaker"):
        Scene().hamaker  # noqa: B018


def test_info_leaves_out_what_the_law_does_not_use(tmp_path):
    scene = Scene(law="hertz_mindlin", young_modulus=5e9)
    file = tmp_path / "s.state.nc"
    write_state(file, grains_in_cell(scene, np.full(2, 1e-4), np.array([[0.0] * 3, [3e-4] * 3]), np.eye(3) * 1e-3))
    text = describe_file(file)
    assert "poisson_ratio" in text and "cell width/largest grain 5" in text
    assert "rolling_friction" not in text and "beta_n" not in text


def test_only_the_soil_of_the_paper_has_its_strength():
    assert Scene().of_the_paper and Scene(law="spring_dashpot", density=2600.0).of_the_paper
    others = {"friction": 0.5}, {"mean_diameter": "0.2 mm"}, {"law": "hertz_mindlin"}, {"diameter_spread": 0.3}
    assert not any(Scene(**changes).of_the_paper for changes in others)
