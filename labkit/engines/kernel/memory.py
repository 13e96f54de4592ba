"""Allocates memory for the kernel."""

from __future__ import annotations

import math

import numpy as np

LINE = 64  # number of bytes in a cache line


def allocate(shape: tuple[int, ...], kind: type = float) -> np.ndarray:
    """Return an array of zeros that is aligned to a cache line."""
    memory = np.zeros(math.prod(shape) * np.dtype(kind).itemsize + LINE, np.uint8)
    first = -memory.ctypes.data % LINE
    return memory[first : first + len(memory) - LINE].view(kind).reshape(shape)
