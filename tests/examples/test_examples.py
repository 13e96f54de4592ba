"""Every file of examples/, end to end: as a program, on the command line, in verify and as a figure."""

import runpy
import shlex

import netCDF4
import numpy as np
import pytest

import labkit
from labkit.errors import LabkitWarning
from labkit.grains.state_file import read_state
from labkit.grains.time_step import critical_time_step
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

EXAMPLES = ROOT / "examples"


@pytest.fixture(scope="module")
def folder(tmp_path_factory, labkit_command):
    """A folder with a specimen of 1,000 grains, enough for C0's 2 %, prepared with the contact law of the example."""
    folder = tmp_path_factory.mktemp("examples")
    command = ["specimen", "--void-ratio", 0.6, "--grains", 1000, "--law", "linear", "--engine", "fused"]
    done = labkit_command(*command, "--use", EXAMPLES / "own_law.py", "-o", "s.state.nc", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


def used(*names):
    return [argument for name in names for argument in ("--use", EXAMPLES / f"{name}.py")]


def run(folder, labkit_command, *arguments):
    done = labkit_command(*arguments, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture
def program(forks, tmp_path_factory, tmp_path):
    """Function that runs an example with smaller numbers, text -> text, in tmp_path, and returns its output."""

    def output(name, smaller):
        done = forks.run(program=changed(name, smaller, tmp_path_factory.mktemp(name)), cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return output


def changed(name, smaller, folder):
    """A copy of an example in the folder, with smaller numbers, text -> text."""
    text = (EXAMPLES / f"{name}.py").read_text()
    for old, new in smaller.items():
        assert old in text
        text = text.replace(old, new)
    (folder / f"{name}.py").write_text(text)
    return folder / f"{name}.py"


def test_each_is_short_and_all_are_tested():
    files = sorted(EXAMPLES.glob("[!_]*.py"))
    tested = (
        "cohesion fem_dem first_test own_engine own_law own_material own_packing own_part own_path own_shape "
        "own_statistic plastic_spring van_der_waals"
    ).split()
    assert [file.stem for file in files] == tested
    assert all(len([line for line in file.read_text().splitlines() if line]) <= 45 for file in files)


def test_the_first_test_takes_ten_lines_and_passes_verify(program, tmp_path):
    text = (EXAMPLES / "first_test.py").read_text()
    assert len([line for line in text.splitlines()[1:] if line]) <= 10  # without the docstring
    output = program("first_test", {"grains=2000": "grains=1000", "strain=0.05": "strain=0.02"})
    assert "Run(cp on fused, complete" in output and "equation by volume: largest error" in output
    assert output.count(" ok\n") > 8 and "FAILED" not in output
    assert {file.name for file in tmp_path.iterdir()} == {"first_test.png", "first_test.run.nc"}


def test_grains_in_finite_elements_carry_about_the_load_of_the_model(tmp_path, monkeypatch):
    """Two triangles and two increments: both loads grow, and equilibrium is reached."""
    pytest.importorskip("skfem", reason="scikit-fem is not installed: pip install 'labkit[fem]'")
    monkeypatch.chdir(tmp_path)
    file = changed("fem_dem", {"4, 300, 20, 0.1": "1, 100, 2, 0.1"}, tmp_path)
    table = runpy.run_path(str(file))["table"]
    assert list(table.index) == [0.0, 0.5, 1.0]
    assert (table.iloc[0] == 25.0).all()
    assert (table.diff().iloc[1:] > 0.0).all(axis=None)
    assert 0.6 < table["grains"].iloc[-1] / table["model"].iloc[-1] < 1.2
    assert (tmp_path / "fem_dem.png").exists()


def test_cohesion_moves_c0(tmp_path, monkeypatch):
    """Small specimens with adhesion: contacts in tension, and a finite error of C0."""
    monkeypatch.chdir(tmp_path)
    smaller = {"400, 0.05, (1, 2, 3), (20e3, 100e3, 300e3)": "120, 0.002, (1,), (1e5,)", "rate=20.0": "rate=50.0"}
    with pytest.warns(LabkitWarning, match="the specimen has a nominal void ratio of"):
        means = runpy.run_path(str(changed("cohesion", smaller, tmp_path)))["means"]
    assert (means.loc[["dmt", "jkr", "capillary"], "tension"] > 0.0).all() and not means.loc["hertz", "tension"].any()
    assert np.isfinite(means).all(axis=None) and (tmp_path / "cohesion.png").exists()


def test_own_material_is_stiffer_and_smoother_than_sand(program):
    """In the same geometry stresses scale with E, and at the same stress overlaps scale with 1/E."""
    output = program("own_material", {"strain=0.03": "strain=0.01"})
    names = ("mean stress", "mean overlap", "largest stress ratio")
    lines = {name: line.split()[-2:] for line in output.splitlines() for name in names if line.startswith(name)}
    ratio = {name: float(beads) / float(sand) for name, (sand, beads) in lines.items()}
    assert np.isclose(ratio["mean stress"], 0.6 / 0.15, rtol=0.15)
    assert np.isclose(ratio["mean overlap"], 0.15 / 0.6, rtol=0.15)
    assert ratio["largest stress ratio"] < 0.7


@pytest.mark.yade
def test_own_packing_is_consolidated_and_sheared_drained_on_both_engines():
    example = runpy.run_path(str(EXAMPLES / "own_packing.py"))
    state = example["packing"]()
    sizes = state.radius / state.radius.mean()
    assert len(sizes) == 1000 and np.allclose([sizes.min(), sizes.max()], [0.58, 1.62], atol=1e-4)
    assert state.time_step < 0.8 * critical_time_step(state)
    state = labkit.consolidate(state, "100 kPa", progress=False)
    ends = []
    for engine in ("fused", "yade"):
        data = example["test"](state, 5e-4, engine).data
        assert data.attrs["complete"] and data.attrs["engine"] == engine
        assert abs(data["energy_balance_error"]).max() < 1e-3
        np.testing.assert_allclose(data["stress"][-1].values[0, 0], 100e3, rtol=0.01)
        ends.append(data["stress"][-1].values)
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-3 * ends[0][2, 2])
    assert ends[0][2, 2] > 1.2 * ends[0][0, 0]


def test_own_material_is_the_same_on_the_command_line(tmp_path, labkit_command):
    example = runpy.run_path(str(EXAMPLES / "own_material.py"))
    command = example["__doc__"][example["__doc__"].index("labkit specimen") :]
    run(tmp_path, labkit_command, *shlex.split(command)[1:])
    state = read_state(tmp_path / "beads.state.nc")
    assert state.scene == example["BEADS"]
    diameter = 2e3 * state.radius[:-2]  # mm; the last two grains complete the solid volume
    assert 0.6 <= diameter.min() < 0.63 and 0.97 < diameter.max() <= 1.0


def test_own_shape_is_stronger_and_has_more_contacts_than_spheres(program):
    output = program("own_shape", {"grains=300": "grains=200", "strain=0.03": "strain=0.02"})
    rows = [line.split()[-2:] for line in output.splitlines()[-5:]]
    strength, coordination, *_ = [[float(value) for value in row] for row in rows]
    assert strength[1] > 1.1 * strength[0]
    assert coordination[1] > coordination[0]
    assert rows[-1][0] == "nan" and abs(float(rows[-1][1])) < 2.0


@pytest.fixture(scope="module")
def own_path_file(folder, labkit_command):
    """A run of the own path and the own law."""
    command = ["run", "ca", "s.state.nc", "--pressure", "300kPa", "--strain", 0.015, "--engine", "fused"]
    run(folder, labkit_command, *command, "-o", "ca.run.nc", *used("own_path", "own_law"))
    return folder / "ca.run.nc"


@pytest.fixture(scope="module")
def own_law_file(folder, labkit_command):
    """A run with the own law and the own statistic."""
    command = ["run", "cv", "s.state.nc", "--strain", 0.015, "--engine", "fused", "-o", "law.run.nc"]
    run(folder, labkit_command, *command, *used("own_law", "own_statistic"))
    return folder / "law.run.nc"


def test_own_path_holds_the_axial_stress_and_verify_checks_it(own_path_file, labkit_command):
    with netCDF4.Dataset(own_path_file) as dataset:
        axial, late = dataset["stress"][:, 2, 2], dataset["axial_strain"][:] > 0.005
        assert np.abs(axial[late] / 300e3 - 1.0).max() < 0.02
        assert dataset["stress"][-1, 0, 0] < 0.7 * 300e3  # the radial stress decreases
    folder = own_path_file.parent
    report = labkit_command("verify", "ca.run.nc", *used("own_path", "own_law"), cwd=folder).stdout
    assert "held: axial stress, error RMS" in report and "mean stress, error" not in report
    report = labkit_command("verify", "ca.run.nc", *used("own_law"), cwd=folder).stdout  # without the file of the path
    assert "path ca " in report


def test_own_law_conserves_energy_and_has_no_moments(own_law_file):
    with netCDF4.Dataset(own_law_file) as dataset:
        assert np.abs(dataset["energy_balance_error"][:]).max() < 0.01
        assert not dataset["contacts/rolling_moment"][:].any() and dataset["contacts/tangential_force"][:].any()
        normal_force = dataset["contacts/normal_force"][:]
        limit = 0.4 * normal_force + 1e-12 * normal_force.mean()  # rounding matters where grains hardly touch
        assert (np.linalg.norm(dataset["contacts/tangential_force"][:], axis=1) <= limit).all()


def test_own_part_attracts_grains_and_conserves_energy(folder, labkit_command):
    """15 lines of code; the mean normal force of a part that attracts is below that of its springs."""
    lines = (EXAMPLES / "own_part.py").read_text().splitlines()
    code = [line for line in lines if line and not line.lstrip().startswith(('"""', "labkit specimen"))]
    assert len(code) <= 15
    command = ["run", "cv", "s.state.nc", "--strain", 0.01, "--engine", "fused", "--law", "adhesive"]
    run(folder, labkit_command, *command, "-o", "part.run.nc", *used("own_law", "own_part"))
    with netCDF4.Dataset(folder / "part.run.nc") as dataset:
        assert np.abs(dataset["energy_balance_error"][:]).max() < 0.01
        forces = dataset["contacts/normal_force"][:]
        assert (forces < 0.0).any() and (forces > 0.0).any()
    report = labkit_command("verify", "part.run.nc", *used("own_law", "own_part"), cwd=folder).stdout
    failed = [line for line in report.splitlines() if "FAILED" in line]
    equation = "equation by volume: largest error, norm"  # assumes no tension
    assert all(line.lstrip().startswith(equation) for line in failed), report


def test_own_statistic_is_recorded_verified_and_drawn(own_law_file, labkit_command):
    folder = own_law_file.parent
    with netCDF4.Dataset(own_law_file) as dataset:
        values = dataset["sliding_fraction"]
        assert values.long_name == "fraction of contacts at the friction limit" and values.units == "1"
        assert 0.0 < values[-1] < 1.0
    report = run(folder, labkit_command, "verify", "law.run.nc", *used("own_law", "own_statistic"))
    assert "stored sliding_fraction against its contacts" in report
    run(folder, labkit_command, "figure", "records", "law.run.nc", "--variable", "sliding_fraction", *used("own_law"))
    run(folder, labkit_command, "figure", "sliding", "law.run.nc", *used("own_law", "own_statistic"))
    assert (folder / "law.sliding_fraction.png").exists() and (folder / "law.sliding.png").exists()


def test_own_engine_is_stiffer_than_grains_that_rearrange(folder, labkit_command):
    command = ["run", "cv", "s.state.nc", "--strain", 1e-3, "--record-strain", 1e-4, "--rate", 40]
    q = {}
    for engine in ("affine", "fused"):
        extensions = used("own_engine", "own_law")
        run(folder, labkit_command, *command, "--engine", engine, "-o", f"{engine}.run.nc", *extensions)
        with netCDF4.Dataset(folder / f"{engine}.run.nc") as dataset:
            assert dataset.engine == engine
            assert np.abs(dataset["energy_balance_error"][:]).max() < 0.01
            q[engine] = labkit.deviatoric_stress(dataset["stress"][-1])
    assert q["affine"] > 1.2 * q["fused"] > 0.0


def test_own_path_is_also_a_program(program, tmp_path):
    output = program("own_path", {"grains=500": "grains=200", "strain=0.05": "strain=0.01"})
    assert "Run(ca on fused, complete" in output and "held: axial stress, error RMS" in output
    assert not list(tmp_path.iterdir())
