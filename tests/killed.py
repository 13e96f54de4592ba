"""Runs and commands in separate processes that a signal ends at a given moment, on machines of any speed.

The process sends itself the signal, right after one of its saves or progress reports.
"""

import os
import pickle
import signal
import subprocess
import sys

import labkit as lk
from labkit.cli import main
from labkit.process.progress import Lines
from labkit.records import recorder
from labkit.records.recorder import Recorder
from tests.forked import LIMIT, ROOT

MOMENTS = {
    "save": (Recorder, "_append_to_file"),
    "half a save": (recorder, "append_records"),
    "report": (Lines, "__call__"),
}


def run_killed(count, specimen, path, file, options, moment="save"):
    """Run the path in another process, which is killed after a number of saves, or half saves, of the file."""
    task = pickle.dumps((count, specimen, path, file, options, moment))
    command = [sys.executable, "-W", "ignore", "-m", "tests.killed"]
    done = subprocess.run(command, input=task, cwd=ROOT, timeout=LIMIT)
    assert done.returncode == -signal.SIGKILL


def signalled(number, moment, count, *words):
    """`labkit words` in another process, to which a signal is sent; the finished process with its output as text.

    Args:
        number: Number of the signal.
        moment: Event after which it is sent: a "save" of the run file or a "report" of the progress.
        count: Number of such events.
        words: Words of the command.
    """
    command = [sys.executable, "-m", "tests.killed", int(number), moment, count, *words]
    return subprocess.run(list(map(str, command)), cwd=ROOT, capture_output=True, text=True, timeout=LIMIT)


def send_after(count, owner, name, number, process):
    """Change a method so that its `count`-th call sends a signal to a process."""
    method = getattr(owner, name)

    def call_and_count(*arguments):
        nonlocal count
        method(*arguments)
        count -= 1
        if count == 0:
            os.kill(process, number)

    setattr(owner, name, call_and_count)


def begin():
    if len(sys.argv) == 1:
        count, specimen, path, file, options, moment = pickle.load(sys.stdin.buffer)
        send_after(count, *MOMENTS[moment], signal.SIGKILL, os.getpid())
        lk.run(specimen, path, file=file, **options)
        return 0
    number, moment, count, *words = sys.argv[1:]
    sys.argv[1:] = words
    send_after(int(count), *MOMENTS[moment], int(number), os.getpid())
    return main(words)


if __name__ == "__main__":
    sys.exit(begin())
