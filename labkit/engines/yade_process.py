"""Starts YADE as a child process, shows its progress and raises its errors."""

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
from labkit.io.interruption import ending_signals
from labkit.io.progress import ERROR, PIPE, read_pipe

PACKAGE = Path(__file__).resolve().parents[1]
PROGRAMS = ("yade", "yadedaily")
NOISE = ("Welcome to Yade", "Using python version", "TCP python prompt", "XMLRPC info", "Running script")


def find_yade() -> str:
    """Path of the yade program. Raises InputError with installation instructions if it is missing.

    It is searched for on the search path (Debian, or a conda environment that is active), then next to Python and in
    $CONDA_PREFIX (a conda environment whose labkit was started without activation). `yadedaily` is the program of
    YADE's own Debian packages.
    """
    own = [str(Path(sys.executable).parent)]
    conda = [str(Path(os.environ["CONDA_PREFIX"]) / "bin")] if os.environ.get("CONDA_PREFIX") else []
    for place in (None, *own, *conda):
        for name in PROGRAMS:
            program = shutil.which(name, path=place)
            if program:
                return program
    raise InputError(
        "YADE is not installed: on Debian or Ubuntu install it with `./lab` or `sudo apt-get install yade "
        "python3-netcdf4`; elsewhere see https://yade-dem.org/doc/installation.html"
    )


def find_script(name: str) -> Path:
    """Path of a script of yade_scripts, which is next to the package in a clone and inside the installed package."""
    for folder in (PACKAGE.parent / "yade_scripts", PACKAGE / "yade_scripts"):
        if (folder / name).is_file():
            return folder / name
    raise InputError(f"yade_scripts/{name} is missing from this installation: reinstall labkit")


def yade_environment() -> dict[str, str]:
    """Environment of a YADE process: labkit on the path, without variables of a virtual environment.

    Waiting OpenMP threads sleep: spinning threads halve YADE's speed on a computer that is busy with other work.
    """
    environment = {"OMP_WAIT_POLICY": "PASSIVE", **os.environ, "LABKIT_ROOT": str(PACKAGE.parent)}
    for unwanted in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "DISPLAY"):
        environment.pop(unwanted, None)
    return environment


def run_script(name: str, arguments: Sequence[str], threads: int, progress: Progress) -> None:
    """Run a script in YADE. Raises InputError, PhysicsError or Interrupted with the message of the child."""
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
        with _ForwardedSignals(child):
            _follow(output, progress)
            code = child.wait()
    except BaseException:  # raised by `progress`: stop YADE too; a run then writes its checkpoint
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
    """Report the progress that a child prints, and print its other lines except YADE's banner."""
    for line in lines:
        step = read_pipe(line)
        if step:
            progress(*step)
        elif line.strip() and not line.startswith(NOISE):
            print(line, end="")


def _raise(code: int, errors: Iterable[str]) -> NoReturn:
    """Raise the error that the child reported, or else a PhysicsError with its exit status."""
    reported = [json.loads(line.removeprefix(ERROR)) for line in errors if line.startswith(ERROR)]
    if reported:
        error = reported[-1]
        if error["kind"] == "InputError":
            fields = {name: error[name] for name in ("field", "value", "allowed", "quoted")}
            raise InputError(error["said"], **fields)
        if error["kind"] == "Interrupted":
            raise Interrupted(error["said"], code)
        raise PhysicsError(error["said"])
    if code in (-signal.SIGINT, -signal.SIGTERM, -signal.SIGHUP):
        raise Interrupted(f"stopped by signal {-code}; nothing was written", 128 - code)
    sys.stderr.writelines(line for line in errors if not line.startswith(NOISE))
    raise PhysicsError(f"YADE ended with exit status {code}")


def die_with_parent() -> None:
    """Kill this child when its parent ends (on Linux), so that no orphan keeps writing the run file."""
    try:
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    except (OSError, AttributeError):
        pass


class _ForwardedSignals:
    """Context that forwards SIGINT, SIGTERM and SIGHUP to the child, which decides how to stop."""

    def __init__(self, child: subprocess.Popen[str]) -> None:
        self.child = child

    def __enter__(self) -> None:
        if threading.current_thread() is not threading.main_thread():
            self.before = {}
            return

        def forward(number, frame):
            return self.child.send_signal(number)

        self.before = {number: signal.signal(number, forward) for number in (signal.SIGINT, *ending_signals())}

    def __exit__(self, *exception: Any) -> None:
        for number, handler in self.before.items():
            signal.signal(number, handler)
