"""Runs an engine in a child process, shows its progress and raises its errors."""

from __future__ import annotations

import collections
import ctypes
import dataclasses
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from labkit.dem.engine import Progress
from labkit.errors import InputError, Interrupted, PhysicsError
from labkit.io.interruption import ending_signals
from labkit.io.progress import ERROR, read_pipe


@dataclasses.dataclass(frozen=True)
class Program:
    """What runs in the child process.

    name: for messages; noise: beginnings of lines that are not shown; number_file: file in which the process that
    decides how to stop writes its number, if that is not the child itself. The child is then kept from the signals of
    the terminal.
    """

    name: str
    noise: tuple[str, ...] = ()
    number_file: Path | None = None

    def send(self, number: int, child: subprocess.Popen[str]) -> None:
        """Send a signal to the process that decides how to stop."""
        if self.number_file is None:
            child.send_signal(number)
        elif self.number_file.exists():
            os.kill(int(self.number_file.read_text()), number)
        else:  # still starting: nothing to save
            child.send_signal(number)


def run_child(command: Sequence[str], environment: Mapping[str, str], progress: Progress, program: Program) -> None:
    """Run a command to its end. Raises InputError, PhysicsError or Interrupted with the message of the child."""
    child = subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        preexec_fn=die_with_parent,
        start_new_session=program.number_file is not None,
    )
    output, complaints = child.stdout, child.stderr
    assert output is not None and complaints is not None
    errors: collections.deque[str] = collections.deque(maxlen=20)
    reader = threading.Thread(target=lambda: errors.extend(complaints), daemon=True)
    reader.start()
    try:
        with _ForwardedSignals(child, program):
            _follow(output, progress, program.noise)
            code = child.wait()
    except BaseException:  # raised by `progress`: stop the engine too; a run then writes its checkpoint
        program.send(signal.SIGTERM, child)
        child.wait()
        raise
    finally:
        reader.join()
        output.close()
        complaints.close()
    _raise_reported(code, errors, program)


def _follow(lines: Iterable[str], progress: Progress, noise: tuple[str, ...]) -> None:
    """Report the progress that a child prints, and print its other lines except noise."""
    for line in lines:
        step = read_pipe(line)
        if step:
            progress(*step)
        elif line.strip() and not line.startswith(noise):
            print(line, end="")


def _raise_reported(code: int, errors: Iterable[str], program: Program) -> None:
    """Raise the error that the child reported, or else a PhysicsError if its exit status is not zero."""
    reported = [json.loads(line.removeprefix(ERROR)) for line in errors if line.startswith(ERROR)]
    if reported:
        _raise(reported[-1])
    if code in (-signal.SIGINT, -signal.SIGTERM, -signal.SIGHUP):
        raise Interrupted(f"stopped by signal {-code}; nothing was written", 128 - code)
    if code:
        sys.stderr.writelines(line for line in errors if not line.startswith(program.noise))
        raise PhysicsError(f"{program.name} ended with exit status {code}")


def _raise(error: Mapping[str, Any]) -> NoReturn:
    if error["kind"] == "InputError":
        fields = {name: error[name] for name in ("field", "value", "allowed", "quoted")}
        raise InputError(error["said"], **fields)
    if error["kind"] == "Interrupted":
        raise Interrupted(error["said"], error["code"])
    raise PhysicsError(error["said"])


def die_with_parent() -> None:
    """Kill this child when its parent ends (on Linux), so that no orphan keeps writing the run file."""
    try:
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    except (OSError, AttributeError):
        pass


class _ForwardedSignals:
    """Context that forwards SIGINT, SIGTERM and SIGHUP to the child, which decides how to stop."""

    def __init__(self, child: subprocess.Popen[str], program: Program) -> None:
        self.child, self.program = child, program

    def __enter__(self) -> None:
        if threading.current_thread() is not threading.main_thread():
            self.before = {}
            return

        def forward(number, frame):
            return self.program.send(number, self.child)

        self.before = {number: signal.signal(number, forward) for number in (signal.SIGINT, *ending_signals())}

    def __exit__(self, *exception: Any) -> None:
        for number, handler in self.before.items():
            signal.signal(number, handler)
