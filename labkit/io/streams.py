"""Standard output and error of a command, which may be closed, full, or unable to show a character."""

from __future__ import annotations

import os
import sys


def prepare_streams() -> None:
    """Replace closed streams by the null device; characters that an encoding lacks are shown as escapes."""
    for name, number in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        if stream is None:  # closed, as by `>&-`
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
            if not _is_open(number):
                os.dup2(os.open(os.devnull, os.O_WRONLY), number)  # no other file can then get this number
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def show(text: str, end: str = "\n") -> None:
    """Print progress, or drop it silently if its reader has stopped or the disk is full."""
    try:
        print(text, end=end, flush=True)
    except OSError:
        silence()


def flush_output() -> OSError | None:
    """Write the last lines of a command to standard output; returns the error, or None. A reader may stop early."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        silence()
    except OSError as error:
        silence()
        return error
    return None


def silence() -> None:
    """Send standard output to the null device from now on."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
    os.close(null)


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True
