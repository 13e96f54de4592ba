"""labkit model: a run file that the commands for simulations read, and invalid input."""

import json

import netCDF4
import numpy as np
import pytest

import labkit
from labkit.cli import main
from labkit.files.provenance import write_with_provenance
from labkit.files.schema import BY_VOLUME, RECORD
from labkit.model.controls import model_path
from labkit.model.driver import drive
from labkit.model.parameters import Model
from labkit.model.run_file import as_run, model_of, read_model, records_of_result
from labkit.model.state import isotropic_state

pytestmark = pytest.mark.slow

START = ("--void-ratio", 0.67, "--pressure", 0.5e6)


@pytest.fixture
def refused(capsys):
    """A function that runs a command in this process and returns its one line on stderr; it must exit with 2."""

    def run(*arguments):
        assert main([str(argument) for argument in arguments]) == 2
        lines = capsys.readouterr().err.strip().splitlines()
        assert len(lines) == 1
        return lines[0]

    return run


@pytest.fixture(scope="module")
def model_run(labkit_command, tmp_path_factory):
    file = tmp_path_factory.mktemp("model") / "m.run.nc"
    done = labkit_command("model", "cv", *START, "--strain", 0.6, "-o", file)
    assert done.returncode == 0, done.stderr
    assert "q/p 0.927" in done.stdout
    return file


def test_the_file_has_the_variables_of_a_simulation(model_run, run_file):
    found, simulated = labkit.open_run(model_run), labkit.open_run(run_file)
    assert set(found.variables) == set(simulated.variables) - set(BY_VOLUME)  # a model has no contacts
    for name in RECORD:
        assert found[name].dims == simulated[name].dims and found[name].attrs == simulated[name].attrs
    assert found.attrs["engine"] == "model" and found.attrs["complete"] == 1
    assert found.attrs["path"] == "cv" and json.loads(found.attrs["path_parameters"])["strain"] == 0.6
    assert model_of(found) == Model() and model_of(simulated) is None
    assert "labkit model cv" in found.attrs["history"]


