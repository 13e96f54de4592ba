"""Standard output and error of a command, which may be closed, on a full disk, or unable to show a character."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from io import TextIOWrapper
from typing import Any, TextIO

from labkit.errors import printable


class Printer:
    """A stream that prints control characters as escapes, because a text may come from a file of someone else."""

    def __init__(self, stream: TextIO) -> None:
        """Store the stream that receives the text."""
        self.stream = stream

    def write(self, text: str) -> int:
        """Write a text; returns the number of its characters."""
        self.stream.write(printable(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


class Messages(Printer):
    """Standard error, whose text is dropped once it cannot be written: a run counts more than its messages."""

    def write(self, text: str) -> int:
        """Write a text if it can be written; returns the number of its characters."""
        try:
            return super().write(text)
        except OSError:
            silence(self.stream)
            return len(text)

    def flush(self) -> None:
        """Write what is left, if it can be written."""
        try:
            self.stream.flush()
        except OSError:
            silence(self.stream)


@contextlib.contextmanager
def usable_streams() -> Iterator[None]:
    """Context in which characters missing in an encoding, and control characters, are printed as escapes.

    Closed streams are replaced.
    """
    with contextlib.ExitStack() as restored:
        for name, number, kind in (("stdout", 1, Printer), ("stderr", 2, Messages)):
            stream = getattr(sys, name)
            if stream is None:  # closed, as by `>&-`
                setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
                if not os.path.exists(f"/proc/self/fd/{number}"):
                    os.dup2(os.open(os.devnull, os.O_WRONLY), number)  # so that no other file gets this number
            elif hasattr(stream, "reconfigure"):
                restored.callback(_show_unknown, stream, stream.errors)
                _show_unknown(stream, "backslashreplace")
            if not isinstance(stream, Printer | None):
                restored.callback(setattr, sys, name, stream)
                setattr(sys, name, kind(stream))
        yield


def _show_unknown(stream: TextIOWrapper, how: str) -> None:
    """Choose how a stream prints characters that are missing in its encoding."""
    with contextlib.suppress(OSError):  # a full disk; the last flush reports the error
        stream.reconfigure(errors=how)


def show(text: str, again: bool = False) -> None:
    """Print a line of progress, in place of the previous line if `again`.

    The line is dropped silently if the reader of the output has stopped or the disk is full.
    """
    stream = getattr(sys.stdout, "stream", sys.stdout)
    try:
        print("\r" * again + printable(text), end="" if again else "\n", file=stream, flush=True)
    except OSError:
        silence(stream)


def flush_output() -> OSError | None:
    """Write the last lines of a command to standard output; return an error or None. The reader may stop early."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        silence(sys.stdout)
    except OSError as error:
        silence(sys.stdout)
        return error
    return None


def silence(stream: TextIO) -> None:
    """Send standard output or error to the null device from now on."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, stream.fileno())
    os.close(null)
