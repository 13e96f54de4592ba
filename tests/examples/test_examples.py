"""Every file of examples/, end to end: command line, campaign, verify and figure, with no line of labkit changed."""

import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest

import labkit
from tests.conftest import ROOT

EXAMPLES = ROOT / "examples"


@pytest.fixture(scope="module")
def folder(tmp_path_factory, labkit_command):
    """A folder with a specimen of about 500 grains, made with the contact law of the example."""
    folder = tmp_path_factory.mktemp("examples")
    words = ["specimen", "--void-ratio", 0.6, "--grains", 500, "--law", "linear", "--engine", "fused"]
    done = labkit_command(*words, "--use", EXAMPLES / "own_law.py", "-o", "s.state.nc", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


def used(*names):
    return [word for name in names for word in ("--use", EXAMPLES / f"{name}.py")]


def run(folder, labkit_command, *words):
    done = labkit_command(*words, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_each_is_short_and_all_are_tested():
    files = sorted(EXAMPLES.glob("own_*.py"))
    assert [file.stem for file in files] == ["own_engine", "own_law", "own_path", "own_statistic"]
    assert all(len(file.read_text().splitlines()) < 40 for file in files)


def test_own_path_holds_the_axial_stress_in_a_run_that_verify_judges(folder, labkit_command):
    words = ["run", "ca", "s.state.nc", "--pressure", "300kPa", "--strain", 0.03, "--engine", "fused"]
    run(folder, labkit_command, *words, "-o", "ca.run.nc", *used("own_path", "own_law"))
    with netCDF4.Dataset(folder / "ca.run.nc") as found:
        axial, late = found["stress"][:, 2, 2], found["axial_strain"][:] > 0.005
        assert np.abs(axial[late] / 300e3 - 1.0).max() < 0.02
        assert found["stress"][-1, 0, 0] < 0.7 * 300e3  # the radial stress falls
    said = labkit_command("verify", "ca.run.nc", *used("own_path", "own_law"), cwd=folder).stdout
    assert "held: axial stress, error RMS" in said and "mean stress, error" not in said


def test_a_run_of_an_own_path_is_read_without_its_file_and_says_what_is_missing(folder, labkit_command):
    said = labkit_command("verify", "ca.run.nc", *used("own_law"), cwd=folder).stdout
    assert "path ca is unknown here, give --use FILE" in said


def test_own_law_conserves_energy_and_has_no_moments(folder, labkit_command):
    run(
        folder,
        labkit_command,
        "run",
        "cv",
        "s.state.nc",
        "--strain",
        0.03,
        "--engine",
        "fused",
        "-o",
        "law.run.nc",
        *used("own_law", "own_statistic"),
    )
    with netCDF4.Dataset(folder / "law.run.nc") as found:
        assert np.abs(found["energy_balance_error"][:]).max() < 0.01
        assert not found["contacts/rolling_moment"][:].any() and found["contacts/tangential_force"][:].any()
        limit = 0.4 * found["contacts/normal_force"][:] * (1.0 + 1e-9)
        assert (np.linalg.norm(found["contacts/tangential_force"][:], axis=1) <= limit).all()


def test_own_statistic_is_recorded_verified_and_drawn(folder, labkit_command):
    with netCDF4.Dataset(folder / "law.run.nc") as found:
        values = found["sliding_fraction"]
        assert values.long_name == "share of contacts at the friction limit" and values.units == "1"
        assert 0.0 < values[-1] < 1.0
    said = run(folder, labkit_command, "verify", "law.run.nc", *used("own_law", "own_statistic"))
    assert "stored sliding_fraction against its contacts" in said
    run(folder, labkit_command, "figure", "records", "law.run.nc", "--variable", "sliding_fraction", *used("own_law"))
    run(folder, labkit_command, "figure", "sliding", "law.run.nc", *used("own_law", "own_statistic"))
    assert (folder / "law.sliding_fraction.png").exists() and (folder / "law.sliding.png").exists()


def test_own_engine_is_stiffer_than_grains_that_rearrange(folder, labkit_command):
    words = ["run", "cv", "s.state.nc", "--strain", 1e-3, "--record-strain", 1e-4]
    for engine in ("affine", "fused"):
        own = used("own_engine", "own_law")
        run(folder, labkit_command, *words, "--engine", engine, "-o", f"{engine}.run.nc", *own)
    q = {}
    for engine in ("affine", "fused"):
        with netCDF4.Dataset(folder / f"{engine}.run.nc") as found:
            assert found.engine == engine
            stress = found["stress"][:]
            q[engine] = (stress[:, 2, 2] - 0.5 * (stress[:, 0, 0] + stress[:, 1, 1]))[-1]
    assert q["affine"] > 1.2 * q["fused"] > 0.0


def test_a_campaign_uses_them(folder, labkit_command):
    (folder / "own.yaml").write_text(
        f"use: [{EXAMPLES / 'own_path.py'}, {EXAMPLES / 'own_law.py'}, {EXAMPLES / 'own_statistic.py'}]\n"
        "engine: fused\n"
        "specimens:\n  dense: {void_ratio: 0.6, grains: 200, law: linear}\n"
        "runs:\n  ca: {path: ca, specimen: dense, pressure: 300 kPa, strain: 0.01, rate: 20 1/s}\n"
    )
    run(folder, labkit_command, "campaign", "own.yaml", "--cores", 1)
    runs = labkit.open_campaign(folder / "own")
    assert list(runs["path"].values) == ["ca"]
    with netCDF4.Dataset(folder / "own/runs/ca.run.nc") as found:
        assert "sliding_fraction" in found.variables
    assert (folder / "own/figures/ca.png").exists()


def test_own_path_is_a_program_too(tmp_path):
    done = subprocess.run(
        [sys.executable, EXAMPLES / "own_path.py"], cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert "Run(ca on fused, complete" in done.stdout and "held: axial stress, error RMS" in done.stdout
    assert not list(Path(tmp_path).iterdir())
