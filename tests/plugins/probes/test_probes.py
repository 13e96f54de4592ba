"""Probes of grains: the same start for each, the elastic stiffness, response envelopes, files; on both engines."""

import dataclasses

import numpy as np
import pandas
import pytest

import labkit as lk
from labkit.cli import main
from labkit.errors import InputError
from labkit.micro.tensors import to_six
from labkit.paths.probes import StrainProbe
from labkit.plugins.probes.grains import affine_stiffness, at_rest, path_maker, probes_of, without_sliding
from labkit.plugins.probes.probing import PLANES, Probing, plane_of
from tests.simulation.linear_response import elastic_stiffness

pytestmark = pytest.mark.slow

SHORT = 10.0  # duration of elastic probes, sufficient because they are linear
ELASTIC = Probing(plane="all", duration=SHORT)


@pytest.fixture(scope="module")
def sheared(run_file):
    """About 300 grains at rest after 2 % shear at constant volume, with the rolling-resistance law."""
    return at_rest(lk.read_state(run_file))


@pytest.fixture(scope="module")
def states(specimen_file, sheared):
    """An isotropic specimen with the spring-dashpot law, and the sheared one."""
    state = lk.read_state(specimen_file)
    isotropic = at_rest(state.replace(scene=dataclasses.replace(state.scene, law="spring_dashpot")))
    return {"isotropic": isotropic, "sheared": sheared}


@pytest.fixture(scope="module")
def elastic(states):
    """Elastic probes along the six components of strain."""
    return {name: probes_of(state, ELASTIC, True, progress=False) for name, state in states.items()}


@pytest.fixture(scope="module")
def envelope(sheared):
    """24 strain probes of the sheared specimen."""
    return probes_of(sheared, Probing(duration=SHORT), progress=False)


@pytest.mark.parametrize("name", ["isotropic", "sheared"])
def test_the_elastic_stiffness_is_symmetric_and_below_the_affine_bound(name, states, elastic):
    probes = elastic[name]
    assert "asymmetry" in probes._repr_html_()
    C = probes.tangent()
    assert probes.asymmetry() < 1e-3 and probes.misfit() < 2e-4  # 1.1e-4 at most, with functions shipped or compiled
    assert np.linalg.eigvalsh(affine_stiffness(states[name].snapshot()) - 0.5 * (C + C.T)).min() > 0.0
    assert (probes.directional() < probes.affine_bound()).all() and np.linalg.eigvalsh(C + C.T).min() > 0.0


@pytest.mark.parametrize(("name", "tolerance"), [("isotropic", 1e-3), ("sheared", 3e-3)])
def test_the_elastic_stiffness_is_that_of_the_springs(name, tolerance, states, elastic):
    """YADE's law multiplies shear velocities by (Ra + Rb)/distance, by which it differs a little from plain springs."""
    expected = elastic_stiffness(states[name])
    assert np.linalg.norm(elastic[name].tangent() - expected) < tolerance * np.linalg.norm(expected)


@pytest.mark.parametrize("name", ["isotropic", "sheared"])
def test_elastic_probes_dissipate_nothing_by_sliding(name, elastic):
    data, work = elastic[name].data, elastic[name].second_order_work()
    assert (data["sliding_loss"] == 0.0).all()
    assert (data["contacts_gained"] == 0.0).all() and (data["contacts_lost"] == 0.0).all()
    assert (np.abs(data["damping_loss"].values) < 0.01 * work).all()  # due to moving grains; falls with the duration


def test_the_shear_modulus_is_half_of_the_mandel_component(elastic, envelope):
    probes = elastic["isotropic"]
    row = probes.of("elastic")
    assert [row.shear_modulus(one) for one in ("yz", "xz", "xy")] == pytest.approx(0.5 * np.diag(row.tangent())[3:])
    xz = np.argmax(np.abs(probes.strain[:, 4]))  # the probe in this direction
    stress, strain = (probes.data[name].values[xz, 0, 2] for name in ("stress_increment", "strain_increment"))
    assert probes.shear_modulus() == pytest.approx(stress / (2.0 * strain), rel=2e-3)
    with pytest.raises(InputError, match=r"^plane \w+ has no shear xz: give probes of the plane xz-shear, or all"):
        envelope.shear_modulus()


def test_24_directions_start_from_the_same_bits(envelope):
    assert envelope.data.sizes["probe"] == 24
    assert len(set(envelope.data["start_sha256"].values.tolist())) == 1
    assert (envelope.data["start_stress"].values == envelope.data["start_stress"].values[0]).all()


def test_a_start_that_differs_in_the_last_bit_is_noticed_and_a_repetition_agrees_to_it(sheared):
    position = sheared.position.copy()
    position[0, 0] = np.nextafter(position[0, 0], np.inf)
    once, again, moved = (
        probes_of(state, Probing(directions=2, duration=5.0), True, progress=False)
        for state in (sheared, sheared, sheared.replace(position=position))
    )
    for name in once.data.data_vars:
        assert np.array_equal(once.data[name].values, again.data[name].values), name
    assert not set(once.data["start_sha256"].values.tolist()) & set(moved.data["start_sha256"].values.tolist())


