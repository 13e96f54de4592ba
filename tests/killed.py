"""A run in a process of its own that dies by SIGKILL right after one of its saves, on machines of any speed."""

import os
import pickle
import signal
import subprocess
import sys

import labkit as lk
from labkit.records.recorder import Recorder


def run_killed(saves, specimen, path, file, options):
    """Run the path in another process, which is killed after the given number of saves of the file."""
    task = pickle.dumps((saves, specimen, path, file, options))
    done = subprocess.run([sys.executable, "-W", "ignore", "-m", "tests.killed"], input=task, timeout=300)
    assert done.returncode == -signal.SIGKILL


def main():
    saves, specimen, path, file, options = pickle.load(sys.stdin.buffer)
    write = Recorder._append_to_file

    def write_and_count(*arguments):
        nonlocal saves
        write(*arguments)
        saves -= 1
        if saves == 0:
            os.kill(os.getpid(), signal.SIGKILL)

    Recorder._append_to_file = write_and_count
    lk.run(specimen, path, file=file, **options)


if __name__ == "__main__":
    main()
