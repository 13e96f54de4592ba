"""The thread that writes a file during the computation."""

import threading

import pytest

from labkit.records import recorder
from labkit.records.recorder import Writer
from tests.conftest import PATIENCE


def test_writes_run_beside_the_caller_and_one_at_a_time():
    beside, go, done = Writer(), threading.Event(), []
    assert beside.is_due()  # nothing has been written yet
    beside.start(lambda: done.append(go.wait(PATIENCE)))
    assert not done and not beside.is_due()  # the function is running
    go.set()
    beside.wait()
    beside.wait()
    assert done == [True]
    beside.close()


def test_an_error_of_a_write_is_raised_once_by_wait():
    beside = Writer()

    def fail():
        raise OSError("disk full")

    beside.start(fail)
    with pytest.raises(OSError, match="disk full"):
        beside.wait()
    beside.wait()
    beside.close()


def test_the_pause_between_two_writes_grows_with_their_duration(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(recorder.time, "monotonic", lambda: now[0])
    beside = Writer()

    def write():
        now[0] += 4.0

    beside.start(write)
    beside.wait()
    pause = 4.0 / recorder.SHARE
    for moment, due in ((pause - 1.0, False), (pause + 1.0, True)):
        now[0] = moment
        assert beside.is_due() == due
    beside.close()
