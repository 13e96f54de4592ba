"""Makes glibc keep small arrays in its heap, and put large ones in memory that goes back to the system when freed.

If large arrays were not returned, those of a large specimen would add to the memory that the neighbour search needs.
If small arrays were returned, every temporary array of a search or a record would get new pages, which the system
fills with zeros.
"""

from __future__ import annotations

import ctypes

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # parameters of mallopt in glibc
LARGE = 8_000_000  # bytes: an array of three numbers for each of 300,000 grains
SPARE = 64_000_000  # bytes of freed memory that stay with the process


def return_large_arrays() -> None:
    """Make glibc allocate arrays above LARGE with mmap, and keep freed memory below SPARE for the next arrays.

    Has no effect with other C libraries.
    """
    try:
        library = ctypes.CDLL(None)
        library.mallopt(M_MMAP_THRESHOLD, LARGE)
        library.mallopt(M_TRIM_THRESHOLD, SPARE)
    except (OSError, AttributeError):
        pass
