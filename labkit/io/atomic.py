"""Files that are written whole or not at all: a temporary file that is renamed when it is complete."""

from __future__ import annotations

import contextlib
import glob
import os
import re
import secrets
from collections.abc import Iterator
from pathlib import Path

ERRNO = re.compile(r"errno = (\d+)")  # found in messages of HDF5


@contextlib.contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Context with the name of a new file; the file is renamed to `path` on success and deleted otherwise.

    Raises OSError with `path` as its file name, and with the system's message, if the file cannot be written.
    """
    path = Path(path).resolve()
    _remove_orphans(path)
    temporary = path.parent / f".{path.name}.{secrets.token_hex(4)}.{os.getpid()}.tmp"
    with failing_as(path, temporary):
        try:
            os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))  # not at the target of a link
            yield temporary
            with open(temporary, "rb") as handle:
                os.fsync(handle.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def failing_as(path: Path, other: Path | None = None) -> Iterator[None]:
    """Context in which an OSError without a file name, or with that of `other`, gets the name of the file `path`."""
    try:
        yield
    except OSError as error:
        if error.filename is not None and os.fsdecode(error.filename) != str(other):
            raise
        said = ERRNO.search(str(error))
        what = os.strerror(int(said[1])) if said else error.strerror or str(error)
        raise OSError(error.errno, what, str(path)) from error


def reserve(file: Path, size: int) -> None:
    """Allocate disk space up to `size` bytes for an open file, because HDF5 may crash where a disk is full.

    HDF5 cuts off what it does not need. Raises OSError if the disk is full.
    """
    with open(file, "ab") as handle:
        os.posix_fallocate(handle.fileno(), 0, size)


def _remove_orphans(path: Path) -> None:
    """Remove the temporary files that killed processes of this computer left in whole_file(path)."""
    for temporary in path.parent.glob(f".{glob.escape(path.name)}.*.tmp"):
        number = temporary.name.split(".")[-2]
        if number.isdecimal() and not _is_running(int(number)):
            temporary.unlink(missing_ok=True)


def _is_running(number: int) -> bool:
    """True if this computer has a process with this number."""
    try:
        os.kill(number, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # the process belongs to another user
        return True
    return True


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file atomically, as UTF-8. Raises OSError with `path` as its file name."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
