"""A tiny campaign carried out by Snakemake: resumed, changed, interrupted, killed, with a run that fails."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import netCDF4
import numpy as np
import pytest

import labkit
from labkit.cli import main
from labkit.errors import Interrupted
from labkit.files.hashes import file_sha256
from labkit.files.provenance import provenance_of
from labkit.plugins.campaigns import workflow
from labkit.plugins.campaigns.file import read_campaign
from labkit.plugins.campaigns.job import run_job
from labkit.plugins.campaigns.layout import PROCESS, leave_the_future
from labkit.plugins.campaigns.plan import write_plan
from labkit.plugins.campaigns.workflow import PROFILES, SNAKEFILE
from labkit.process.extras import install_command
from tests.conftest import PATIENCE, wait_until

pytestmark = pytest.mark.slow

pytest.importorskip("snakemake", reason="needs Snakemake, the extra `campaign`")

TINY = """\
settings: quick
engine: fused
snapshots: 2
specimens:
  a: {void_ratio: 0.606, step1_friction: 0.06, grains: 120}
  b: {void_ratio: 0.62, step1_friction: 0.06, grains: 120}
runs:
  cv: {path: cv, specimen: b, strain: 0.01}
  cp: {path: cp, specimen: a, pressure: 500 kPa, strain: 0.01}