def test_sliding_softens_continued_shear_and_hardly_unloading(envelope, elastic):
    axes, C = envelope.plane.axes, elastic["sheared"].tangent()
    angle = envelope.data["angle"].values
    strain = envelope.strain
    ratio = envelope.second_order_work() / np.einsum("na,ab,nb->n", strain, C, strain)
    shear = np.degrees(np.arctan2(*(axes @ [-0.5, -0.5, 1.0, 0.0, 0.0, 0.0])[::-1]))  # direction of the run's shear
    along = ratio[np.abs(angle - shear).argmin()]
    against = ratio[np.abs(angle - shear - 180.0).argmin()]
    assert along < 0.3 and 0.85 < against < 1.02
    assert (envelope.data["sliding_loss"].values > 0.0).all()
    assert (envelope.directional() < envelope.affine_bound()).all()


def test_stress_probes_give_the_inverse_of_strain_probes(states, elastic):
    probing = Probing(plane="all", kind="stress", duration=SHORT)
    probes = probes_of(states["isotropic"], probing, True, progress=False)
    pressure = lk.mean_stress(probes.data["start_stress"].values[0])
    reached = to_six(probes.data["stress_increment"].values) / (probing.size(True) * pressure)
    np.testing.assert_allclose(reached, np.concatenate([np.eye(6), -np.eye(6)]), atol=1e-4)
    np.testing.assert_allclose(probes.tangent() @ elastic["isotropic"].tangent(), np.eye(6), atol=2e-3)
    assert probes.asymmetry() < 1e-3


@pytest.mark.yade
def test_yade_gives_the_same_probes(sheared):
    probing = Probing(directions=2, duration=SHORT, amplitude=1e-5)
    fused, yade = (probes_of(sheared, probing, engine=engine, progress=False) for engine in ("fused", "yade"))
    difference = np.linalg.norm(yade.stress - fused.stress, axis=1)
    assert (difference < 1e-5 * np.linalg.norm(fused.stress, axis=1)).all()
    assert len(set(yade.data["start_sha256"].values.tolist())) == 1


def test_the_increment_is_applied_in_full_and_smoothly():
    path = StrainProbe(0.1, 3e-4, (1e-4, 0.0, -2e-4, 0.0, 3e-5, 0.0))
    accumulated_strain = (np.arange(3000) + 0.5) * 1e-7
    flow = np.array([path.flow(t) for t in accumulated_strain])
    np.testing.assert_allclose(to_six(flow.sum(axis=0) * 1e-7), path.increment, rtol=1e-9, atol=1e-18)
    assert np.abs(flow[0]).max() < 1e-5 * np.abs(flow).max() and not flow[2000:].any()


def test_a_large_strain_probe_takes_longer_to_stay_quasi_static(sheared):
    number = []
    for amplitude in (1e-4, 1e-2):
        rate = path_maker(sheared, Probing(amplitude=amplitude), False)(np.eye(6)[2]).rate
        pressure = lk.mean_stress(lk.love_stress(sheared.snapshot()))
        number.append(2.0 * rate * 2.0 * sheared.radius.mean() * np.sqrt(sheared.scene.density / pressure))
    assert number[0] < number[1] == pytest.approx(3e-5)


def test_only_springs_that_exist_are_kept_from_sliding():
    scene = without_sliding(lk.Scene(friction=0.3, rolling_friction=0.0))
    assert (scene.friction, scene.rolling_friction, scene.twisting_friction) == (10.0, 0.0, 0.0)


def test_no_contact_twists_in_an_elastic_probe():
    scene = lk.Scene(twisting_friction=0.001)
    state = lk.make_specimen(lk.Recipe(void_ratio=0.62, grains=100), scene, progress=False)
    probes = probes_of(state, Probing(directions=2, duration=5.0, amplitude=1e-5), True, progress=False)
    assert (probes.data["sliding_loss"] == 0.0).all()


@pytest.mark.parametrize("kind", ["strain", "stress"])
def test_two_directions_do_not_determine_a_stiffness(kind, sheared):
    probes = probes_of(sheared, Probing(directions=2, duration=5.0, kind=kind), True, progress=False)
    (row,) = probes.summary().to_dict("records")
    assert np.isnan(row["asymmetry"]) and np.isnan(row["misfit"]) and row["least"] > 0.0


# --- planes, files, the command line ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PLANES)
def test_the_axes_of_a_plane_are_orthonormal(name):
    plane = plane_of(name)
    np.testing.assert_allclose(plane.axes @ plane.axes.T, np.eye(len(plane.axes)), atol=1e-15)
    angle, directions = plane.directions(24)
    assert len(angle) == len(directions) and len(plane.labels) == len(plane.axes)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-15)
    np.testing.assert_allclose(directions.sum(axis=0), 0.0, atol=1e-14)  # in opposite pairs


