"""Returns the memory of freed large arrays to the system.

Otherwise the freed memory would add to what the neighbour search needs.
"""

from __future__ import annotations

import ctypes

M_MMAP_THRESHOLD = -3  # parameter of mallopt in glibc
LARGE = 1_000_000  # bytes


def return_large_arrays() -> None:
    """Makes glibc allocate arrays above LARGE with mmap, so that freeing them returns their memory to the system.

    Has no effect with other C libraries.
    """
    try:
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE)
    except (OSError, AttributeError):
        pass