"""
APART = "  apart: {void_ratio: 1.4, grains: 120}\nruns:\n  cv-apart: {path: cv, specimen: apart, strain: 0.01}\n"
UNSTABLE = "  wild: {path: cv, specimen: a, strain: 0.2, time_step_factor: 2}\n"


def files(folder):
    """Name -> (modification time, hash of the data) of the results of simulations."""
    return {
        file.name: (file.stat().st_mtime_ns, data_hash(file))
        for kind in ("specimens", "runs")
        for file in sorted((folder / kind).iterdir())
        if file.suffix == ".nc"
    }


def data_hash(file):
    with netCDF4.Dataset(file) as dataset:
        return dataset.data_sha256


@pytest.fixture(scope="module")
def finished(tmp_path_factory, labkit_command):
    """The tiny campaign, finished, in the folder `tiny` next to its file."""
    place = tmp_path_factory.mktemp("campaign")
    (place / "tiny.yaml").write_text(TINY)
    done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=place)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 of 2 runs are finished" in done.stdout and "exit status" not in done.stderr
    return place


@pytest.fixture
def place(finished, tmp_path):
    """A copy of the finished campaign."""
    return shutil.copytree(finished, tmp_path / "copy")


def test_all_results_are_written(finished):
    folder = finished / "tiny"
    assert sorted(p.name for p in (folder / "runs").iterdir()) == ["cp.run.nc", "cv.run.nc"]
    assert {p.stem for p in (folder / "figures").iterdir()} == {"cp", "cv"}
    assert {p.stem for p in (folder / "statistics").iterdir()} == {"cp", "cv"}
    assert not list((folder / "unfinished").iterdir())
    report = (folder / "report.md").read_text()
    assert "2 of 2 runs" in report and "| cv | cv | fused | b |" in report
    assert "![q/p and void ratio of all runs](overview.png)" in report and (folder / "overview.png").exists()


def test_the_report_explains_the_limits_that_quick_settings_exceed(finished):
    """All runs of `settings: quick` exceed the inertial limit: one table row and one sentence, not a list of runs."""
    report = (finished / "tiny/report.md").read_text()
    summary = report.splitlines()[2]
    assert "2 exceed only the limit on the inertial number, as expected of runs above the standard rate." in summary
    limits = report.split("## Limits")[1].split("##")[0]
    (row,) = [line for line in limits.splitlines() if line.startswith("| inertial number |")]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1:3] == ["0.0003", "2 of 2"] and float(cells[4]) > 3e-4
    assert float(cells[5]) == pytest.approx(float(cells[4]) / 3e-4, rel=1e-3)
    assert "2 of these runs are sheared at 4 times the standard rate (`settings: quick`)" in limits


def test_every_output_has_its_provenance(finished, labkit_command):
    for file in ("specimens/a.state.nc", "runs/cp.run.nc", "statistics/cp.nc", "figures/cp.png", "overview.png"):
        done = labkit_command("info", "--check", file, cwd=finished / "tiny")
        assert done.returncode == 0, done.stdout + done.stderr
        for label in ("command ", "created ", "libraries ", "computer ", "inputs ", "hashes"):
            assert label in done.stdout, (file, label)
        assert "differs" not in done.stdout and "missing" not in done.stdout
    assert "at-p500kPa-fused.state.nc sha256:" in labkit_command("info", "runs/cp.run.nc", cwd=finished / "tiny").stdout


def test_files_that_an_entry_reads_are_inputs_of_its_jobs(tmp_path, labkit_command):
    (tmp_path / "t.csv").write_text("strain_zz [%]\n0\n0.1\n")
    (tmp_path / "curve.csv").write_text("diameter_mm,passing_percent\n0.1,0\n0.2,100\n")
    (tmp_path / "c.yaml").write_text(
        "settings: quick\nengine: fused\n"
        "specimens: {a: {void_ratio: 0.6, grains: 150, grading: curve.csv}}\n"
        "runs:\n  b: {path: steps, specimen: a, steps: [{table: t.csv}]}\n  c: {path: cv, specimen: a, strain: 0.001}\n"
    )
    done = labkit_command("campaign", "c.yaml", "--folder", "made", cwd=tmp_path)
    assert done.returncode in (0, 1), done.stderr  # 1: few grains exceed limits
    hashes = {name: file_sha256(tmp_path / name) for name in ("t.csv", "curve.csv")}
    (tmp_path / "t.csv").unlink()  # the hash is that of the file from which the campaign was planned
    for output, inputs in {
        "specimens/a.state.nc": ["../../curve.csv"],
        "runs/b.run.nc": ["../specimens/a.state.nc", "../../t.csv"],
        "runs/c.run.nc": ["../specimens/a.state.nc"],
    }.items():
        listed = provenance_of(tmp_path / "made" / output)["inputs"]
        assert [row["file"] for row in listed] == inputs
        assert all(row["sha256"] == hashes[Path(row["file"]).name] for row in listed if row["file"].endswith("csv"))


def test_changed_parameters_repeat_what_depends_on_them_and_a_run_goes_on_from_another(place, labkit_command):
    text = TINY.replace("void_ratio: 0.62", "void_ratio: 0.63")
    (place / "tiny.yaml").write_text(text + "  back: {path: cp, specimen: cp, strain: -0.005}\n")
    before = files(place / "tiny")
    done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=place)
    assert done.returncode == 0, done.stdout + done.stderr
    after = files(place / "tiny")
    assert {name for name in after if after[name] != before.get(name)} == {"b.state.nc", "cv.run.nc", "back.run.nc"}
    runs = labkit.open_campaign(place / "tiny")
    cp, back = (runs["stress"].sel(run=name).dropna("time", how="all").values for name in ("cp", "back"))
    np.testing.assert_array_equal(back[0], cp[-1])
    assert str(runs["specimen"].sel(run="back").item()) == "cp.run.nc"


def test_what_fails_is_named_and_does_not_stop_the_others(place, labkit_command):
    """One run is unstable, and one specimen has no contacts, so that its run is not started."""
    (place / "tiny/runs/cp.run.nc").unlink()
    (place / "tiny.yaml").write_text(TINY.replace("runs:\n", APART) + UNSTABLE)
    done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=place)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert re.search("^labkit: run wild .*time_step_factor", done.stderr, re.MULTILINE)
    assert re.search("^labkit: specimen apart .*step1_friction", done.stderr, re.MULTILINE)
    assert "not started because of these failures: cv-apart" in done.stderr
    assert "2 of 4 runs" in done.stdout
    report = (place / "tiny/report.md").read_text()
    assert "run `wild`: " in report and "| cp | cp | fused |" in report and "| cv | cv |" in report
    assert "specimen `apart`: " in report and "Not started: cv-apart." in report
    (place / "tiny.yaml").write_text(TINY + UNSTABLE.replace("factor: 2", "factor: 0.2").replace("0.2,", "0.01,"))
    before = files(place / "tiny")
    done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=place)
    assert done.returncode == 0 and "3 of 3 runs" in done.stdout, done.stderr
    after = files(place / "tiny")
    assert {name: after[name] for name in before} == before
    assert "Failed" not in (place / "tiny/report.md").read_text()


def test_a_killed_campaign_repeats_no_finished_run_and_goes_on_with_the_others(finished, place, labkit_command):
    """Also when the clock was set back: Snakemake deletes a result that is older than its inputs."""
    shutil.rmtree(place / "tiny/runs")
    command = [sys.executable, "-m", "labkit.cli", "campaign", "tiny.yaml", "--cores", "1"]
    first = subprocess.Popen(command, cwd=place, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    runs = place / "tiny/runs"
    wait_until(lambda: list(runs.glob("*")), first)
    first.send_signal(signal.SIGKILL)
    first.wait()
    wait_until(lambda: not working_in(place))  # the kernel ends the whole process family
    done_runs, later = list(runs.iterdir()), time.time() + 7200.0  # the second may have ended before the signal came
    kept = [*(place / "tiny/specimens").iterdir(), *done_runs]
    numbers = {file: file.stat().st_ino for file in kept}  # a file that is written again has another
    for file in (place / "tiny/specimens/b.state.nc", *done_runs):
        os.utime(file, (later, later))
    done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=place)
    assert done.returncode == 0, done.stdout + done.stderr
    assert {file: file.stat().st_ino for file in kept} == numbers
    before, after = files(finished / "tiny"), files(place / "tiny")
    assert {name: one[1] for name, one in after.items()} == {name: one[1] for name, one in before.items()}
    made = ("specimens/b.state.nc", "runs/cv.run.nc", "statistics/cv.nc", "report.md")
    times = [os.stat(place / "tiny" / file).st_mtime_ns for file in made]
    assert times == sorted(times) and times[-1] <= time.time_ns()


def test_a_job_leaves_no_input_in_the_future(place, monkeypatch):
    """The clock may be set back while the campaign runs."""
    monkeypatch.chdir(place / "tiny")
    run, later = Path("runs/cv.run.nc"), time.time() + 7200.0
    os.utime(run, (later, later))
    Path("campaign.yaml").unlink()  # jobs read their recipe, and nothing else
    Path("plan.json").unlink()
    assert run_job("statistics", "cv") == 0
    assert run.stat().st_mtime_ns <= time.time_ns()


def test_what_comes_from_the_future_gets_the_oldest_time(tmp_path):
    """Nothing made from such a file is then made again."""
    now = time.time_ns()
    for name, at in (("old", now - 10**12), ("specimen", now + 10**13), ("run", now - 10**11)):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, ns=(at, at))
    leave_the_future([*tmp_path.iterdir(), tmp_path / "none"], oldest=True)
    times = {file.name: file.stat().st_mtime_ns for file in tmp_path.iterdir()}
    assert times == {"old": now - 10**12, "specimen": now - 10**12, "run": now - 10**11}


LONGER = TINY.replace("500 kPa, strain: 0.01", "500 kPa, strain: 0.4, save_every: 5")  # a checkpoint is near


@pytest.mark.parametrize("send, number", [(os.killpg, signal.SIGINT), (os.kill, signal.SIGTERM)])
def test_a_signal_ends_a_campaign_with_checkpoints_and_the_same_command_resumes_it(send, number, place, labkit_command):
    """From a terminal the signal reaches the process group; `kill` reaches only the first process."""
    before = files(place / "tiny")
    (place / "tiny.yaml").write_text(LONGER)
    command = [sys.executable, "-m", "labkit.cli", "campaign", "tiny.yaml", "--cores", "1"]
    first = subprocess.Popen(command, cwd=place, process_group=0, stderr=subprocess.PIPE, text=True)
    unfinished = place / "tiny/unfinished"
    wait_until(lambda: list(unfinished.glob("*.run.nc")), first)
    send(first.pid, number)
    _, stderr = first.communicate(timeout=PATIENCE)
    assert first.returncode == 128 + number and "Traceback" not in stderr
    assert stderr.splitlines()[-1] == "labkit: interrupted; repeat the same command to resume (tiny)"
    assert working_in(place) == []
    (checkpoint,) = unfinished.glob("*.run.nc")
    with netCDF4.Dataset(checkpoint) as run:
        assert run.complete == 0
    if send is os.kill:  # once is enough
        done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=place)
        assert done.returncode == 0 and "2 of 2 runs" in done.stdout, done.stderr
        assert not list(unfinished.iterdir())
        after = files(place / "tiny")
        assert {name for name in before if after[name] != before[name]} == {"cp.run.nc"}


def working_in(folder):
    """Processes whose working directory is in the folder."""
    processes = []
    for process in os.listdir("/proc"):
        if process.isdigit():
            try:
                place = os.readlink(f"/proc/{process}/cwd")
            except OSError:
                continue
            if place.startswith(str(folder)):
                processes.append(process)
    return processes


def test_a_second_campaign_in_the_same_folder_is_refused(finished, labkit_command):
    import fcntl

    lock = finished / "tiny/.campaign.lock"
    with open(lock, "w") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=finished)
    lock.unlink(missing_ok=True)
    assert done.returncode == 2 and "another campaign is running in tiny" in done.stderr


@pytest.mark.parametrize("name", ["report.md", "campaign.yaml", "recipes/soup.json", "runs/cv.run.nc"])
def test_a_folder_with_files_that_no_campaign_has_written_is_refused(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.yaml").write_text(TINY)
    own = tmp_path / "mine" / name
    own.parent.mkdir(parents=True)
    own.write_text('{"ingredients": []}')
    before = sorted(tmp_path.rglob("*"))
    assert main(["campaign", "tiny.yaml", "--folder", "mine"]) == 2
    said = f"labkit: mine/{name} is not from a campaign, and could be replaced: choose another --folder\n"
    assert capsys.readouterr().err == said
    assert sorted(tmp_path.rglob("*")) == before and own.read_text() == '{"ingredients": []}'


def test_the_path_of_python_is_quoted_for_the_shell(place, tmp_path):
    environment = tmp_path / "an $(touch hit) environment"
    environment.symlink_to(sys.prefix)
    python = environment / "bin" / Path(sys.executable).name
    for file in (place / "tiny/figures").iterdir():
        file.unlink()
    words = ["--dry-run", "--printshellcmds", "--nolock", "--rerun-triggers", "mtime", "--cores", "1"]
    command = [python, "-m", "snakemake", "--snakefile", SNAKEFILE, *words]
    done = subprocess.run(command, cwd=place / "tiny", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert f"exec {shlex.quote(str(python))} -P -m labkit.plugins.campaigns.job figure cv" in done.stdout + done.stderr


def test_a_job_of_a_killed_campaign_does_not_start(place):
    """A job still importing when the campaign was killed would go on writing, and hold the lock of its file."""
    ended, before = subprocess.Popen(["true"]), data_hash(place / "tiny/runs/cv.run.nc")
    ended.wait()
    (place / "tiny/runs/cv.run.nc").unlink()
    (place / "tiny/campaign.yaml").unlink()
    command = [sys.executable, "-m", "labkit.plugins.campaigns.job", "run", "cv"]
    environment = {**os.environ, PROCESS: str(ended.pid)}
    done = subprocess.run(command, cwd=place / "tiny", env=environment, capture_output=True, text=True)
    assert done.returncode == 1 and done.stderr == "labkit: the campaign was killed\n"
    assert not (place / "tiny/runs/cv.run.nc").exists() and not list((place / "tiny/unfinished").iterdir())
    (place / "tiny/plan.json").unlink()
    del environment[PROCESS]  # without a campaign, from its recipe alone
    assert subprocess.run(command, cwd=place / "tiny", env=environment).returncode == 0
    assert data_hash(place / "tiny/runs/cv.run.nc") == before


TWO_THREADS = """\
specimens:
  a: {void_ratio: 0.67, grains: 120}
