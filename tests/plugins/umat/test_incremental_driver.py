"""The Incremental Driver of A. Niemunis calls the compiled UMAT.

LABKIT_INCREMENTAL_DRIVER names the executable, linked with -llabkit_umat; each test gives it the library built here.
"""

import os
import shutil
import subprocess

import numpy as np
import pytest

from labkit.model.controls import model_path
from labkit.model.driver import drive
from labkit.model.integrators import Adaptive
from labkit.plugins.umat.props import properties
from tests.plugins.umat.house_paths import PATHS, PRESSURE, TOLERANCE, assert_same_curve, curve
from tests.plugins.umat.test_abaqus import components, engineering, statev_of

pytestmark = pytest.mark.slow

STRESS = slice(8, 14)  # columns of the output file, after two times and six strains


@pytest.fixture
def driver(model, folder, tmp_path):
    """A function (initial state, lines of test.inp) -> rows of the driver's output file."""
    program = os.environ.get("LABKIT_INCREMENTAL_DRIVER")
    if program is None or shutil.which(program) is None:
        pytest.skip("LABKIT_INCREMENTAL_DRIVER names no Incremental Driver: docs/umat.md builds one")

    def call(state, *lines):
        stress, statev = components(-state.stress(model)).tolist(), statev_of(state).tolist()
        props = properties(model, tolerance=TOLERANCE).values()
        _write_lines(tmp_path / "initialconditions.inp", 6, *stress, len(statev), *statev)
        _write_lines(tmp_path / "parameters.inp", "LABKIT", len(props), *props)
        _write_lines(tmp_path / "test.inp", "output.txt", *lines, "*End")
        done = subprocess.run(
            [program], cwd=tmp_path, env=os.environ | {"LD_LIBRARY_PATH": str(folder)}, capture_output=True, text=True
        )
        assert "*End" in done.stderr, done.stdout + done.stderr
        return np.loadtxt(tmp_path / "output.txt", skiprows=1)

    return call


def _write_lines(file, *lines):
    file.write_text("".join(f"{line}\n" for line in lines))


@pytest.mark.parametrize("name", PATHS)
def test_a_path_in_the_driver(driver, tmp_path, name):
    """The driver reads the strain of the path from a file."""
    expected = curve(name)
    np.savetxt(tmp_path / "strain.txt", [engineering(strain) for strain in expected.strain], fmt="%.17e")
    columns = [f"0 {column}" for column in range(1, 7)]
    n = len(expected.strain) - 1
    rows = driver(expected.state, "*ImportFilestrain.txt|6", f"{n} 1 1.0", "*Cartesian", *columns)
    assert len(rows) == n + 1
    assert_same_curve(rows[:, STRESS], np.array([components(-stress) for stress in expected.stress]))


def test_a_stress_controlled_test_in_the_driver(driver, model):
    """The driver holds the lateral stress by its own iterations with DDSDDE."""
    state, n, strain = curve("cr").state, 2000, 0.02
    path = model_path("cr", PRESSURE, strain=strain)
    expected = drive(model, path, state, strain / n, Adaptive(1e-11)).require()
    rows = driver(state, "*TriaxialE1", f"{n} 5 1.0", f"{-strain!r}")
    assert len(rows) == len(expected) == n + 1
    order = [2, 0, 1]  # the driver's axis 1 is labkit's z
    found, stress = rows[:, STRESS][:, :3], -expected.stress[:, order, order]
    np.testing.assert_allclose(found / PRESSURE, stress / PRESSURE, rtol=0, atol=1e-6)
