"""Number of threads of the fused engine: several only while they are faster than one.

All threads wait for each other twice per time step. If another program occupies one of the cores, each wait lasts until
the operating system gives that core back, some milliseconds, and several threads can be twenty times slower than one.
The results do not depend on the number of threads, so the engine may change it between any two time steps.
"""

from __future__ import annotations

import functools
import logging

WINDOW = 0.02  # s of one measurement, longer than the time slices of the operating system
CHUNK = 0.002  # s that the engine should run between two readings of the clock
COST = 0.01  # largest fraction of the time that may be lost in trials of the slower number of threads
GAIN = 1.1  # factor by which several threads must be faster than one


class ThreadChoice:
    """Chooses between one and `most` threads from the measured time per step.

    `count` is the number of threads to use next. The slower choice is tried again so seldom that its trials cost at
    most the fraction COST of the time.
    """

    def __init__(self, most: int) -> None:
        """most: number of threads to choose if the cores are free."""
        self.most, self.count = most, 1
        self._seconds: dict[int, float] = {}  # threads -> seconds per step, as last measured
        self._steps, self._elapsed = 0, 0.0  # of the current measurement
        self._pause = 0.0  # s until the slower choice is tried again
        self._failures = 0

    def steps(self, wanted: int) -> int:
        """Number of steps to run before `record`, at most `wanted`."""
        if self.most == 1:
            return wanted
        if self._seconds:
            return min(wanted, max(1, int(CHUNK / min(self._seconds.values()))))
        return min(wanted, max(1, self._steps))  # doubled until the first measurement is complete

    def record(self, steps: int, seconds: float) -> None:
        """Counts `steps` steps that took `seconds` s on `count` threads, and chooses anew."""
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
            report(
                f"the fused engine continues on 1 thread: {self.most} threads are slower at present, probably because "
                "other programs use the cores; it tries them again from time to time"
            )
        self.count = best


@functools.cache
def report(message: str) -> None:
    """Log a warning, once per process."""
    logging.getLogger("labkit").warning("labkit: %s", message)
