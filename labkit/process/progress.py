"""Shows progress and the time left: a bar on a terminal or in a notebook, lines in a log."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable

import numpy as np

from labkit.process.streams import show

FRACTION, SECONDS = 0.1, 30.0  # between two lines of a log: least progress, and longest time (s)


def reporter(title: str) -> Callable[[float, str], None]:
    """Return a function of (fraction, text) that reports progress in the form suited to standard output."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if hasattr(shell, "kernel"):  # a notebook
        return Bar(title, writer_in_cell(title))
    return Bar(title, on_terminal) if sys.stdout.isatty() else Lines(title)


def log_fraction(start: float, now: float, end: float) -> float:
    """Return the progress, 0 to 1, of a quantity that decays exponentially from start to end."""
    if not 0.0 < end < start or now <= 0.0:
        return 0.0
    return float(np.clip(np.log(start / now) / np.log(start / end), 0.0, 1.0))


class Clock:
    """Estimates the time left from the progress since the first call, because a resumed run starts in the middle."""

    def __init__(self) -> None:
        """Wait for the first call of `time_left`, which starts the clock."""
        self.start: tuple[float, float] | None = None  # fraction, s

    def time_left(self, fraction: float) -> str:
        """Return the time left, hours:minutes:seconds, at a completed fraction; `?` at the first call."""
        now = time.monotonic()
        if self.start is None:
            self.start = fraction, now
        progress = fraction - self.start[0]
        return time_text((now - self.start[1]) * (1.0 - fraction) / progress) if progress > 0.0 else "?"


def time_text(seconds: float) -> str:
    """Format a time in s as hours:minutes:seconds."""
    seconds = round(seconds)
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"


class Lines:
    """Prints a line for every tenth of the progress, and at least every half minute."""

    def __init__(self, title: str) -> None:
        """Store the text at the start of each line."""
        self.title = title
        self.clock, self.last_time = Clock(), time.monotonic()
        self.last: float | None = None  # fraction in the last line

    def __call__(self, fraction: float, text: str) -> None:
        """Print a line if one is due."""
        now, left = time.monotonic(), self.clock.time_left(fraction)
        due = self.last is None or fraction - self.last >= FRACTION or fraction >= 1.0 > self.last
        if due or now - self.last_time >= SECONDS:
            show(f"{self.title}: {fraction:4.0%}, {left} left, {text}")
            self.last, self.last_time = fraction, now


class Bar:
    """A line with a bar, replaced at each report, on a terminal or in a notebook, which stores the last line."""

    def __init__(self, title: str, write: Callable[[str], None]) -> None:
        """Store the text at the start of the line, and the function that shows the line."""
        self.title, self.write, self.clock, self.last = title, write, Clock(), 0.0

    def __call__(self, fraction: float, text: str) -> None:
        """Replace the line."""
        bar = "#" * round(30 * fraction)
        self.write(f"{self.title}: {fraction:4.0%}|{bar:30}| {self.clock.time_left(fraction)} left, {text}")
        if fraction >= 1.0 > self.last and self.write is on_terminal:
            show("")
        self.last = fraction


def on_terminal(line: str) -> None:
    """Show a line on a terminal in place of the previous line."""
    width = shutil.get_terminal_size().columns - 1
    show(f"{line[:width]:{width}}", again=True)


def writer_in_cell(title: str) -> Callable[[str], None]:
    """Return a function that shows a line in the output of a notebook cell, in place of the previous line."""
    from IPython.display import display

    shown = display({"text/plain": title}, raw=True, display_id=True)
    return lambda line: shown.update({"text/plain": line}, raw=True)
