"""The ways in which labkit gives up, each with its exit code."""

import sys


class InputError(ValueError):
    """Something the user gave cannot be used: exit code 2, one line, nothing left behind."""


class PhysicsError(RuntimeError):
    """The simulation or a check of it failed: exit code 1."""


class Interrupted(Exception):
    """A signal ended a run after its checkpoint was written: exit code 128 + number, as shells have it."""

    def __init__(self, message, code):
        super().__init__(message)
        self.code = code


def fail(message, code):
    """Prints the one line that a command gives up with, and returns its exit code."""
    print(f"labkit: {message}", file=sys.stderr, flush=True)
    return code
