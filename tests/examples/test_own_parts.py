"""Two parts of a user's own, one with a history and one across a gap, without a change in labkit."""

import netCDF4
import numpy as np
import pytest

from tests.conftest import ROOT

pytestmark = pytest.mark.slow

PARTS = {"plastic_spring": ("plastic", "deepest_overlap"), "van_der_waals": ("van_der_waals", "attracted")}


@pytest.fixture(scope="module", params=PARTS)
def part(request, tmp_path_factory, labkit_command):
    """Function that runs a command with the law of a part, in a folder with a specimen and a test of it."""
    folder, (law, column) = tmp_path_factory.mktemp(request.param), PARTS[request.param]

    def command(*words):
        done = labkit_command(*words, "--use", ROOT / "examples" / f"{request.param}.py", cwd=folder)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    prepared = ("--preparation", "compression", "--pressure", "100kPa", "--grains", 300, "--law", law)
    command("specimen", "--void-ratio", 0.65, *prepared, "-o", "s.state.nc")
    command("run", "cp", "s.state.nc", "--pressure", "300kPa", "--strain", 0.01, "--rate", 20, "-o", "r.run.nc")
    return command, folder, column


def test_its_history_and_losses_are_in_the_files_and_its_energy_is_balanced(part):
    _, folder, column = part
    with netCDF4.Dataset(folder / "r.run.nc") as run:
        assert np.abs(run["energy_balance_error"][:]).max() < 3e-4
        assert run["contacts"][column][:].any() and run["checkpoint"][column][:].any()
        assert (column != "deepest_overlap") or run["plastic_loss"][-1] > 0.01 * run["cell_work"][-1]
        assert (column != "attracted") or (run["contacts"]["normal_force"][:] < 0.0).any()


def test_a_run_of_it_goes_on_is_described_and_drawn(part):
    command, folder, _ = part
    command("run", "cp", "r.run.nc", "--pressure", "300kPa", "--strain", 0.002, "--rate", 20, "-o", "on.run.nc")
    with netCDF4.Dataset(folder / "r.run.nc") as first, netCDF4.Dataset(folder / "on.run.nc") as second:
        last = first["stress"][-1]
        np.testing.assert_allclose(second["stress"][0], last, atol=1e-6 * np.abs(last).max())
    assert "complete" in command("info", "r.run.nc")
    command("figure", "test", "on.run.nc", "-o", "p.png")
    assert (folder / "p.png").exists()
