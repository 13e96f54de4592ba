"""Copies arrays from the device while kernels run.

The copies run on their own stream into pinned memory, because copies into other memory wait for all kernels. This
stream and that of the kernels synchronise with the default stream, which makes all other copies (numba.cuda.stream
creates blocking streams).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from labkit.engines.cuda.arrays import DeviceArray
from labkit.engines.cuda.device import cuda

ALIGNED = 8  # bytes
SPARE = 1.25  # over-allocation, so that small growth reuses the buffer


class Reader:
    """A stream, and pinned memory that all copies reuse."""

    def __init__(self) -> None:
        """Allocate no memory yet."""
        self._stream = cuda.stream()
        self._memory = np.empty(0, np.uint8)

    def read(self, rows: Mapping[str, Sequence[DeviceArray]]) -> dict[str, np.ndarray]:
        """Copy arrays to the host: (k, ...) for each name with k contiguous arrays (...) on the device.

        No kernel may be writing to these arrays.
        """
        needed = sum(_align(len(of_name) * of_name[0].nbytes) for of_name in rows.values())
        if needed > len(self._memory):
            self._memory = cuda.pinned_array(int(SPARE * needed), np.uint8)
        views, at = {}, 0
        for name, of_name in rows.items():
            views[name] = np.ndarray((len(of_name), *of_name[0].shape), of_name[0].dtype, self._memory, at)
            at += _align(views[name].nbytes)
            for row, view in zip(of_name, views[name], strict=True):
                row.copy_to_host(view, stream=self._stream)
        self._stream.synchronize()
        return {name: view.copy() for name, view in views.items()}


def _align(size: int) -> int:
    """Round a number of bytes up so that the next array is aligned."""
    return -(-size // ALIGNED) * ALIGNED
