"""The live view in the terminal: redraws, marks and states of several runs, one of them growing."""

import contextlib
import os
import pty
import re
import select
import shutil
import sys

import numpy as np
import pytest

import labkit
from labkit.cli import main
from labkit.io.interruption import only_writer
from labkit.watch.terminal import CLEAR, MARKS, draw, read_records, status
from tests.changed import changed
from tests.conftest import PATIENCE

LABKIT = [sys.executable, "-m", "labkit.cli"]


@pytest.fixture(scope="module")
def unfinished(run_file, tmp_path_factory):
    """The run file with its end removed: an interrupted run."""
    file = tmp_path_factory.mktemp("unfinished") / "unfinished.run.nc"
    shutil.copy(run_file, file)
    with changed(file) as dataset:
        dataset.complete = np.int32(0)
    return file


def test_every_run_has_its_own_mark():
    assert len(set(MARKS)) == len(MARKS) > 50


def test_all_redraws_have_the_same_shape(run_file):
    """Panels of an earlier drawing must not remain."""
    runs = {"a": read_records(run_file), "b": read_records(run_file)}
    assert len({draw(runs, 100, 24) for _ in range(4)}) == 1
    assert sum(line.count("┌") for line in draw(runs, 100, 24).splitlines()) == 3


def test_the_records_are_those_of_the_run(run_file):
    opened, shown = labkit.open_run(run_file), read_records(run_file)
    for name in shown.data_vars:
        assert (shown[name].values == opened[name].values).all()


def test_a_run_is_complete_interrupted_or_running(run_file, unfinished):
    assert " complete, " in status("a", read_records(run_file), False)
    assert " interrupted, " in status("a", read_records(unfinished), False)
    assert " running, " in status("a", read_records(unfinished), True)


def read(terminal):
    """Bytes that a process wrote to its terminal. Raises OSError when it has ended."""
    assert select.select([terminal], [], [], PATIENCE)[0], f"nothing is shown for {PATIENCE} s"
    return os.read(terminal, 65536)


def test_several_redraws_in_a_terminal(run_file, unfinished, tmp_path):
    """One run is being written for some seconds, another is interrupted, a third is complete."""
    growing = tmp_path / "growing.run.nc"
    shutil.copy(unfinished, growing)
    files = [str(file) for file in (growing, unfinished, run_file)]
    with only_writer(growing):
        process, terminal = pty.fork()
        if process == 0:
            os.execve(sys.executable, [*LABKIT, "watch", "--interval", "1", *files], {**os.environ, "COLUMNS": "100"})
        shown = b""
        while shown.count(CLEAR.encode()) < 4:
            shown += read(terminal)
    with contextlib.suppress(OSError):  # the process has ended
        while more := read(terminal):
            shown += more
    assert os.waitpid(process, 0)[1] == 0
    text = shown.decode()
    frames = [frame.replace("\r", "") for frame in text.split(CLEAR)[1:]]
    assert len(frames) >= 4
    for frame in frames:
        assert len(frame.splitlines()) == len(frames[0].splitlines())
        assert frame.count("┌") == 3 and "Traceback" not in frame
    for name, mark, state in (
        ("growing", "*", "running"),
        ("unfinished", "o", "interrupted"),
        ("small", "+", "complete"),
    ):
        assert re.search(rf"^{re.escape(mark)} {name}: cv {state}", frames[0], re.MULTILINE), frames[0]


def test_a_run_that_is_saved_again_and_again_can_be_read(specimen_file, tmp_path):
    file, lengths = tmp_path / "growing.run.nc", []

    def read(fraction, text):
        if file.exists():
            lengths.append(read_records(file).sizes["time"])

    path = labkit.paths.ConstantVolume(strain=0.02)
    labkit.run(labkit.read_state(specimen_file), path, file=file, save_every=1, progress=read)
    assert lengths == sorted(lengths) and len(set(lengths)) > 3


def test_a_single_drawing(run_file, labkit_command):
    done = labkit_command("watch", "--once", run_file)
    assert done.returncode == 0, done.stderr
    assert "axial strain 2.00%" in done.stdout and "error of C0" in done.stdout
    assert sum(line.count("│") > 3 for line in done.stdout.splitlines()) > 8


def test_the_view_ends_when_the_runs_are_complete(run_file, labkit_command):
    assert labkit_command("watch", "--interval", 3600, run_file).returncode == 0


def test_a_state_file_is_refused(specimen_file, labkit_command):
    done = labkit_command("watch", "--once", specimen_file)
    assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1


def test_without_plotext_the_message_names_what_to_install(run_file, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "plotext", None)
    assert main(["watch", str(run_file), "--once"]) == 2
    assert "pip install" in capsys.readouterr().err
