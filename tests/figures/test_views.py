"""Commands that show runs: critical."""

import pytest

import labkit
from labkit.results.critical import critical_states

pytestmark = pytest.mark.slow


def test_critical_table_and_figure(run_file, labkit_command, tmp_path):
    done = labkit_command(
        "critical", run_file, "--min-strain", 0.01, "-o", tmp_path / "c.png", "--csv", tmp_path / "c.csv"
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "c.png").read_bytes()[:4] == b"\x89PNG"
    table = critical_states({"small": labkit.open_run(run_file)})
    run = labkit.open_run(run_file)
    ratio = run.lab.deviatoric_stress() / run.lab.mean_stress()
    expected = float(ratio[run["axial_strain"].values >= 0.75 * float(run["axial_strain"][-1])].mean())
    assert abs(table["M"][0] - expected) < 1e-12
    assert (tmp_path / "c.csv").read_text().startswith("run,path,specimen,strain,M,M_scatter")
