"""Files without a seal are first read in a process of their own: damage can keep HDF5 busy for ever, or crash it."""

from __future__ import annotations

import functools
import os
import select
import signal
from collections.abc import Callable
from typing import Any

from labkit.io.hashes import Name, identity, parts_of

LIMIT = 2  # s of processor time
BYTES_PER_SECOND = 5e6  # more time for a larger file; HDF5 reads some 100 MB/s
PATIENCE = 30.0  # times as long, on a busy computer


def survives(file: Name, read: Callable[[str], object]) -> bool:
    """True if a function comes to an end with a file, be it an error; always True without os.fork."""
    return _survives(read, os.fspath(file), *identity(file)) if hasattr(os, "fork") else True


@functools.lru_cache(1024)  # a command may open the same file several times
def _survives(read: Callable[[str], object], file: str, *identity: int) -> bool:
    import resource  # not on Windows

    limit = LIMIT + int(identity[-1] / BYTES_PER_SECOND)
    receive, send = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            read(file)
        except BaseException:  # an error, which this process meets too and reports
            os._exit(0)
        os._exit(0)
    os.close(send)
    ended, _, _ = select.select([receive], [], [], PATIENCE * limit)  # the pipe ends with the child
    os.close(receive)
    if not ended:
        os.kill(child, signal.SIGKILL)
    return os.waitpid(child, 0)[1] == 0


def read_group(group: Any) -> None:
    """Read all attributes and values of an open netCDF4.Dataset, or of one of its groups."""
    _ = [group.getncattr(name) for name in group.ncattrs()]
    for name, variable in group.variables.items():
        _ = [variable.getncattr(attribute) for attribute in variable.ncattrs()]
        for _ in parts_of(variable, name):
            pass
    for inner in group.groups.values():
        read_group(inner)
