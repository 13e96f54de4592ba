"""An engine is a value: its name, or an object with its threads or ranks and its precision."""

import pickle

import pytest

import labkit as lk

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def specimen():
    return lk.make_specimen(lk.Recipe(0.67, grains=150), engine=lk.Fused(), progress=False)


def test_an_object_and_a_name_with_arguments_give_the_same_bits(specimen):
    path = lk.paths.ConstantVolume(strain=1e-3)
    as_object = lk.run(specimen, path, engine=lk.Fused(precision="mixed"), progress=False)
    by_name = lk.run(specimen, path, engine="fused", precision="mixed", progress=False)
    assert as_object.data.attrs["data_sha256"] == by_name.data.attrs["data_sha256"]


@pytest.mark.parametrize(
    "wrong, field",
    [
        ({"engine": lk.Fused(2), "threads": 3}, "threads"),
        ({"engine": lk.Yade(), "precision": "mixed"}, "precision"),
        ({"engine": lk.Lammps(2), "ranks": 2}, "ranks"),
        ({"engine": "fused", "ranks": 2}, "ranks"),
        ({"engine": "lammps", "threads": 2}, "threads"),
        ({"engine": "there_is_none"}, "engine"),
    ],
)
def test_what_does_not_fit_an_engine_is_refused(specimen, wrong, field):
    with pytest.raises(lk.InputError) as raised:
        lk.run(specimen, lk.paths.ConstantVolume(strain=1e-3), **wrong)
    assert raised.value.field == field


def test_engines_are_values():
    assert lk.Fused(2, "mixed") == lk.Fused(threads=2, precision="mixed") != lk.Fused(2)
    for engine in (lk.Fused(2, "mixed"), lk.Lammps(2)):
        assert pickle.loads(pickle.dumps(engine)) == engine
