"""Writes files completely or not at all: a temporary file is renamed when it is complete."""

from __future__ import annotations

import contextlib
import glob
import os
import re
import secrets
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO

from labkit.errors import InputError
from labkit.process.system import preallocate

ERRNO = re.compile(r"errno = (\d+)")  # occurs in messages of HDF5


@contextlib.contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Context with the name of a new file; the file is renamed to `path` on success and deleted otherwise.

    Raises InputError if `path` is a link. If the file cannot be written, raises OSError with the file name `path` and
    the system's message.
    """
    require_no_link(path)
    path = Path(os.path.realpath(Path(path).parent), Path(path).name)
    _remove_orphans(path)
    temporary = path.parent / f".{path.name}.{secrets.token_hex(4)}.{os.getpid()}.tmp"
    with name_file_in_errors(path, temporary):
        try:
            os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))  # O_EXCL never follows a link
            yield temporary
            with open(temporary, "rb") as handle:
                os.fsync(handle.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)


def require_no_link(path: str | os.PathLike[str]) -> None:
    """Raise InputError if `path` is a symbolic link: someone else may have chosen the file that it leads to."""
    if os.path.islink(path):
        raise InputError(f"{path} is a link: delete it, or give the file that it leads to")


def target_of(path: str) -> str:
    """Return the file to write for a name that the user typed; for a link, the file to which it leads.

    A link to a folder, or to a file with a different suffix, is returned unchanged.
    """
    to = os.path.realpath(path)
    alike = os.path.splitext(to)[1] == os.path.splitext(path)[1]
    return to if os.path.islink(path) and alike and not os.path.isdir(path) else path


def open_log(path: str | os.PathLike[str]) -> IO[str]:
    """Open a new text file to which lines are added. An existing file is removed from the folder, not overwritten.

    Raises InputError if `path` is a link, and OSError if the file cannot be written.
    """
    require_no_link(path)
    Path(path).unlink(missing_ok=True)  # a hard link may give the existing file a second name
    return open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666), "w")


@contextlib.contextmanager
def name_file_in_errors(path: Path, other: Path | None = None) -> Iterator[None]:
    """Context that gives an OSError without a file name, or with the name of `other`, the file name `path`."""
    try:
        yield
    except OSError as error:
        if error.filename is not None and os.fsdecode(error.filename) != str(other):
            raise
        said = ERRNO.search(str(error))
        what = os.strerror(int(said[1])) if said else error.strerror or str(error)
        raise OSError(error.errno, what, str(path)) from error


def reserve(file: Path, size: int) -> None:
    """Allocate disk space up to `size` bytes for a file that is being written, because HDF5 may crash on a full disk.

    HDF5 later cuts off the space that it does not need. Raises OSError if the disk is full.
    """
    with open(file, "ab") as handle:
        preallocate(handle.fileno(), size)


def _remove_orphans(path: Path) -> None:
    """Remove the temporary files that killed processes of this computer left in whole_file(path)."""
    for temporary in path.parent.glob(f".{glob.escape(path.name)}.*.tmp"):
        number = temporary.name.split(".")[-2]
        if number.isdecimal() and not _is_running(int(number)):
            with contextlib.suppress(OSError):  # `temporary` is a folder
                temporary.unlink(missing_ok=True)


def _is_running(number: int) -> bool:
    """Return True if this computer has a process with this number."""
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


def write_texts(texts: Mapping[Path, str]) -> None:
    """Write text files in folders that only labkit writes, each atomically; fast for thousands of files.

    If a file cannot be written, raises OSError with its path and changes no file.
    """
    temporary = {path: path.with_name(f".{path.name}.tmp") for path in texts}
    try:
        for path, text in texts.items():
            require_no_link(path)
            temporary[path].unlink(missing_ok=True)  # left by a killed process
            with name_file_in_errors(path, temporary[path]), open(temporary[path], "x", encoding="utf-8") as handle:
                handle.write(text)
        os.sync()  # once, instead of fsync for each file
        for path in texts:
            os.replace(temporary[path], path)
    finally:
        for file in temporary.values():
            file.unlink(missing_ok=True)
