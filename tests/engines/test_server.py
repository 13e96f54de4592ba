"""Servers that die, hang or speak another version, and the messages. All with real YADE."""

import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

import labkit as lk
from analysis.hard_cases.outcome import CRASH
from labkit.engines import server
from labkit.engines.server import Message
from labkit.engines.yade import YadeEngine
from labkit.errors import PhysicsError
from tests.conftest import wait_until
from tests.engines.peek import PeekingEngine

pytestmark = [pytest.mark.slow, pytest.mark.yade]

PATH = lk.paths.ConstantVolume(strain=0.004)


@pytest.fixture(scope="module")
def state(specimen_file):
    return lk.read_state(specimen_file)


def yades(parent):
    """Numbers of the YADE servers that a process has started."""
    done = subprocess.run(["pgrep", "-P", str(parent), "-f", "yade_scripts/server.py"], capture_output=True, text=True)
    return {int(word) for word in done.stdout.split()}


@given(
    st.dictionaries(st.text(max_size=5), st.integers(-9, 9) | st.floats(allow_nan=False) | st.text(max_size=5)),
    st.lists(npst.arrays(st.sampled_from(["<f8", "<i4", "<i8"]), npst.array_shapes(min_dims=0, min_side=0))),
)
def test_a_message_arrives_as_it_was_sent(values, arrays):
    mine, its = socket.socketpair()
    sent = Message("state", values, {f"a{number}": array for number, array in enumerate(arrays)})
    with mine, its:
        threading.Thread(target=server.send, args=(mine, sent)).start()
        got = server.receive(its)
    assert (got.name, got.values, list(got.arrays)) == (sent.name, sent.values, list(sent.arrays))
    for a, b in zip(got.arrays.values(), arrays, strict=True):
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())


def test_a_run_whose_yade_is_killed_can_be_resumed(state, tmp_path):
    file, options = tmp_path / "r.run.nc", {"engine": "yade", "record_strain": 4e-4, "save_every": 1}

    def kill(fraction, text):
        if fraction > 0.4:
            for number in yades(os.getpid()):
                os.kill(number, signal.SIGKILL)

    with pytest.raises(PhysicsError, match=r"YADE was killed by signal 9 \(\w+\); give the same command") as error:
        lk.run(state, PATH, file=file, progress=kill, **options)
    stopped = lk.open_run(file)
    assert 0 < stopped.sizes["time"] < 11 and stopped.attrs["complete"] == 0
    assert f"r.run.nc holds {stopped.sizes['time']} record" in str(error.value)
    stopped.close()
    resumed = lk.run(state, PATH, file=file, progress=False, **options)
    whole = lk.run(state, PATH, file=tmp_path / "whole.run.nc", progress=False, **options)
    for name in ("stress", "strain", "kinetic_energy"):
        np.testing.assert_array_equal(resumed.data[name].values, whole.data[name].values)


@pytest.mark.parametrize("before", [signal.SIGCONT, signal.SIGSTOP])
def test_yade_ends_when_labkit_is_killed(before, specimen_file, tmp_path):
    words = ["run", "cv", specimen_file, "--engine", "yade", "--strain", "0.1", "-o", tmp_path / "r.run.nc"]
    process = subprocess.Popen([sys.executable, "-m", "labkit.cli", *map(str, words)], stderr=subprocess.DEVNULL)
    wait_until((tmp_path / "r.run.nc").exists, process)
    (number,) = yades(process.pid)
    os.kill(number, before)
    process.kill()
    process.wait()
    wait_until(lambda: not Path(f"/proc/{number}").exists())


def test_yade_outlives_the_thread_that_started_it(state, monkeypatch):
    monkeypatch.setattr(server, "IDLE", type(server.IDLE)(list))
    started = []
    thread = threading.Thread(target=lambda: started.append(YadeEngine(state)))
    thread.start()
    thread.join()
    started[0].advance(1, np.zeros((3, 3)))


def test_a_yade_that_hangs_is_given_up(state, monkeypatch):
    monkeypatch.setattr(server, "IDLE", type(server.IDLE)(list))
    engine = YadeEngine(state)
    engine.server.peer.settimeout(0.5)
    process = engine.server.process
    process.send_signal(signal.SIGSTOP)
    with pytest.raises(PhysicsError, match=r"YADE has not answered for 0.5 s \(advance\)"):
        engine.advance(10, np.zeros((3, 3)))
    assert process.poll() == -signal.SIGKILL
    YadeEngine(state).advance(1, np.zeros((3, 3)))  # a new server is started


def test_a_server_that_reported_an_error_ends_by_itself_however_long_it_takes(state, monkeypatch):
    monkeypatch.setattr(server, "IDLE", type(server.IDLE)(list))
    monkeypatch.setattr(server, "ENDING", 0.0)
    idle = YadeEngine(state).server
    with pytest.raises(PhysicsError, match="YADE stopped"):
        idle.ask("advance")
    idle.close()
    assert idle.process.returncode == 0


def test_a_long_advance_is_no_silence(state, monkeypatch):
    """The server reports between time steps that it is alive, here after each step, as if a step took 10 s."""
    monkeypatch.setattr(server, "IDLE", type(server.IDLE)(list))
    engine = PeekingEngine(state)
    engine.evaluate("setattr(__import__('server'), 'SILENCE', 0.0)")
    names, receive = [], server.receive

    def counted(peer):
        names.append((got := receive(peer)).name)
        return got

    monkeypatch.setattr(server, "receive", counted)
    engine.advance(5, np.zeros((3, 3)))
    assert names == [*["alive"] * 5, "advance"]


def test_another_version_is_refused():
    mine, its = socket.socketpair()
    with its:
        server.send(its, Message("hello", {"protocol": 0, "version": "1", "threads": 1}, {}))
        with pytest.raises(PhysicsError, match="speaks version 0 of labkit's messages, labkit 2: use the scripts"):
            server.Server("YADE", mine)


def test_an_error_inside_yade_is_one_line_and_the_server_is_of_use_afterwards(state):
    engine = YadeEngine(state)
    with pytest.raises(PhysicsError, match=r"YADE stopped: KeyError: 'steps'$"):
        engine.server.ask("advance")
    engine.load(state)
    assert engine.state().number_of_grains == state.number_of_grains


@pytest.mark.parametrize(
    "lines, quoted",
    [
        (["Hello", "I am another program"], "I am another program"),
        (["THE EXIT STRING: Killed (signal 9)", "Please see the FAQ page"], r"THE EXIT STRING: Killed \(signal 9\)"),
    ],
)
def test_a_program_that_is_not_yade_is_reported(lines, quoted, state, tmp_path, monkeypatch):
    """The report quotes its last line or, because MPICH ends with advice, MPICH's line on how a rank ended."""
    program = tmp_path / "yade"
    program.write_text("#!/bin/sh\n" + "".join(f"echo '{line}'\n" for line in lines) + "exit 3\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.setattr(server, "IDLE", type(server.IDLE)(list))
    with pytest.raises(PhysicsError, match=f"^{CRASH} 3, its last line: {quoted}"):
        lk.run(state, PATH, engine="yade", progress=False)
