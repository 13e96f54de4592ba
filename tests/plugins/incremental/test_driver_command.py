"""The example of examples/incremental_driver on grains and on the model: one test file, the same columns."""

import shutil

import numpy as np
import pytest

import labkit
from labkit.cli import main
from labkit.errors import InputError
from labkit.model import Model, drive
from labkit.model.run_file import as_run
from labkit.plugins.incremental.columns import NAMES, columns, output_text
from labkit.plugins.incremental.driver_file import read_test
from labkit.plugins.incremental.start import model_from_constants, model_state, read_initial, way_to
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

EXAMPLE = ROOT / "examples/incremental_driver"
FILES = ("--initial", "initialconditions.inp")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("driver")
    for file in EXAMPLE.iterdir():
        shutil.copy(file, folder)
    state = labkit.make_specimen(labkit.Recipe(0.62, grains=300), file=folder / "s.state.nc", progress=False)
    assert state.number_of_grains > 290
    return folder


def table(file):
    """The heading of an output file of the driver, and its columns by name."""
    names, heading, *lines = file.read_text().splitlines()
    assert names.split() == list(NAMES)
    return heading, dict(zip(NAMES, np.array([line.split() for line in lines], dtype=float).T, strict=True))


def check(column):
    """The values that the test file prescribes: stresses in kPa, tension positive; axis 1 is the axis of symmetry."""
    stress = np.array([column[f"stress({k})"] for k in (1, 2, 3)])
    strain = np.array([column[f"stran({k})"] for k in (1, 2, 3)])
    q, p, volume = -(stress[0] - 0.5 * (stress[1] + stress[2])), -stress.mean(axis=0), strain.sum(axis=0)
    time, last = column["time(2)"], len(p) - 1
    start = int(np.flatnonzero(q > 100.0)[0])  # the end of the first step
    assert stress[1:, : start + 1] == pytest.approx(-200.0, abs=1.0) and time[start] < 0.5
    cycles = start + np.arange(0, 61, 10)  # the ends of six steps
    np.testing.assert_allclose(np.diff(q[cycles]), [-60, 60] * 3, atol=1.0)
    assert np.ptp(volume[start : cycles[-1] + 1]) < 2e-12  # ten digits are printed
    np.testing.assert_allclose(np.diff(time[cycles]), 0.5, atol=1e-9)
    assert p[cycles[-1] :] == pytest.approx(p[cycles[-1]], rel=0.005) and last == cycles[-1] + 10
    eq = -2 / 3 * (strain[0] - 0.5 * (strain[1] + strain[2]))
    assert eq[last] - eq[cycles[-1]] == pytest.approx(0.01, rel=1e-6) and time[last] - time[
        cycles[-1]
    ] == pytest.approx(1)


def test_on_grains(folder, monkeypatch):
    monkeypatch.chdir(folder)
    arguments = ["driver", "test.inp", "--on", "s.state.nc", *FILES, "--engine", "fused", "--rate", "30"]
    assert main([*arguments, "--columns", "grains.out"]) == 0
    heading, column = table(folder / "grains.out")
    assert heading == "drained compression, undrained cycles, shear at constant p"
    check(column)
    run = labkit.Run.open(folder / "test_s.run.nc")
    np.testing.assert_allclose(column["statev(1)"], run.data["void_ratio_nominal"])
    np.testing.assert_allclose(column["statev(4)"], run.data["contact_anisotropy"].values[:, 2, 2], atol=1e-9)
    assert all(finding.holds for finding in labkit.verify(run) if finding.name.startswith("prescribed"))
    run.data.close()
    assert main([*arguments, "--columns", "again.out"]) == 0  # the run is complete, so only the columns are written
    assert (folder / "again.out").read_text() == (folder / "grains.out").read_text()


def test_the_rate_is_also_that_of_the_way_to_the_initial_stress(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    (folder / "sheared.inp").write_text("6\n-220\n-200\n-200\n0\n0\n0\n1\n0.62\n")
    arguments = ["driver", "test.inp", "--on", "s.state.nc", "--initial", "sheared.inp", "--rate", "1e5"]
    assert main([*arguments, "-o", "sheared.run.nc", "--columns", "sheared.out"]) == 2
    assert "--rate 100000 gives" in capsys.readouterr().err
    assert not (folder / "sheared.initial.run.nc").exists()


def test_on_the_model(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    arguments = ["driver", "test.inp", "--on", "model", *FILES, "--parameters", "parameters.inp"]
    assert main(arguments) == 0
    text = "test_model.run.nc: complete; the columns of the Incremental Driver are in driver.out"
    assert text in capsys.readouterr().out
    check(table(folder / "driver.out")[1])
    (folder / "mine.txt").write_text("my notes")
    assert main([*arguments, "--columns", "mine.txt"]) == 2
    assert "is not an output file of the driver" in capsys.readouterr().err
    assert (folder / "mine.txt").read_text() == "my notes"


def test_the_constants_of_the_example_are_table_2():
    model, table_2 = model_from_constants(EXAMPLE / "parameters.inp"), Model()
    assert model.young_modulus == table_2.young_modulus
    np.testing.assert_allclose(model.constants, table_2.constants, rtol=1e-5)


def test_an_anisotropic_initial_stress_is_reached(tmp_path):
    file = tmp_path / "initial.inp"
    file.write_text("6\n-300\n-150\n-200\n10\n20\n-30\n1\n0.67\n")
    initial = read_initial(file)
    state = drive(Model(), way_to(initial.stress), model_state(initial, Model())).require().state()
    np.testing.assert_allclose(state.stress(Model()), initial.stress, atol=1.0)


def test_a_whole_state_continues_where_an_output_file_ends(tmp_path):
    """The last row of an output file as initial conditions: the next row is that of the uninterrupted test."""
    start, file = read_initial(EXAMPLE / FILES[1]), tmp_path / "initial.inp"
    state, test = model_state(start, Model()), tmp_path / "test.inp"
    test.write_text("o\n" + "*TriaxialE1\n10 5 1\n-0.005\n" * 2)
    path = read_test(test).path()
    rows = columns(as_run(drive(Model(), path, state)), path)
    middle = rows[10]
    file.write_text("\n".join(["6", *map(repr, middle[8:14].tolist()), "21", *map(repr, middle[14:].tolist())]))
    test.write_text("o\n*TriaxialE1\n10 5 1\n-0.005\n")
    second = read_test(test).path()
    again = columns(as_run(drive(Model(), second, model_state(read_initial(file), Model()))), second)
    np.testing.assert_allclose(again[-1, 8:], rows[-1, 8:], rtol=2e-4, atol=2e-4)
    file.write_text(file.read_text().replace(repr(middle[8].item()), "-500.0"))
    with pytest.raises(InputError, match="the stress contradicts the 21 state variables"):
        model_state(read_initial(file), Model())
    assert output_text(rows, "heading").splitlines()[1] == "heading"
