"""The protocol of an engine."""

from __future__ import annotations

import abc


class Engine(abc.ABC):
    """Holds a State and advances it; always stands between the forces and the motion of a step."""

    name: str
    version: str

    @abc.abstractmethod
    def advance(self, steps, velocity_gradient):
        """Moves the cell with the velocity gradient (3, 3), 1/s, for a number of steps."""

    @abc.abstractmethod
    def stress(self):
        """Love's stress now, shape (3, 3), Pa, compression positive."""

    @abc.abstractmethod
    def state(self):
        """The State now; a copy, with the contacts sorted by grain and the ledger (labkit.dem.energy) kept up."""

    @abc.abstractmethod
    def load(self, state):
        """Goes on from another state."""

    @abc.abstractmethod
    def stop_grains(self):
        """Sets all velocities to zero; the ledger counts their energy as damped."""

    def reload(self):
        """Goes on from the engine's own state, and returns it.

        A run that passes through a checkpoint so is the same, to the last bit, as one that is resumed
        from it: what an engine holds beside the state (the order of its lists) begins anew in both.
        """
        state = self.state()
        self.load(state)
        return state
