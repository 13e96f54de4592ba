"""A tiny campaign carried out by Snakemake: resumed, changed, killed, with a run that fails. Real processes."""

import os
import shutil
import signal
import subprocess
import sys
import time

import netCDF4
import pytest

pytest.importorskip("snakemake", reason="needs Snakemake: pip install 'labkit[campaign]'")

TINY = """\
settings: quick
engine: fused
snapshots: 2
specimens:
  a: {void_ratio: 0.606, step1_friction: 0.06, grains: 120}
  b: {void_ratio: 0.62, step1_friction: 0.06, grains: 120}
runs:
  cv: {path: cv, specimen: [a, b], strain: 0.01}
  cp: {path: cp, specimen: a, pressure: 500 kPa, strain: 0.01}
"""
UNSTABLE = "  wild: {path: cv, specimen: a, strain: 0.2, time_step_factor: 2}\n"


def files(folder):
    """Name -> (time of change, hash of the data) of what took simulation to make."""
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
    """The tiny campaign, done, in the folder `tiny` beside its file."""
    place = tmp_path_factory.mktemp("campaign")
    (place / "tiny.yaml").write_text(TINY)
    done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=place)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 of 3 runs are finished" in done.stdout
    return place


@pytest.fixture
def place(finished, tmp_path):
    """A copy of the finished campaign."""
    return shutil.copytree(finished, tmp_path / "copy")


def test_everything_is_there(finished):
    folder = finished / "tiny"
    assert sorted(p.name for p in (folder / "runs").iterdir()) == ["cp.run.nc", "cv-a.run.nc", "cv-b.run.nc"]
    assert {p.stem for p in (folder / "figures").iterdir()} == {"cp", "cv-a", "cv-b"}
    assert {p.stem for p in (folder / "statistics").iterdir()} == {"cp", "cv-a", "cv-b"}
    assert not list((folder / "unfinished").iterdir())
    report = (folder / "report.md").read_text()
    assert "3 of 3 runs are finished" in report and "| cv-b | cv | fused | b |" in report


def test_every_output_says_where_it_comes_from(finished, labkit_command):
    for file in ("specimens/a.state.nc", "runs/cp.run.nc", "statistics/cp.nc", "figures/cp.png"):
        done = labkit_command("info", "--check", file, cwd=finished / "tiny")
        assert done.returncode == 0, done.stdout + done.stderr
        for words in ("command ", "made ", "libraries ", "machine ", "inputs ", "hashes"):
            assert words in done.stdout, (file, words)
        assert "differs" not in done.stdout and "missing" not in done.stdout
    assert "at-p500kPa-fused.state.nc sha256:" in labkit_command("info", "runs/cp.run.nc", cwd=finished / "tiny").stdout


def test_a_second_start_does_nothing(place, labkit_command):
    before = files(place / "tiny")
    done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=place)
    assert done.returncode == 0, done.stderr
    assert files(place / "tiny") == before
    assert "Nothing to be done" in (place / "tiny/logs/snakemake.log").read_text()


def test_changed_parameters_repeat_what_depends_on_them(place, labkit_command):
    before = files(place / "tiny")
    (place / "tiny.yaml").write_text(TINY.replace("void_ratio: 0.62", "void_ratio: 0.63"))
    done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=place)
    assert done.returncode == 0, done.stderr
    after = files(place / "tiny")
    assert {name for name in before if after[name] != before[name]} == {"b.state.nc", "cv-b.run.nc"}
    (place / "tiny.yaml").write_text(TINY.replace("strain: 0.01}\n  cp", "strain: 0.011}\n  cp"))
    labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=place)
    last = files(place / "tiny")
    assert {name for name in after if after[name] != last[name]} == {"b.state.nc", "cv-a.run.nc", "cv-b.run.nc"}
    assert last["b.state.nc"][1] == before["b.state.nc"][1]


def test_one_failed_run_does_not_stop_the_others_and_is_named(place, labkit_command):
    shutil.rmtree(place / "tiny/runs")
    (place / "tiny.yaml").write_text(TINY + UNSTABLE)
    done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=place)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "run wild failed: the time step" in done.stderr and "lower time_step_factor from 2" in done.stderr
    assert "3 of 4 runs are finished" in done.stdout
    report = (place / "tiny/report.md").read_text()
    assert "run `wild`: the time step" in report and "| cp | cp | fused |" in report
    (place / "tiny.yaml").write_text(TINY + UNSTABLE.replace("factor: 2", "factor: 0.2").replace("0.2,", "0.01,"))
    before = files(place / "tiny")
    done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=place)
    assert done.returncode == 0 and "4 of 4 runs are finished" in done.stdout, done.stderr
    after = files(place / "tiny")
    assert {name: after[name] for name in before} == before
    assert "Failed" not in (place / "tiny/report.md").read_text()


