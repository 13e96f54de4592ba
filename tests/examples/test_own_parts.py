"""Two parts of a user's own, one with a history and one across a gap, without a change in labkit."""

import json
import signal

import netCDF4
import numpy as np
import pytest

from tests.conftest import ROOT
from tests.killed import signalled

pytestmark = pytest.mark.slow

PARTS = {  # file -> law, column, parameter and its value
    "plastic_spring": ("plastic", "deepest_overlap", "unloading_ratio", 2.0),
    "van_der_waals": ("van_der_waals", "attracted", "hamaker", 2e-13),
}
LOADING = ("--pressure", "300kPa", "--strain", 0.005, "--rate", 20, "--save-every", 1)


@pytest.fixture(scope="module", params=PARTS)
def part(request, tmp_path_factory, labkit_command):
    """Function that runs a command with the law of a part, in a folder with a specimen and a test of it."""
    folder, (law, _, parameter, value) = tmp_path_factory.mktemp(request.param), PARTS[request.param]
    file = ROOT / "examples" / f"{request.param}.py"

    def command(*words, status=(0,)):
        done = labkit_command(*words, "--use", file, cwd=folder)
        assert done.returncode in status, done.stdout + done.stderr
        return done.stdout + done.stderr

    own = ("--law", law, f"--{parameter.replace('_', '-')}", value)
    prepared = ("--preparation", "compression", "--pressure", "100kPa", "--grains", 200, "--time-step-factor", 0.1)
    command("specimen", "--void-ratio", 0.65, *prepared, *own, "-o", "s.state.nc")
    command("run", "cp", "s.state.nc", *LOADING, "-o", "r.run.nc")
    return command, folder, request.param


def test_its_history_and_losses_are_in_the_files_and_its_energy_is_balanced(part):
    _, folder, name = part
    _, column, parameter, value = PARTS[name]
    with netCDF4.Dataset(folder / "r.run.nc") as run:
        assert np.abs(run["energy_balance_error"][:]).max() < 2e-4
        assert json.loads(run.scene)[parameter] == value
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


def test_a_killed_run_of_it_is_resumed_to_the_same_end(part):
    command, folder, name = part
    words = ("run", "cp", folder / "s.state.nc", *LOADING, "-o", folder / "k.run.nc")
    use = ("--use", ROOT / "examples" / f"{name}.py")
    assert signalled(signal.SIGKILL, "save", 3, *words, *use).returncode == -signal.SIGKILL
    command(*words)
    with netCDF4.Dataset(folder / "r.run.nc") as whole, netCDF4.Dataset(folder / "k.run.nc") as resumed:
        np.testing.assert_array_equal(resumed["stress"][:], whole["stress"][:])
        np.testing.assert_array_equal(resumed["energy_balance_error"][:], whole["energy_balance_error"][:])


def test_it_is_verified_exported_and_imported(part):
    command, folder, name = part
    law = PARTS[name][0]
    assert "energy balance, error relative to the work" in command("verify", "r.run.nc", status=(0, 1))  # few grains
    command("export", "s.state.nc", "--format", "lammps_data", "-o", "s.data")
    command("import", "s.data", "--law", law, "-o", "i.state.nc")
    with netCDF4.Dataset(folder / "s.state.nc") as ours, netCDF4.Dataset(folder / "i.state.nc") as read:
        np.testing.assert_allclose(read["radius"][:], ours["radius"][:], rtol=1e-12)


@pytest.mark.parametrize("part", ["plastic_spring"], indirect=True)
def test_its_parameter_is_a_key_of_campaigns(part):
    command, folder, name = part
    law, _, parameter, value = PARTS[name]
    (folder / "own.yaml").write_text(
        f"name: own\nlaw: {law}\n{parameter}: {value}\n"
        "specimens:\n  small: {void_ratio: 0.65, preparation: compression, pressure: 100 kPa, grains: 100, seed: 1}\n"
        "runs:\n  cp: {path: cp, specimen: small, pressure: 100 kPa, strain: 0.002, rate: 20}\n"
    )
    assert "1 of 1 runs are finished" in command("campaign", "own.yaml")
    with netCDF4.Dataset(folder / "own" / "runs" / "cp.run.nc") as run:
        assert json.loads(run.scene)[parameter] == value
