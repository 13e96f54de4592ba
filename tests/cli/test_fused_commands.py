"""The commands with the fused engine, on a system without YADE."""

import json
import os

import netCDF4
import numpy as np
import pytest

from labkit.grains.state_file import read_state

pytestmark = pytest.mark.slow

BARE = {**os.environ, "PATH": "/nowhere"}
SPECIMEN = ("specimen", "--void-ratio", 0.67, "--grains", 300, "--engine", "fused")
RUN = ("--engine", "fused", "--strain", 0.02, "--rate", 20, "--save-every", 3, "--snapshots", 2)


@pytest.fixture(scope="module")
def specimen(labkit_command, tmp_path_factory):
    path = tmp_path_factory.mktemp("fused") / "s.state.nc"
    done = labkit_command(*SPECIMEN, "--law", "spring_dashpot", "-o", path, environment=BARE)
    assert done.returncode == 0, done.stderr
    return path


@pytest.mark.parametrize("path", ["cv", "cp"])
def test_a_run_without_yade(path, specimen, labkit_command, tmp_path):
    pressure = ("--pressure", 0.5e6) if path == "cp" else ()
    done = labkit_command("run", path, specimen, *RUN, *pressure, "-o", tmp_path / "r.run.nc", environment=BARE)
    assert done.returncode == 0, done.stderr
    with netCDF4.Dataset(tmp_path / "r.run.nc") as run:
        assert run.complete == 1 and json.loads(run.scene)["law"] == "spring_dashpot"
        assert np.isclose(run["axial_strain"][-1], 0.02, rtol=1e-3)
        assert np.abs(run["energy_balance_error"][:]).max() < 0.01
        assert run["cell_work"][-1] > 0.0 and run["friction_loss"][-1] > 0.0
        if path == "cp":
            p = np.trace(run["stress"][:], axis1=1, axis2=2) / 3
            assert np.abs(p / 0.5e6 - 1).max() < 0.01


def test_a_run_may_have_another_law_than_its_specimen(specimen, labkit_command, tmp_path):
    file = tmp_path / "r.run.nc"
    done = labkit_command("run", "cv", specimen, *RUN, "--law", "rolling_resistance", "-o", file, environment=BARE)
    assert done.returncode == 0, done.stderr
    with netCDF4.Dataset(file) as run:
        assert json.loads(run.scene)["law"] == "rolling_resistance"
    again = labkit_command("run", "cv", specimen, *RUN, "-o", file, environment=BARE)
    assert again.returncode == 2 and again.stderr.startswith(f"labkit: {file} ") and "specimen" in again.stderr


def test_an_existing_specimen_is_not_made_again(labkit_command, tmp_path):
    """The default name of a file is built from its parameters."""
    words = ("specimen", "--void-ratio", 0.67, "--settings", "quick", "--grains", 150, "--engine", "fused")
    assert labkit_command(*words, cwd=tmp_path, environment=BARE).returncode == 0
    (file,) = tmp_path.iterdir()
    assert file.name == "e0.67_f0.15_r0.1_n150_s1_t0.3.state.nc"
    before = file.read_bytes()
    for more in ((), ("-o", file.name), ("--step1-friction", "0.15", "--law", "rolling_resistance")):
        again = labkit_command(*words, *more, cwd=tmp_path, environment=BARE)
        assert again.returncode == 0 and again.stdout == f"{file.name}: already holds this specimen, nothing to do\n"
    assert file.read_bytes() == before and list(tmp_path.iterdir()) == [file]
    other = labkit_command(*words, "--seed", 2, "-o", file.name, cwd=tmp_path, environment=BARE)
    assert other.returncode == 0 and read_state(file).seed == 2