runs:
  cv: {path: cv, specimen: a, strain: 0.01, threads: 2}
"""


def test_on_slurm_a_run_asks_for_its_threads(tmp_path):
    """Stand-ins for SLURM's programs, which know one account, record the command of Snakemake's executor."""
    pytest.importorskip("snakemake_executor_plugin_slurm", reason="needs Snakemake, the extra `campaign`")
    (tmp_path / "campaign.yaml").write_text(TWO_THREADS)
    write_plan(read_campaign(tmp_path / "campaign.yaml"), tmp_path)
    (tmp_path / "specimens").mkdir(exist_ok=True)
    (tmp_path / "specimens/a.state.nc").touch()
    programs = tmp_path / "bin"
    programs.mkdir()
    for name in ("sbatch", "sacctmgr"):
        (programs / name).write_text('#!/bin/sh\necho "$0 $*" >> asked.txt\necho abc123\n[ "$0" = "${0%sbatch}" ]\n')
        (programs / name).chmod(0o755)
    text = (PROFILES / "slurm/config.yaml").read_text()
    text = text.replace("checks: 20", "checks: 1").replace("retries: 1", "retries: 0")
    (tmp_path / "config.yaml").write_text(text.replace("# slurm_", "slurm_"))  # an account and a partition
    command = [sys.executable, "-m", "snakemake", "--snakefile", SNAKEFILE, "--nolock", "--rerun-triggers", "mtime"]
    environment = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"}
    asked = tmp_path / "asked.txt"
    with subprocess.Popen([*command, "--profile", "."], cwd=tmp_path, env=environment) as submitting:
        wait_until(lambda: asked.exists() and "--wrap" in asked.read_text(), submitting)
        submitting.kill()
    words = asked.read_text().partition("sbatch ")[2].partition("--wrap")[0].split()
    assert {"--cpus-per-task=2", "-p", "short"} < set(words)


def test_a_missing_profile_is_refused(tmp_path, labkit_command):
    (tmp_path / "tiny.yaml").write_text(TINY)
    done = labkit_command("campaign", "tiny.yaml", "--profile", "nowhere", cwd=tmp_path)
    assert done.returncode == 2
    assert "--profile nowhere is not a folder with a config.yaml: give such a folder, or slurm" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["tiny.yaml"]


def test_without_slurm_its_profile_is_refused_before_anything_starts(tmp_path, labkit_command):
    (tmp_path / "tiny.yaml").write_text(TINY)
    shutil.copytree(PROFILES / "slurm", tmp_path / "mine")
    environment = {**os.environ, "PATH": "/nowhere"}
    for profile in ("slurm", "mine"):
        words = "tiny.yaml", "--profile", profile
        done = labkit_command("campaign", *words, cwd=tmp_path, environment=environment)
        assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
        assert f"--profile {profile} needs SLURM, but its command sbatch is not on the PATH" in done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine", "tiny.yaml"]


def test_without_snakemake_the_message_tells_how_to_install_it(tmp_path):
    (tmp_path / "tiny.yaml").write_text(TINY)
    code = (
        "import importlib.util, sys\n"
        "found = importlib.util.find_spec\n"
        "importlib.util.find_spec = lambda name, *more: None if name == 'snakemake' else found(name, *more)\n"
        "from labkit import cli\n"
        "sys.exit(cli.main(['campaign', 'tiny.yaml']))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.rstrip().endswith(install_command("campaign")), done.stderr
    assert "'labkit[campaign]'" not in done.stderr  # the public index may have another package of this name
    assert [p.name for p in tmp_path.iterdir()] == ["tiny.yaml"]


def test_a_job_that_does_not_stop_is_killed_before_a_batch_system_kills_the_campaign(tmp_path, monkeypatch):
    """Everything that it started is killed too: waiting for their output would last until the last of them ends."""
    script = """
import os, signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
os.fork()
print("1 of 2 steps (50%) done", flush=True)
time.sleep(3600)
"""

    def interrupt(*_):
        raise Interrupted("stopped by signal 15", 143)

    monkeypatch.setattr(workflow, "PATIENCE", 0.1)
    (tmp_path / "logs").mkdir()
    with pytest.raises(Interrupted) as ended:
        workflow.watch([sys.executable, "-c", script], tmp_path, interrupt, dict(os.environ))
    assert ended.value.code == 143
