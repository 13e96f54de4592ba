"""The plug-in cuda: registers the engine and defines its Start."""

from __future__ import annotations

from labkit.engines.base import ENGINES, Precision, Start, starter

ENGINES.offer("cuda", "labkit.engines.cuda.engine:CudaEngine")


class Cuda(Start):
    """An NVIDIA GPU, on which many runs advance together."""

    def __init__(self, precision: Precision = "double") -> None:
        """Take the precision of the forces."""
        super().__init__(**vars(starter("cuda", 1, precision)))