def test_any_two_tensors_span_a_plane():
    plane = plane_of("1,0,0,0,0,0,1,0,0,0,1,0")
    np.testing.assert_allclose(plane.axes, np.eye(6)[[0, 4]], atol=1e-15)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"plane": "rendulic"}, "plane 'rendulic'"),
        ({"plane": "1,1,1,0,0,0,2,2,2,0,0,0"}, "give two tensors that are not parallel"),
        ({"directions": 1}, "directions 1 "),
        ({"kind": "force"}, "kind 'force'"),
        ({"amplitude": 0.0}, "amplitude 0 "),
    ],
)
def test_settings_that_are_not_valid_are_refused(values, message):
    with pytest.raises(InputError) as refused:
        Probing(**values)
    assert message in str(refused.value)


def test_grains_without_load_and_mixtures_are_refused(sheared, elastic, envelope):
    loose = sheared.replace(
        contact_grain=np.zeros((0, 2), np.int32),
        contact_shift=np.zeros((0, 3), np.int32),
        tangential_force=np.zeros((0, 3)),
        rolling_moment=np.zeros((0, 3)),
    )
    with pytest.raises(InputError, match="carries no load"):
        path_maker(loose, Probing(), False)
    with pytest.raises(InputError, match="different planes"):
        _ = elastic["sheared"] + envelope
    with pytest.raises(InputError, match="no envelope: give probes in a plane"):
        elastic["sheared"].plot()
    with pytest.raises(InputError, match="model was not probed: give grains"):
        envelope.of("model")


def test_a_file_holds_everything(envelope, tmp_path):
    envelope.write(tmp_path / "e.probes.nc")
    again = lk.read_probes(tmp_path / "e.probes.nc")
    for name, values in envelope.data.data_vars.items():
        numbers = values.dtype.kind == "f"
        assert np.array_equal(again.data[name].values, values.values, equal_nan=numbers), name
    row = again.summary().iloc[0]
    assert (row["least"], row["largest"]) == (envelope.directional().min(), envelope.directional().max())
    assert again.data.attrs["engine"] == "fused" and again.plane.name == "axisymmetric"
    np.testing.assert_array_equal(again.tangent(), envelope.tangent())


def test_one_command_probes_grains_elastic_grains_and_model(run_file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    common = ["probe", str(run_file), "--directions", "2", "--duration", "5", "--engine", "fused", "-o", "e.probes.nc"]
    assert main([*common, "--elastic", "--model"]) == 0
    assert "Probes(6 strain probes, plane axisymmetric, grains, elastic, model)" in capsys.readouterr().out
    assert main(["figure", "envelope", "e.probes.nc", "--csv", "e.csv"]) == 0
    assert (tmp_path / "e.envelope.png").read_bytes()[:4] == b"\x89PNG"
    table = pandas.read_csv("e.csv")
    assert list(table["material"]) == ["grains"] * 2 + ["elastic"] * 2 + ["model"] * 2
    assert list(table["angle"]) == [0.0, 180.0] * 3 and table["start_sha256"][:4].nunique() == 1
    assert main(["info", "e.probes.nc", "--check"]) == 0 and "differs" not in capsys.readouterr().out
    assert main(["figure", "envelope", str(run_file)]) == 2 and "probes file" in capsys.readouterr().err
    for words in (["--parameters", "p.json"], ["--beyond-e-cmax", "flat"]):  # without --model
        assert main([*common, *words]) == 2 and words[0] in capsys.readouterr().err
    shear = ["--plane", "xz-shear", "--directions", "4", "--elastic"]
    assert main([*common[:-1], "g.probes.nc", *shear]) == 0
    modulus = lk.read_probes("g.probes.nc").of("elastic").shear_modulus()
    assert f"shear modulus G = {modulus / 1e6:.4g} MPa" in capsys.readouterr().out
    assert main([*common[:-1], "s.state.nc", "--plane", "flat"]) == 2 and "--plane 'flat'" in capsys.readouterr().err


def test_the_model_is_probed_with_the_young_modulus_of_the_grains(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recipe = lk.Recipe(void_ratio=0.62, grains=100)
    lk.write_state("s.state.nc", lk.make_specimen(recipe, lk.Scene(young_modulus="5 GPa"), progress=False))
    words = ["--directions", "2", "--duration", "5", "--model"]
    assert main(["probe", "s.state.nc", *words, "-o", "e.probes.nc"]) == 0
    probes = lk.read_probes("e.probes.nc")
    grains, model = (lk.mean_stress(probes.of(name).data["start_stress"].values[0]) for name in ("grains", "model"))
    assert model == pytest.approx(grains, rel=0.05)  # C0 against Love's stress
