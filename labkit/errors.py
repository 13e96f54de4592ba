"""The two ways in which labkit gives up, each with its exit code."""


class InputError(ValueError):
    """Something the user gave cannot be used: exit code 2, one line, nothing left behind."""


class PhysicsError(RuntimeError):
    """The simulation or a check of it failed: exit code 1."""
