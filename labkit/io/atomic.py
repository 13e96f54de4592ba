"""Files that are written whole or not at all: a temporary file that is renamed when it is complete."""

from __future__ import annotations

import contextlib
import glob
import os
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Context with a temporary file name; the file is renamed to `path` on success and deleted otherwise.

    Raises OSError with `path` as its file name if the file cannot be written to the disk or renamed.
    """
    path = Path(path).resolve()
    _remove_orphans(path)
    temporary = path.parent / f".{path.name}.{os.getpid()}.tmp"
    try:
        yield temporary
        try:
            with open(temporary, "rb") as handle:
                os.fsync(handle.fileno())
            os.replace(temporary, path)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)


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
    except PermissionError:  # it belongs to somebody else
        return True
    return True


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file atomically, as UTF-8. Raises OSError with `path` as its file name."""
    with whole_file(path) as temporary:
        try:
            temporary.write_text(text, encoding="utf-8")
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(path)) from error
