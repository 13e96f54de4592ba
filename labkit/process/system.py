"""What only some systems have: locks of files, the cores of this process, and disk space allocated in advance."""

from __future__ import annotations

import errno
import os

try:
    import fcntl
except ImportError:  # Windows, WebAssembly
    HAS_LOCKS = False
else:
    HAS_LOCKS = True


def lock_file(handle: int, shared: bool = False) -> None:
    """Lock an open file. Raises OSError if another process has locked it, or with ENOSYS if the system has no locks."""
    if not HAS_LOCKS:
        raise OSError(errno.ENOSYS, "no locks")
    fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)


def number_of_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def preallocate(handle: int, size: int) -> None:
    """Allocate disk space for an open file, if the system can. Raises OSError if the disk is full."""
    if hasattr(os, "posix_fallocate"):  # not on macOS
        os.posix_fallocate(handle, 0, size)


def open_flags(*names: str) -> int:
    """Return the sum of flags of os.open that this system has, such as O_NOFOLLOW."""
    return sum(getattr(os, name, 0) for name in names)


def user_number() -> int:
    """Return the number of this user; 0 where users have no numbers."""
    return os.geteuid() if hasattr(os, "geteuid") else 0
