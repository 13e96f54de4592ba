"""The benchmark of the engine cuda, in Numba's simulator of a GPU."""

import numpy as np
import pytest

from labkit.engines.base import silent
from labkit.engines.fused import FusedEngine
from tests.engines.simulated_gpu import lattice

pytestmark = pytest.mark.slow


def test_batches_are_measured_in_both_precisions():
    from benchmarks.gpu import Case, gpu, table  # after the simulator

    state = FusedEngine(lattice(2, 1)).state()  # with contacts
    speeds = gpu(state, silent, [Case(8, 2), Case(8, 1, servo=True)], work=160.0)
    assert list(speeds["grains"] * speeds["states"]) == [16, 16, 8, 8]
    assert list(speeds["precision"]) == 2 * ["double", "mixed"]
    assert np.allclose(speeds["rate"] * speeds["step"], speeds["grains"] * speeds["states"])
    assert speeds["memory"].is_monotonic_decreasing
    assert "1e9 grain-steps/s" in table(speeds)
