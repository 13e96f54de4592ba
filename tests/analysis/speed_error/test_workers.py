"""Worker processes: all calls are done, errors are reported, and no worker outlives the study."""

import os
import signal
import time

import pytest

from analysis.speed_error.workers import run_calls
from labkit.errors import PhysicsError
from labkit.process.interruption import stop_on_signals

pytestmark = pytest.mark.slow


def test_calls_start_in_order_and_each_is_reported_once(tmp_path):
    calls = [(write_text, (str(tmp_path / str(k)), f"{k}")) for k in range(7)]
    assert sorted(run_calls(calls, 3)) == list(range(7))
    assert sorted(file.read_text() for file in tmp_path.iterdir()) == [str(k) for k in range(7)]
    assert list(run_calls([], 3)) == []


def test_an_error_of_a_call_is_raised(tmp_path):
    with pytest.raises(PhysicsError, match="energy"):
        list(run_calls([(fail, ("the energy balance is off",))], 2))
    with pytest.raises(ZeroDivisionError):
        list(run_calls([(divmod, (1, 0))], 2))


def test_ctrl_c_reaches_the_study_alone(tmp_path):
    """Also while a run in a worker catches signals, which would end the worker before the study ends it."""
    list(run_calls([(press_ctrl_c, (str(tmp_path / "caught"),))], 1))
    assert (tmp_path / "caught").read_text() == "0"


@pytest.mark.parametrize("last", [False, True])
def test_a_worker_that_dies_is_an_error(last):
    """This includes the worker that started last, whose death concurrent.futures does not notice."""
    calls = [(kill_this_process, ()), (time.sleep, (600.0,))]
    with pytest.raises(PhysicsError, match="a worker process died"):
        list(run_calls(calls[::-1] if last else calls, 2))


def write_text(file, text):
    with open(file, "w") as opened:
        opened.write(text)


def press_ctrl_c(file):
    with stop_on_signals() as signals:
        os.kill(os.getpid(), signal.SIGINT)
        write_text(file, str(signals.caught))


def fail(message):
    raise PhysicsError(message)


def kill_this_process():
    os.kill(os.getpid(), signal.SIGKILL)
