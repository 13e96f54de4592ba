"""Commands that show runs: watch, critical, info."""

import time

import labkit
from labkit.runs.critical import critical_states


def test_watch_draws_a_run_in_the_terminal(run_file, labkit_command):
    done = labkit_command("watch", "--once", run_file)
    assert done.returncode == 0, done.stderr
    assert "axial strain 2.00%" in done.stdout and "C0 off by" in done.stdout
    assert sum(line.count("│") > 3 for line in done.stdout.splitlines()) > 8


def test_watch_ends_when_the_runs_are_complete(run_file, labkit_command):
    begin = time.monotonic()
    assert labkit_command("watch", "--interval", 60, run_file).returncode == 0
    assert time.monotonic() - begin < 50


def test_watch_refuses_what_is_no_run(specimen_file, labkit_command):
    done = labkit_command("watch", "--once", specimen_file)
    assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1


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
    assert (tmp_path / "c.csv").read_text().startswith("run,path,strain,M,M_scatter")
