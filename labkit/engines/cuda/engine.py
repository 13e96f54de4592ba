"""The cuda engine: a State, or several (batch.py), on an NVIDIA GPU."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence

import numpy as np

import labkit
from labkit.dem.corrections import Corrections
from labkit.dem.engine import Engine, Start
from labkit.dem.scene import Scene
from labkit.dem.state import State
from labkit.engines.cuda.batch import Batch
from labkit.engines.cuda.build import shape_of
from labkit.engines.cuda.device import require_device
from labkit.engines.cuda.memory import memory_of, room
from labkit.engines.cuda.pool import Pool
from labkit.errors import InputError, PhysicsError


class CudaEngine(Engine):
    """A batch of one State. Raises InputError without a GPU or numba-cuda, or for more than one thread."""

    name = "cuda"
    batches = follows = True
    precisions = ("double", "mixed")
    version = labkit.__version__

    def __init__(self, state: State, threads: int = 1, precision: str = "double") -> None:
        """Load the state; compile the kernels at the first use of a contact law. Raises InputError."""
        if threads != 1:
            raise InputError("are not used by the engine cuda", field="threads", value=threads, allowed="1")
        self._precision = precision
        self._batch: Batch | None = None
        self.load(state)

    @classmethod
    def require_here(cls) -> None:
        require_device()

    @classmethod
    def batch_key(cls, scene: Scene) -> Hashable:
        law = scene.contact_law
        return law.name, shape_of(law.features(scene))

    @classmethod
    def batch_memory(cls, grains: int, precision: str = "double") -> float:
        return memory_of(grains, precision)

    @classmethod
    def batch_room(cls) -> float:
        require_device()
        return room()

    @classmethod
    def together(cls, works: Sequence[Callable[[Start], None]], precision: str = "double") -> list[Exception | None]:
        require_device()
        return Pool(works, precision).execute()

    def load(self, state: State) -> None:
        if self._batch is not None and self._batch.takes(0, state):
            self._batch.load(0, state)
        else:
            self._batch = None  # frees its memory
            self._batch = Batch([state], self._precision)
        self._require_going()

    @property
    def batch(self) -> Batch:
        """The batch of one State."""
        assert self._batch is not None, "no state is loaded"
        return self._batch

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        self.batch.advance(steps, np.asarray(velocity_gradient)[None])
        self._require_going()

    def follow(self, corrections: Corrections) -> None:
        self.batch.begin(0, corrections)
        self.batch.run()
        self._require_going()

    def _require_going(self) -> None:
        """Raise PhysicsError if the state failed."""
        failure = self.batch.failures[0]
        if failure is not None:
            raise PhysicsError(failure)

    def stress(self) -> np.ndarray:
        return self.batch.stress()[0]

    def state(self) -> State:
        return self.batch.state(0)

    def stop_grains(self) -> None:
        self.batch.stop_grains(0)
