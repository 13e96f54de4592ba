"""An engine is a value: its name, or an object with its threads or ranks and its precision."""

import pickle

import pytest

import labkit as lk

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def specimen():
    return lk.make_specimen(lk.Recipe(0.67, grains=150), engine=lk.Fused(), progress=False)


def test_an_object_and_its_name_give_the_same_bits(specimen):
    path = lk.paths.ConstantVolume(strain=1e-3)
    as_object = lk.run(specimen, path, engine=lk.Fused(), progress=False)
    by_name = lk.run(specimen, path, engine="fused", progress=False)
    assert as_object.data.attrs["data_sha256"] == by_name.data.attrs["data_sha256"]


@pytest.mark.parametrize("wrong", ["there_is_none", "", None, 5, lk.Fused, ["fused"], lk.Fused])
def test_anything_but_an_engine_is_refused(specimen, wrong):
    path = lk.paths.ConstantVolume(strain=1e-3)
    for call in (
        lambda: lk.run(specimen, path, engine=wrong),
        lambda: lk.run_many([(specimen, path)], engine=wrong),
        lambda: lk.make_specimen(lk.Recipe(0.67, grains=150), engine=wrong),
        lambda: lk.consolidate(specimen, 1e5, engine=wrong),
        lambda: lk.probe(specimen, engine=wrong),
        lambda: lk.Element(specimen, engine=wrong),
    ):
        with pytest.raises(lk.InputError) as raised:
            call()
        assert raised.value.field == "engine" and "fused" in raised.value.allowed


def test_anything_but_a_servo_is_refused(specimen):
    for wrong in (None, 0.5, lk.Servo):
        with pytest.raises(lk.InputError, match=r"labkit\.Servo\(\)") as raised:
            lk.run(specimen, lk.paths.ConstantVolume(strain=1e-3), servo=wrong)
        assert raised.value.field == "servo"


def test_engines_are_values():
    assert lk.Fused(2, "mixed") == lk.Fused(threads=2, precision="mixed") != lk.Fused(2)
    for engine in (lk.Fused(2, "mixed"), lk.Lammps(2)):
        assert pickle.loads(pickle.dumps(engine)) == engine
