"""The scripts of yade_scripts/ as single runs and through yade-batch."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import labkit
from labkit.grains.state_file import read_state
from tests.conftest import PATIENCE

pytestmark = [pytest.mark.slow, pytest.mark.yade]

SCRIPTS = Path(__file__).resolve().parents[2] / "yade_scripts"


SENDING = f"""
import os, signal, sys
sys.path.insert(0, {str(SCRIPTS.parent)!r})
from labkit.cli import main
from tests.killed import MOMENTS, send_after
send_after(3, *MOMENTS["save"], signal.SIGTERM, os.getppid())
sys.exit(main(sys.argv[4:]))
"""  # a labkit that sends a signal to YADE, its parent, after the third save


@pytest.fixture(autouse=True)
def this_python(monkeypatch):
    monkeypatch.setenv("LABKIT_PYTHON", sys.executable)


def yade(script, *words):
    return ["yade", "-n", "-x", str(SCRIPTS / script), *map(str, words)]


def test_single_run(tmp_path, specimen_file):
    command = yade("path.py", "cv", specimen_file, "--strain", 0.002, "-o", "r.run.nc")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "left" in done.stdout  # plain lines with the time left
    assert labkit.open_run(tmp_path / "r.run.nc").attrs["complete"] == 1


def test_invalid_input_of_a_single_run(tmp_path):
    command = yade("specimen.py", "--void-ratio", 5, "-o", "s.state.nc")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and "labkit: --void-ratio 5 " in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_signal_to_yade_saves_the_run_and_the_same_command_resumes_it(tmp_path, specimen_file):
    python, file = tmp_path / "python", tmp_path / "r.run.nc"
    (tmp_path / "sending.py").write_text(SENDING)
    python.write_text(f"#!/bin/sh\nexec '{sys.executable}' '{tmp_path}/sending.py' \"$@\"\n")
    python.chmod(0o755)
    command = yade("path.py", "cv", specimen_file, "--strain", 0.004, "--record-strain", 4e-4, "-o", file)
    command += ["--save-every", "1"]
    environment = {**os.environ, "LABKIT_PYTHON": str(python)}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment)
    assert done.returncode == 128 + signal.SIGTERM and str(file) in done.stderr
    assert labkit.open_run(file).attrs["complete"] == 0
    assert subprocess.run(command, cwd=tmp_path, capture_output=True).returncode == 0
    labkit.run(
        read_state(specimen_file),
        labkit.paths.ConstantVolume(strain=0.004),
        engine="yade",
        record_strain=4e-4,
        save_every=1,
        file=tmp_path / "unbroken.run.nc",
        progress=False,
    )
    ends = [labkit.open_run(tmp_path / name)["stress"].values for name in ("r.run.nc", "unbroken.run.nc")]
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("words", [("--threads", 2), ("--engine", "fused")])
def test_other_threads_are_refused_and_another_engine_needs_no_yade(words, tmp_path, specimen_file):
    command = yade("path.py", "cv", specimen_file, "--strain", 0.0005, *words, "-o", "r.run.nc")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    if words[0] == "--engine":
        assert done.returncode == 0 and (tmp_path / "r.run.nc").exists(), done.stderr
    else:
        assert done.returncode == 2 and "this YADE was started with 1" in done.stderr, done.stderr


def test_a_labkit_that_cannot_be_found_is_one_line(tmp_path, monkeypatch):
    """The scripts are copied to a place without labkit."""
    for file in SCRIPTS.glob("*.py"):
        (tmp_path / file.name).write_text(file.read_text())
    monkeypatch.delenv("LABKIT_PYTHON")
    monkeypatch.setenv("PATH", "/usr/bin:/bin")
    command = ["yade", "-n", "-x", str(tmp_path / "path.py"), "cv", "s.state.nc"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert (
        done.stderr.splitlines()[-1].startswith("labkit: found no Python with labkit")
        and "Traceback" not in done.stderr
    )


def test_linked_scripts_start_the_labkit_of_their_own_folder(tmp_path, monkeypatch):
    """As documented for a folder with a blank in its name; this labkit says how it was called."""
    home, program = tmp_path / "my labs", tmp_path / "my labs/.venv/bin/labkit"
    shutil.copytree(SCRIPTS, home / "yade_scripts")
    program.parent.mkdir(parents=True)
    program.write_text('#!/bin/sh\necho "$@"\n')
    program.chmod(0o755)
    (tmp_path / "yade_scripts").symlink_to(home / "yade_scripts")
    monkeypatch.delenv("LABKIT_PYTHON")
    command = ["yade", "-n", "-x", "yade_scripts/path.py", "cv", "s.state.nc"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert "run --engine=yade cv s.state.nc\n" in done.stdout, done.stderr


def batch(folder, table, script):
    """Scripts in a linked folder, since yade-batch accepts no blank in a path."""
    (folder / "yade_scripts").symlink_to(SCRIPTS)
    environment = {**os.environ, "HOME": str(folder)}
    command = ["yade-batch", "--log", "%.log", "--job-threads", "1", table, f"yade_scripts/{script}"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, env=environment, timeout=PATIENCE)


def test_yade_batch_with_a_table(tmp_path):
    (tmp_path / "two.table").write_text(
        "void_ratio step1_friction grains output\n0.67 0.2 150 'a.state.nc'\n0.70 0.3 150 'b.state.nc'\n"
    )
    done = batch(tmp_path, "two.table", "specimen.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert read_state(tmp_path / "a.state.nc").number_of_grains > 100
    assert read_state(tmp_path / "b.state.nc").number_of_grains > 100


def test_an_unknown_column_of_a_table_is_reported(tmp_path):
    (tmp_path / "bad.table").write_text("void_ratio colour output\n0.67 'red' 'a.state.nc'\n")
    batch(tmp_path, "bad.table", "specimen.py")
    logs = "".join(p.read_text() for p in tmp_path.glob("*.log"))
    assert "labkit: --colour" in logs
    assert not list(tmp_path.glob("*.state.nc"))