def test_the_file_holds_the_result(model_run):
    run = labkit.open_run(model_run)
    result = drive(Model(), model_path("cv", 0.5e6, strain=0.6), isotropic_state(Model(), 0.67, 0.5e6))
    for name, values in records_of_result(result).items():
        np.testing.assert_allclose(run[name].values, values, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(run["stress"], run["stress_sff"])
    np.testing.assert_allclose(run["volume"], 1.0, rtol=1e-12)
    np.testing.assert_allclose(np.log(np.linalg.det(run["cell"].values)), 0.0, atol=1e-12)
    assert np.isnan(run["kinetic_energy"]).all()
    p, q = run.lab.mean_stress().values, run.lab.deviatoric_stress().values
    assert abs(q[-1] / p[-1] - 0.93) < 0.005
    in_memory = as_run(result)
    np.testing.assert_array_equal(in_memory.lab.mean_stress(), result.p)


def test_other_commands_read_it(model_run, labkit_command, refused, tmp_path):
    critical = labkit_command("critical", model_run, "-o", tmp_path / "c.png")
    assert critical.returncode == 0 and " 0.927 (" in critical.stdout
    assert main(["figure", "shares", str(model_run), "-o", str(tmp_path / "s.png")]) == 0
    assert "holds no contacts" in refused("figure", "groups", model_run, "-o", tmp_path / "g.png")
    info = labkit_command("info", model_run)
    assert info.returncode == 0 and "e_cmax" in info.stdout
    assert "(engine = model)" in refused("verify", model_run)


def test_a_condition_that_is_never_met_is_named(capsys, tmp_path):
    start = ["--void-ratio", "0.7", "--pressure", "100kPa", "--strain", "0.002", "-o", str(tmp_path / "m.run.nc")]
    assert main(["model", "cv", *start, "--stop-when", "q/p > 5"]) == 0
    assert "m.run.nc: q/p > 5 was never met" in capsys.readouterr().out


def test_a_path_that_fails_keeps_its_records(capsys, tmp_path):
    file = tmp_path / "broken.run.nc"
    assert main(["model", "isod", "--void-ratio", "0.755", "--pressure", "0.5e6", "-o", str(file)]) == 1
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and "e_cmax" in lines[0]
    run = labkit.open_run(file)
    assert run.attrs["complete"] == 0 and "e_cmax" in run.attrs["ended_because"]
    assert abs(float(run["void_ratio"][-1]) - 0.76) < 1e-6


@pytest.mark.parametrize(
    "arguments, hint",
    [
        (("cv", "--void-ratio", 0.77, "--pressure", 0.5e6), "flat"),
        (("cv", "--void-ratio", -1, "--pressure", 0.5e6), "--void-ratio"),
        (("cv", "--void-ratio", 0.67, "--pressure", 0), "--pressure"),
        (("cv", "--void-ratio", 0.67), "--pressure"),
        ((*("cv", *START), "--coordination-number", -1), "--coordination-number"),
        ((*("cv", *START), "--coordination-number", 5, "--mean-normalised-force", 0.1), "not both"),
        ((*("cv", *START), "--tolerance", 0), "--tolerance"),
        ((*("cv", *START), "--strain", -3), "--strain"),
        ((*("cv", *START), "--reversals", "0.1"), "--reversals"),
        ((*("oedometer", *START), "--reversals", "0.1"), "--reversals"),
        ((*("cv", *START), "--stop-pressure", 1e6), "--stop-pressure"),
        ((*("isoc", *START), "--stop-pressure", 1e5), "--stop-pressure"),
        ((*("cr", *START), "--inherent-anisotropy", 5), "--inherent-anisotropy"),
        ((*("cv", *START), "--parameters", "nothing.json"), "nothing.json"),
        (("xx", *START), "oedometer"),
    ],
)
def test_bad_input_is_one_line_and_leaves_no_file(refused, tmp_path, arguments, hint):
    file = tmp_path / "bad.run.nc"
    assert hint in refused("model", *arguments, "-o", file)
    assert not file.exists()


def test_a_simulation_is_not_overwritten(run_file, refused):
    before = run_file.read_bytes()
    assert "simulation" in refused("model", "cv", *START, "-o", run_file)
    assert run_file.read_bytes() == before
    with netCDF4.Dataset(run_file) as dataset:
        assert dataset.engine != "model"


def test_inherent_anisotropy_starts_isotropic_at_the_pressure(tmp_path):
    file = tmp_path / "a.run.nc"
    arguments = ("model", "cr", *START, "--inherent-anisotropy", 0.3, "--angle", 45, "--strain", 0.05, "-o", file)
    assert main([str(argument) for argument in arguments]) == 0
    run = labkit.open_run(file)
    np.testing.assert_allclose(run["stress"][0], 0.5e6 * np.eye(3), atol=1.0)
    assert abs(float(run["contact_anisotropy"][0, 0, 2])) > 0.2
    np.testing.assert_allclose(run["stress"].values[:, 0, 0], 0.5e6, rtol=1e-4)


def test_parameters_that_have_changed_are_used_with_one_line(tmp_path, capfd):
    file = tmp_path / "model.json"
    write_with_provenance(file, Model().to_json())
    read_model(file)
    assert capfd.readouterr().err == ""
    values = Model().to_json().replace('"c_cZ": 5.57', '"c_cZ": 5.58')
    file.write_text(values)
    assert read_model(file).parameters.c_cZ == 5.58
    assert capfd.readouterr().err == f"labkit: {file} has changed since labkit wrote it\n"
    beside = tmp_path / "model.json.provenance.json"
    for damaged in ("{", "[]", "[" * 100_000):
        beside.write_text(damaged)
        with pytest.raises(labkit.InputError, match=r"provenance\.json is damaged: restore a copy"):
            read_model(file)


def test_the_pressure_of_a_path_file_is_that_of_the_model(tmp_path, capsys):
    (tmp_path / "shear.yaml").write_text("path: simple_shear\npressure: 200 kPa\nstrain: 0.01\n")
    words = ["model", str(tmp_path / "shear.yaml"), "--void-ratio", "0.67", "-o", str(tmp_path / "m.run.nc")]
    assert main(words) == 0
    with labkit.open_run(tmp_path / "m.run.nc") as run:
        assert run.lab.mean_stress()[0] == pytest.approx(200e3, rel=1e-6)
    assert main([*words[:-1], str(tmp_path / "n.run.nc"), "--pressure", "300kPa"]) == 0  # the option counts
    with labkit.open_run(tmp_path / "n.run.nc") as run:
        assert run.lab.mean_stress()[0] == pytest.approx(300e3, rel=1e-6)
