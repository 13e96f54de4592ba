"""Starts YADE as a child process of `labkit`, shows its progress, and passes on what went wrong."""

from __future__ import annotations

import collections
import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from labkit.dem.engine import Progress
from labkit.errors import InputError, Interrupted, PhysicsError
from labkit.io.progress import ERROR, PIPE, read_pipe

PACKAGE = Path(__file__).resolve().parents[1]
NOISE = ("Welcome to Yade", "Using python version", "TCP python prompt", "XMLRPC info", "Running script")


def find_yade() -> str:
    """Path of the yade program. Raises InputError with the way to get it."""
    found = shutil.which("yade")
    if not found:
        raise InputError(
            "YADE is not installed: on Debian or Ubuntu `./lab` or `sudo apt-get install yade python3-netcdf4` "
            "brings it; elsewhere see https://yade-dem.org/doc/installation.html"
        )
    return found


def find_script(name: str) -> Path:
    """Path of a script of yade_scripts: beside the package in a checkout, inside it when installed."""
    for folder in (PACKAGE.parent / "yade_scripts", PACKAGE / "yade_scripts"):
        if (folder / name).is_file():
            return folder / name
    raise InputError(f"yade_scripts/{name} is missing from this installation: install labkit again")


def yade_environment() -> dict[str, str]:
    """The environment of a YADE process: labkit on the path, nothing of a virtual environment.

    OpenMP's threads sleep while they wait: on a machine with other work, threads that spin halve YADE's speed.
    """
    environment = {"OMP_WAIT_POLICY": "PASSIVE", **os.environ, "LABKIT_ROOT": str(PACKAGE.parent)}
    for unwanted in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "DISPLAY"):
        environment.pop(unwanted, None)
    return environment


def run_script(name: str, arguments: Sequence[str], threads: int, progress: Progress) -> None:
    """Runs a script in YADE. Raises InputError or PhysicsError with the message of the child."""
    command = [find_yade(), "-n", "-x", f"-j{threads}", str(find_script(name)), *arguments]
    environment = {**yade_environment(), PIPE: "1"}
    child = subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        preexec_fn=die_with_parent,
    )
    output, complaints = child.stdout, child.stderr
    assert output is not None and complaints is not None
    errors: collections.deque[str] = collections.deque(maxlen=20)
    reader = threading.Thread(target=lambda: errors.extend(complaints), daemon=True)
    reader.start()
    try:
        with _forwarded_signals(child):
            _follow(output, progress)
            code = child.wait()
    except BaseException:  # of `progress`: YADE must not go on alone; a run writes its checkpoint
        child.terminate()
        child.wait()
        raise
    finally:
        reader.join()
        output.close()
        complaints.close()
    if code:
        _raise(code, errors)


def _follow(lines: Iterable[str], progress: Progress) -> None:
    """Passes on the progress that a child writes, and prints what else it says."""
    for line in lines:
        step = read_pipe(line)
        if step:
            progress(*step)
        elif line.strip() and not line.startswith(NOISE):
            print(line, end="")


def _raise(code: int, errors: Iterable[str]) -> NoReturn:
    told = [json.loads(line.removeprefix(ERROR)) for line in errors if line.startswith(ERROR)]
    if told:
        known = told[-1]
        if known["kind"] == "InputError":
            fields = {name: known[name] for name in ("field", "value", "allowed", "quoted")}
            raise InputError(known["said"], **fields)
        if known["kind"] == "Interrupted":
            raise Interrupted(known["said"], code)
        raise PhysicsError(known["said"])
    if code in (-signal.SIGINT, -signal.SIGTERM):
        raise Interrupted(f"stopped by signal {-code}; nothing was written", 128 - code)
    sys.stderr.writelines(line for line in errors if not line.startswith(NOISE))
    raise PhysicsError(f"YADE ended with exit status {code}")


def die_with_parent() -> None:
    """On Linux the child is killed with its parent, so that no orphan goes on writing the run file."""
    try:
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    except (OSError, AttributeError):
        pass


class _forwarded_signals:
    """While it lasts, SIGINT and SIGTERM go to the child, which decides what to do."""

    def __init__(self, child: subprocess.Popen[str]) -> None:
        self.child = child

    def __enter__(self) -> None:
        if threading.current_thread() is not threading.main_thread():
            self.before = {}
            return

        def forward(number, frame):
            return self.child.send_signal(number)

        self.before = {number: signal.signal(number, forward) for number in (signal.SIGINT, signal.SIGTERM)}

    def __exit__(self, *exception: Any) -> None:
        for number, handler in self.before.items():
            signal.signal(number, handler)
