"""Paths on real YADE with a small specimen: controlled stresses, reversals, early stops."""

import numpy as np
import pytest

import labkit
from labkit.results.verify import findings

pytestmark = [pytest.mark.slow, pytest.mark.yade]

PATHS = {
    "cr": ["--pressure", 0.5e6, "--strain", 0.006],
    "isoc": ["--pressure", 0.8e6],
    "isod": ["--pressure", 0.35e6],
    "cyclic_cp": ["--pressure", 0.5e6, "--reversals", "0.004,-0.001,0.002"],
}


@pytest.fixture(scope="module", params=PATHS)
def path_run(request, tmp_path_factory, specimen_file, labkit_command):
    file = tmp_path_factory.mktemp(request.param) / "r.run.nc"
    done = labkit_command("run", request.param, specimen_file, *PATHS[request.param], "--engine", "yade", "-o", file)
    assert done.returncode == 0, done.stderr
    return request.param, labkit.open_run(file)


def test_the_path_follows_its_strains_and_stops(path_run):
    name, run = path_run
    strain = run["strain"].values
    pressure = run.lab.mean_stress().values
    assert run.attrs["complete"] == 1 and run.attrs["path"] == name
    if name == "cr":
        assert np.isclose(strain[-1, 2, 2], 0.006, atol=1e-5)
    if name in ("isoc", "isod"):
        np.testing.assert_allclose(strain[:, 0, 0], strain[:, 2, 2], atol=1e-12)
        np.testing.assert_allclose(strain[:, 1, 1], strain[:, 2, 2], atol=1e-12)
    if name == "isoc":
        assert pressure[-1] >= 0.8e6 > pressure[-2] and (np.diff(run["void_ratio_nominal"]) < 0).all()
    if name == "isod":
        assert pressure[-1] < 0.35e6 <= pressure[-2] and (np.diff(run["void_ratio_nominal"]) > 0).all()
    if name == "cyclic_cp":
        axial = run["axial_strain"].values
        turns = axial[1:-1][np.diff(np.sign(np.diff(axial))) != 0]
        np.testing.assert_allclose(turns, [0.004, -0.001], atol=1e-5)
        assert np.isclose(axial[-1], 0.002, atol=1e-5)


def test_the_path_holds_its_stresses(path_run):
    _, run = path_run
    held = [f for f in findings(run) if f.name.startswith("held:")]
    assert held and all(f.holds for f in held), [str(f) for f in held]


def test_a_test_starts_isotropic_at_its_pressure(path_run):
    name, run = path_run
    if name in ("cr", "cyclic_cp"):
        np.testing.assert_allclose(np.diag(run["stress"][0]), 0.5e6, rtol=2e-3)
