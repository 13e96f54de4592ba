"""The cuda engine: a State, or several (batch.py), on an NVIDIA GPU."""

from __future__ import annotations

import numpy as np

import labkit
from labkit.dem.engine import Engine
from labkit.dem.scene import Scene
from labkit.dem.state import State
from labkit.engines.cuda.batch import Batch
from labkit.engines.cuda.device import require_device
from labkit.errors import InputError, PhysicsError


class CudaEngine(Engine):
    """A batch of one State. Raises InputError without a GPU or numba-cuda, or for more than one thread."""

    name = "cuda"
    version = labkit.__version__

    def __init__(self, state: State, threads: int = 1) -> None:
        """Load the state; compile the kernels at the first use of a contact law. Raises InputError."""
        if threads != 1:
            raise InputError("are not used by the engine cuda", field="threads", value=threads, allowed="1")
        self.load(state)

    @classmethod
    def require(cls, scene: Scene) -> None:
        require_device()

    def load(self, state: State) -> None:
        self._batch = Batch([state])
        self._require_going()

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        self._batch.advance(steps, np.asarray(velocity_gradient)[None])
        self._require_going()

    def _require_going(self) -> None:
        """Raise PhysicsError if the state failed."""
        failure = self._batch.failures[0]
        if failure is not None:
            raise PhysicsError(failure)

    def stress(self) -> np.ndarray:
        return self._batch.stress()[0]

    def state(self) -> State:
        return self._batch.state(0)

    def stop_grains(self) -> None:
        self._batch.stop_grains(0)
