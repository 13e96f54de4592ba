"""Chooses the number of threads of the fused engine, which uses several threads only while they are faster than one.

All threads wait for each other twice per time step. If another program occupies a core, the thread on that core holds
up the others for a time slice of the operating system, a few milliseconds, so several threads can be twenty times as
slow as one. Results do not depend on the number of threads, so the engine may change it between any two time steps.
"""

from __future__ import annotations

import functools
import logging

WINDOW = 0.02  # duration of one measurement (s): longer than the time slices of the operating system
CHUNK = 0.002  # target duration (s) between two readings of the clock
COST = 0.01  # largest fraction of the time spent on trials with the slower number of threads
GAIN = 1.1  # factor by which several threads must be faster than one


class ThreadChoice:
    """Chooses between one and `most` threads from the measured time per step.

    `count` is the number of threads to use next. The slower number of threads is retried occasionally, so rarely that
    trials cost at most the fraction COST of the time.
    """

    def __init__(self, most: int) -> None:
        """Set the number of threads to use while the cores are free, `most`."""
        self.most, self.count = most, 1
        self._seconds: dict[int, float] = {}  # threads -> seconds per step in the last measurement
        self._steps, self._elapsed = 0, 0.0  # steps and seconds of the current measurement
        self._pause = 0.0  # time (s) until the slower number of threads is retried
        self._failures = 0  # consecutive trials in which several threads were not faster

    def steps(self, wanted: int) -> int:
        """Return the number of steps to run before the next call of `record`, at most `wanted`."""
        if self.most == 1:
            return wanted
        if self._seconds:
            return min(wanted, max(1, int(CHUNK / min(self._seconds.values()))))
        return min(wanted, max(1, self._steps))  # doubled until the first measurement is complete

    def record(self, steps: int, seconds: float) -> None:
        """Record that `steps` steps took `seconds` s on `count` threads; after a measurement choose `count` again."""
        if self.most == 1:
            return
        self._steps += steps
        self._elapsed += seconds
        if self._elapsed >= WINDOW and self._steps > 0:
            self._choose()
            self._steps, self._elapsed = 0, 0.0

    def _choose(self) -> None:
        seconds = self._seconds
        seconds[self.count] = self._elapsed / self._steps
        if len(seconds) == 1:
            self.count = self.most
            return
        several_help = GAIN * seconds[self.most] < seconds[1]
        best, other = (self.most, 1) if several_help else (1, self.most)
        if self.count == best:
            self._pause -= self._elapsed
            if self._pause <= 0.0:
                self.count = other
            return
        lost = self._elapsed - self._steps * seconds[best]
        self._pause = max(lost, WINDOW) / COST
        self._failures = 0 if several_help else self._failures + 1
        if self._failures == 2:
            warn_once(
                f"the fused engine continues on 1 thread: {self.most} threads are slower at present, probably because "
                "other programs use the cores; it tries them again from time to time"
            )
        self.count = best


@functools.cache
def warn_once(message: str) -> None:
    """Log a warning, once per process."""
    logging.getLogger("labkit").warning("labkit: %s", message)
