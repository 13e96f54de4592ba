"""The scripts of yade_scripts/ as single runs and through yade-batch."""

import os
import subprocess
from pathlib import Path

import labkit
from labkit.dem.state import read_state

SCRIPTS = Path(__file__).resolve().parents[2] / "yade_scripts"


def test_single_run(tmp_path, specimen_file):
    command = ["yade", "-n", "-x", SCRIPTS / "path.py", "cv", specimen_file, "--strain", "0.002", "-o", "r.run.nc"]
    done = subprocess.run([str(c) for c in command], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "left" in done.stdout  # plain lines with the time left
    assert labkit.open_run(tmp_path / "r.run.nc").attrs["complete"] == 1


def test_invalid_input_of_a_single_run(tmp_path):
    command = ["yade", "-n", "-x", SCRIPTS / "specimen.py", "--void-ratio", "5", "-o", "s.state.nc"]
    done = subprocess.run([str(c) for c in command], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and "labkit: --void-ratio 5 is not valid" in done.stderr
    assert not list(tmp_path.iterdir())


def batch(folder, table, script):
    environment = {**os.environ, "HOME": str(folder)}
    command = ["yade-batch", "--log", "%.log", "--job-threads", "1", table, SCRIPTS / script]
    return subprocess.run(
        [str(c) for c in command], cwd=folder, capture_output=True, text=True, env=environment, timeout=300
    )


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
    assert "column 'colour'" in logs
    assert not list(tmp_path.glob("*.state.nc"))
