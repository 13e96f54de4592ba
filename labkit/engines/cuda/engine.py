"""The cuda engine: one State, or several (batch.py), on an NVIDIA GPU."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from labkit.engines.base import Abilities, Run
from labkit.engines.cuda.batch import Batch
from labkit.engines.cuda.build import shape_of
from labkit.engines.cuda.device import require_device
from labkit.engines.cuda.memory import memory_of, room
from labkit.engines.cuda.pool import BatchEngine, Pool
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.servo.plan import Corrections


def _require_scene(scene: Scene) -> None:
    """Raise InputError for a contact law that acts at a distance."""
    if scene.contact_law.keeps_links:
        problem = f"does not support contacts across a gap, as in the law {scene.law}"
        raise InputError(problem, field="engine", value="cuda", allowed="fused")


class CudaBatches:
    """States of several runs on one GPU."""

    def key(self, scene: Scene) -> Hashable:
        """Type and features of the contact law, for which the kernels are compiled."""
        return scene.law, shape_of(scene)

    def memory(self, grains: int, precision: str = "double") -> float:
        """Memory on the GPU, bytes."""
        return memory_of(grains, precision)

    def room(self) -> float:
        """Memory of this computer's GPU, bytes. Raises InputError if it has none."""
        require_device()
        return room()

    def drive(self, runs: Sequence[Run], precision: str = "double") -> list[Exception | None]:
        """Carry out runs (labkit.engines.base.Batches)."""
        require_device()
        return Pool(runs, precision).execute()


class CudaEngine(BatchEngine):
    """A batch of one State. Raises InputError without a GPU or numba-cuda, or for more than one thread."""

    abilities = Abilities(
        precisions=("double", "mixed"),
        require_scene=_require_scene,
        require_computer=require_device,
        follow=lambda engine, corrections: engine.follow(corrections),
        batches=CudaBatches(),
    )

    def __init__(self, state: State, threads: int = 1, precision: str = "double") -> None:
        """Load the state; compile the kernels at the first use of a contact law."""
        if threads != 1:
            raise InputError("are not used by the engine cuda", field="threads", value=threads, allowed="1")
        super().__init__(Batch([state], precision))
        self._precision = precision
        self.require_going()

    def load(self, state: State) -> None:
        if not self.batch.takes(0, state):
            del self.batch  # frees its memory
            self.batch = Batch([state], self._precision)
        super().load(state)

    def follow(self, corrections: Corrections) -> None:
        self.batch.begin(0, corrections)
        self.batch.run()
        self.require_going()
