"""A full disk: the system refuses the bytes of a file beyond a limit."""

import contextlib
import resource
import signal
import sys


@contextlib.contextmanager
def file_size_limit(size):
    """Context in which this process can write no file beyond `size` bytes.

    Nor does it keep the bytecode of a module that it imports first: Python would cut that off without an error.
    """
    keeps, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # EFBIG in place of the signal
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
        sys.dont_write_bytecode = keeps