def test_a_killed_campaign_repeats_no_finished_run_and_goes_on_with_the_others(finished, tmp_path, labkit_command):
    (tmp_path / "tiny.yaml").write_text(TINY)
    command = [sys.executable, "-m", "labkit.cli", "campaign", "tiny.yaml", "--cores", "1"]
    first = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    runs = tmp_path / "tiny/runs"
    end = time.monotonic() + 300
    while not (runs.is_dir() and any(runs.iterdir())):
        assert first.poll() is None and time.monotonic() < end, "no run was finished"
        time.sleep(0.01)
    first.send_signal(signal.SIGKILL)
    first.wait()
    while working_in(tmp_path):  # the kernel takes the whole family
        assert time.monotonic() < end
        time.sleep(0.01)
    before = files(tmp_path / "tiny")
    assert 1 <= sum(name.endswith("run.nc") for name in before) < 3
    done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    after = files(tmp_path / "tiny")
    assert {name: after[name] for name in before} == before
    assert {name: one[1] for name, one in after.items()} == {n: one[1] for n, one in files(finished / "tiny").items()}


def working_in(folder):
    """Processes whose working directory is in the folder."""
    found = []
    for process in os.listdir("/proc"):
        if process.isdigit():
            try:
                place = os.readlink(f"/proc/{process}/cwd")
            except OSError:
                continue
            if place.startswith(str(folder)):
                found.append(process)
    return found


def test_a_second_campaign_in_the_same_folder_is_refused(finished, labkit_command):
    import fcntl

    lock = finished / "tiny/.campaign.lock"
    with open(lock, "w") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        done = labkit_command("campaign", "tiny.yaml", "--cores", 1, cwd=finished)
    lock.unlink(missing_ok=True)
    assert done.returncode == 2 and "another campaign is under way in tiny" in done.stderr


def test_a_broken_file_starts_nothing(tmp_path, labkit_command):
    (tmp_path / "bad.yaml").write_text("specimens:\n  a: {void_ratio: 9}\nruns:\n  r: {path: cx, specimen: a}\n")
    for words in ([], ["--dry-run"]):
        done = labkit_command("campaign", "bad.yaml", *words, cwd=tmp_path)
        assert done.returncode == 2 and "has 2 mistakes, nothing was started" in done.stderr
        assert "line 2: " in done.stderr and "line 4: " in done.stderr and "Traceback" not in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["bad.yaml"]


def test_a_profile_that_is_not_there_is_refused(tmp_path, labkit_command):
    (tmp_path / "tiny.yaml").write_text(TINY)
    done = labkit_command("campaign", "tiny.yaml", "--profile", "nowhere", cwd=tmp_path)
    assert done.returncode == 2
    assert "--profile nowhere is not a folder with a config.yaml: give one, or slurm" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["tiny.yaml"]


def test_a_specimen_that_fails_keeps_its_runs_from_beginning(tmp_path, labkit_command):
    (tmp_path / "loose.yaml").write_text(
        "settings: quick\nengine: fused\nsnapshots: 1\nspecimens:\n"
        "  a: {void_ratio: 0.606, step1_friction: 0.06, grains: 120}\n  apart: {void_ratio: 1.4, grains: 120}\n"
        "runs:\n  cv: {path: cv, specimen: [a, apart], strain: 0.005}\n"
    )
    done = labkit_command("campaign", "loose.yaml", "--cores", 1, cwd=tmp_path)
    assert done.returncode == 1 and "specimen apart failed: the grains have come apart" in done.stderr
    assert "not begun because of these: cv-apart" in done.stderr and "1 of 2 runs are finished" in done.stdout
    report = (tmp_path / "loose/report.md").read_text()
    assert "specimen `apart`: the grains" in report and "Not begun: cv-apart." in report and "| cv-a | cv |" in report


def test_without_snakemake_the_way_to_get_it_is_told(tmp_path):
    (tmp_path / "tiny.yaml").write_text(TINY)
    code = (
        "import importlib.util, sys\n"
        "found = importlib.util.find_spec\n"
        "importlib.util.find_spec = lambda name, *more: None if name == 'snakemake' else found(name, *more)\n"
        "from labkit import cli\n"
        "sys.exit(cli.main(['campaign', 'tiny.yaml']))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and "pip install 'labkit[campaign]'" in done.stderr, done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["tiny.yaml"]
