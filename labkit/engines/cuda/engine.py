"""The cuda engine: a State, or several (batch.py), on an NVIDIA GPU."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

import labkit
from labkit.engines.base import Abilities, Engine
from labkit.engines.cuda.batch import Batch
from labkit.engines.cuda.build import shape_of
from labkit.engines.cuda.device import require_device
from labkit.engines.cuda.memory import memory_of, room
from labkit.engines.cuda.pool import Pool, Run
from labkit.errors import InputError, PhysicsError
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.servo.plan import Corrections


class CudaBatches:
    """States of several runs on one GPU."""

    def key(self, scene: Scene) -> Hashable:
        """Type and features of the contact law, which the kernels are compiled for."""
        return scene.law, shape_of(scene)

    def memory(self, grains: int, precision: str = "double") -> float:
        """Bytes on the GPU."""
        return memory_of(grains, precision)

    def room(self) -> float:
        """Bytes on the GPU of this computer. Raises InputError without one."""
        require_device()
        return room()

    def drive(self, runs: Sequence[Run], precision: str = "double") -> list[Exception | None]:
        """Carry out runs, see labkit.engines.base.Batches."""
        require_device()
        return Pool(runs, precision).execute()


class CudaEngine(Engine):
    """A batch of one State. Raises InputError without a GPU or numba-cuda, or for more than one thread."""

    name = "cuda"
    version = labkit.__version__
    abilities = Abilities(
        precisions=("double", "mixed"),
        require_computer=require_device,
        follow=lambda engine, corrections: engine.follow(corrections),
        batches=CudaBatches(),
    )

    def __init__(self, state: State, threads: int = 1, precision: str = "double") -> None:
        """Load the state; compile the kernels at the first use of a contact law. Raises InputError."""
        if threads != 1:
            raise InputError("are not used by the engine cuda", field="threads", value=threads, allowed="1")
        self._precision = precision
        self._batch: Batch | None = None
        self.load(state)

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
        """Advance by the steps of the corrections, of which the GPU runs the servo."""
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
