"""Imports the engine cuda in Numba's simulator, which runs GPU kernels as plain Python, and makes specimens for it."""

import numba
import numpy as np
import pytest

from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
from labkit.io.schema import STATE

with pytest.MonkeyPatch.context() as patch:  # at the first import of numba.cuda
    patch.setenv("NUMBA_ENABLE_CUDASIM", "1")
    patch.setattr(numba.config, "ENABLE_CUDASIM", True)
    from labkit.engines.cuda import build, memory
    from labkit.engines.cuda.batch import LOST, Batch
    from labkit.engines.cuda.device import cuda
    from labkit.engines.cuda.engine import CudaBatches, CudaEngine
    from labkit.engines.cuda.pool import Pool
    from labkit.engines.cuda.reading import Reader

__all__ = ["LOST", "Batch", "CudaBatches", "CudaEngine", "Pool", "Reader", "bits", "build", "cuda", "lattice", "memory"]

RADIUS = 85e-6


def lattice(side, seed, scene=None):
    """side^3 equal grains that overlap by about 2 %, displaced at random by a tenth of that."""
    spacing = 0.98 * 2.0 * RADIUS
    position = spacing * np.stack(np.meshgrid(*3 * [np.arange(side) * 1.0]), axis=-1).reshape(-1, 3)
    position += np.random.default_rng(seed).normal(0.0, 0.002 * RADIUS, position.shape)
    scene = scene or Scene(law="spring_dashpot")
    return grains_in_cell(scene, np.full(side**3, RADIUS), position, side * spacing * np.eye(3))


def bits(state):
    """Everything in a State that a simulation changes, as bytes."""
    return [np.ascontiguousarray(getattr(state, name)).tobytes() for name in STATE] + [repr(state.ledger)]
