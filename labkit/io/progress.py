"""Progress with the time left: a bar on a terminal or in a notebook, lines in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from labkit.io.streams import show


def reporter(title: str) -> Callable[[float, str], None]:
    """Return a function (fraction, text) that reports progress in the form suited to standard output."""
    if in_notebook():
        return Cell(title)
    return Bar(title) if sys.stdout.isatty() else Lines(title)


def in_notebook() -> bool:
    """True in a cell of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


def log_fraction(start: float, now: float, end: float) -> float:
    """Progress, 0 to 1, of a quantity that decays exponentially from start to end."""
    if not 0.0 < end < start or now <= 0.0:
        return 0.0
    return float(np.clip(np.log(start / now) / np.log(start / end), 0.0, 1.0))


class Clock:
    """Estimates the time left from the progress since the first call, because a resumed run starts in the middle."""

    def __init__(self) -> None:
        """Start the clock at the first call of `left`."""
        self.start: tuple[float, float] | None = None  # fraction, s

    def left(self, fraction: float) -> str:
        """Time left, hours:minutes:seconds, at this fraction; `?` at the first call."""
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

    def __init__(self, title: str, fraction_step: float = 0.1, seconds_step: float = 30.0) -> None:
        """Take the text at the start of each line."""
        self.title, self.fraction_step, self.seconds_step = title, fraction_step, seconds_step
        self.clock, self.last_time = Clock(), time.monotonic()
        self.last: float | None = None  # fraction in the last line

    def __call__(self, fraction: float, text: str) -> None:
        """Print a line if one is due."""
        now, left = time.monotonic(), self.clock.left(fraction)
        due = self.last is None or fraction - self.last >= self.fraction_step or fraction >= 1.0 > self.last
        if due or now - self.last_time >= self.seconds_step:
            show(f"{self.title}: {fraction:4.0%}, {left} left, {text}")
            self.last, self.last_time = fraction, now


class Cell:
    """A line in the output of a notebook's cell, replaced as it proceeds: a stored notebook shows the last one."""

    def __init__(self, title: str) -> None:
        """Show the text at the start of the line."""
        from IPython.display import display

        self.title, self.clock = title, Clock()
        self.shown = display({"text/plain": title}, raw=True, display_id=True)

    def __call__(self, fraction: float, text: str) -> None:
        """Replace the line."""
        bar = "#" * round(30 * fraction)
        line = f"{self.title}: {fraction:4.0%}|{bar:30}| {self.clock.left(fraction)} left, {text}"
        self.shown.update({"text/plain": line}, raw=True)


class Bar:
    """A tqdm bar on a terminal."""

    def __init__(self, title: str) -> None:
        """Take the text before the bar."""
        from tqdm import tqdm

        self.title, self.clock = title, Clock()
        self.bar = tqdm(total=1.0, desc=title, bar_format="{desc}: {percentage:3.0f}%|{bar}| {postfix}")

    def __call__(self, fraction: float, text: str) -> None:
        """Update the bar."""
        left = self.clock.left(fraction)
        self.bar.set_postfix_str(f"{left} left, {text}", refresh=False)
        self.bar.update(fraction - self.bar.n)
        self.bar.refresh()
        if fraction >= 1.0:
            self.bar.close()
