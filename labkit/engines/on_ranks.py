"""An engine on MPI ranks, as the run sees it."""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np

from labkit.engines.base import Engine
from labkit.engines.followers import MAKE, make_engine, start_followers
from labkit.grains.state import State
from labkit.servo.plan import Corrections


class OnRanks(Engine):
    """An engine on several ranks, as the run sees it: each call is made on all ranks, and rank 0 returns its result.

    Args:
        kind: Class of the engine; its constructor takes Ranks as `ranks`.
        state: State to load.
        threads: Number of threads of each rank.
        size: Number of ranks.
        options: Further arguments of the constructor.
    """

    def __init__(self, kind: type[Engine], state: State, threads: int, size: int, **options: object) -> None:
        """Start the followers, and load the state on all ranks."""
        vars(self).update(name=kind.name, abilities=kind.abilities)
        self._recipe, self._size = (kind, threads, options), size
        self._start(state)

    def _start(self, state: State) -> None:
        self._ranks = start_followers(self._size, self._recipe[1])
        weakref.finalize(self, self._ranks.close).atexit = False
        self._engine = self._repeat(MAKE, state, *self._recipe)
        self.version = self._engine.version

    def _repeat(self, name: str, *arguments: Any) -> Any:
        """Make a call on all ranks; after an error nobody knows how far they came, so that the followers end."""
        try:
            shares = self._recipe[0].shares_state
            self._ranks.tell(name, *(None if isinstance(value, State) and not shares else value for value in arguments))
            return make_engine(self._ranks, *arguments) if name == MAKE else getattr(self._engine, name)(*arguments)
        except BaseException:
            self._ranks.abandon()
            raise

    def load(self, state: State) -> None:
        if self._ranks.over:
            self._start(state)
        else:
            self._repeat("load", state)

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        self._repeat("advance", steps, velocity_gradient)

    def follow(self, corrections: Corrections) -> None:
        """Advance by the steps of the corrections, with the servo in the engine."""
        self._repeat("follow", corrections)

    def stress(self) -> np.ndarray:
        stress: np.ndarray = self._repeat("stress")
        return stress

    def state(self) -> State:
        state: State = self._repeat("state")
        return state

    def stop_grains(self) -> None:
        self._repeat("stop_grains")
