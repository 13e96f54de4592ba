"""Progress that shows what remains: a bar for people, plain lines for a log, a pipe between processes."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable

import numpy as np

PIPE = "LABKIT_PROGRESS_PIPE"  # set by a parent process that shows the progress itself
MARK = "\x1elabkit "
ERROR = "labkit-error: "  # of a child process, before an error as JSON


def reporter(title: str) -> Callable[[float, str], None]:
    """A function (fraction, text) for whoever looks at standard output."""
    if os.environ.get(PIPE):
        return lambda fraction, text: print(f"{MARK}{fraction:.6f} {text}", flush=True)
    if sys.stdout.isatty():
        return Bar(title)
    return Lines(title)


def read_pipe(line: str) -> tuple[float, str] | None:
    """(fraction, text) of a line that came through the pipe, or None for another line."""
    if not line.startswith(MARK):
        return None
    fraction, _, text = line[len(MARK) :].rstrip("\n").partition(" ")
    return float(fraction), text


def log_fraction(start: float, now: float, end: float) -> float:
    """How far a quantity that falls exponentially has come from start to end, 0 to 1."""
    if not 0.0 < end < start or now <= 0.0:
        return 0.0
    return float(np.clip(np.log(start / now) / np.log(start / end), 0.0, 1.0))


class Clock:
    """Says how long the rest takes, from the way made since the first call: a resumed run begins in the middle."""

    def __init__(self) -> None:
        """It starts at the first call of `left`."""
        self.began: tuple[float, float] | None = None  # fraction, s

    def left(self, fraction: float) -> str:
        """Time left, hours:minutes:seconds, when this fraction is done; `?` at first."""
        now = time.monotonic()
        if self.began is None:
            self.began = fraction, now
        made = fraction - self.began[0]
        return _words((now - self.began[1]) * (1.0 - fraction) / made) if made > 0.0 else "?"


def _words(seconds: float) -> str:
    left = round(seconds)
    return f"{left // 3600}:{left // 60 % 60:02d}:{left % 60:02d}"


class Lines:
    """A line every tenth of the way, and at least every half minute."""

    def __init__(self, title: str, fraction_step: float = 0.1, seconds_step: float = 30.0) -> None:
        """title: what begins each line."""
        self.title, self.fraction_step, self.seconds_step = title, fraction_step, seconds_step
        self.clock, self.last_time = Clock(), time.monotonic()
        self.last = None

    def __call__(self, fraction: float, text: str) -> None:
        """Prints a line if one is due."""
        now, left = time.monotonic(), self.clock.left(fraction)
        due = self.last is None or fraction - self.last >= self.fraction_step
        if due or now - self.last_time >= self.seconds_step or fraction >= 1.0 > self.last:
            print(f"{self.title}: {fraction:4.0%}, {left} left, {text}", flush=True)
            self.last, self.last_time = fraction, now


class Bar:
    """tqdm's bar where tqdm is installed, else (inside YADE) one line that is written over."""

    def __init__(self, title: str) -> None:
        """title: what stands before the bar."""
        self.title, self.clock = title, Clock()
        try:
            from tqdm import tqdm
        except ImportError:
            self.bar = None
        else:
            style = "{desc}: {percentage:3.0f}%|{bar}| {postfix}"
            self.bar = tqdm(total=1.0, desc=title, bar_format=style)

    def __call__(self, fraction: float, text: str) -> None:
        """Moves the bar to this fraction."""
        left = self.clock.left(fraction)
        if self.bar is None:
            print(f"\r\x1b[K{self.title}: {fraction:4.0%}, {left} left, {text}", end="", flush=True)
            if fraction >= 1.0:
                print()
            return
        self.bar.set_postfix_str(f"{left} left, {text}", refresh=False)
        self.bar.update(fraction - self.bar.n)
        self.bar.refresh()
        if fraction >= 1.0:
            self.bar.close()
