"""Memory of large arrays goes back to the system when they do, so that a search needs no more than its arrays."""

from __future__ import annotations

import ctypes

M_MMAP_THRESHOLD = -3  # of glibc's mallopt
LARGE = 1_000_000  # bytes


def return_large_arrays() -> None:
    """Has glibc map arrays above LARGE on their own, where it would keep what they leave; elsewhere nothing."""
    try:
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE)
    except (OSError, AttributeError):
        pass
