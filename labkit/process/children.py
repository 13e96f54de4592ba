"""Starts programs that end with this process, and keeps modules of the current folder out of a Python process."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import threading
from collections.abc import Mapping, Sequence
from typing import Any


def die_with_parent() -> None:
    """Let Linux kill this process, even while it is stopped, when the thread that started it ends."""
    with contextlib.suppress(OSError, AttributeError, TypeError):  # only Linux has prctl
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def start_child(command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
    """Start a program without input that Linux kills as soon as this process ends; the options are those of Popen.

    Children of a further thread are not killed with it: they may serve other threads.
    """
    main = threading.current_thread() is threading.main_thread()
    options = {"stdin": subprocess.DEVNULL, **options}
    return subprocess.Popen(command, preexec_fn=die_with_parent if main else None, **options)


def without_current_folder(environment: Mapping[str, str], *first: str) -> dict[str, str]:
    """Return the environment of a child process, with the folders `first` in front of the entries of PYTHONPATH.

    An empty entry, which stands for the current folder, is dropped; relative entries become absolute paths.
    """
    places = filter(None, [*first, *environment.get("PYTHONPATH", "").split(os.pathsep)])
    safe = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(map(os.path.abspath, places))}
    return {**environment, **safe}
