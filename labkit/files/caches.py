"""Cache folders, in which labkit stores compiled code and measured speeds for later processes.

Compiled code is executed when it is loaded. A cache folder therefore belongs to one user: it is created with mode 0700,
and its owner and mode are checked before anything is read.
"""

from __future__ import annotations

import functools
import os
import stat
import tempfile
from pathlib import Path

from labkit.errors import notice
from labkit.process.system import open_flags, user_number

FLAGS = ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY")  # O_NONBLOCK: a pipe without a writer does not wait
OTHERS = stat.S_IWGRP | stat.S_IWOTH


def cache_folder(name: str) -> Path | None:
    """Return the cache folder $XDG_CACHE_HOME/labkit/NAME or ~/.cache/labkit/NAME; None if none can be used.

    If the home folder is not writable, as in some containers, the folder for temporary files is used instead.
    """
    home = Path(os.path.expanduser("~"))
    default = home / ".cache" / "labkit"
    if not any(os.access(folder, os.W_OK) for folder in (default, default.parent, home)):
        default = Path(tempfile.gettempdir(), f"labkit-{user_number()}")
    above = os.environ.get("XDG_CACHE_HOME")
    return private_folder((Path(above, "labkit") if above else default) / name)


def private_folder(path: Path) -> Path | None:
    """Return a folder that only this user can change, created if missing; otherwise say why not and return None.

    A parent folder may belong to someone else, who can replace the folder, but not by a folder that this user owns.
    """
    if not path.is_absolute():  # a relative path would depend on the current folder
        return _refuse(path, "is not an absolute path")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        path.mkdir(mode=0o700, exist_ok=True)
        status = path.lstat()
    except OSError as error:
        return _refuse(path, f"cannot be used ({error.strerror})")
    if stat.S_ISLNK(status.st_mode):
        return _refuse(path, "is a link")
    if status.st_uid != user_number():
        return _refuse(path, "belongs to another user")
    if status.st_mode & OTHERS and os.name == "posix":
        return _refuse(path, "can be changed by other users (delete it)")
    return path


def read_private(file: Path) -> bytes:
    """Return the content of a file in a cache folder, which others may have replaced since it was checked.

    Raises PermissionError unless it is a file of this user that others cannot change.
    """
    with open(os.open(file, os.O_RDONLY | open_flags(*FLAGS)), "rb") as handle:
        status = os.fstat(handle.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise PermissionError(f"{file} is not a file")
        if status.st_uid != user_number() or (status.st_mode & OTHERS and os.name == "posix"):
            raise PermissionError(f"{file} can be changed by other users")
        return handle.read()


@functools.cache
def _refuse(path: Path, why: str) -> None:
    """Print once why a folder is not used."""
    notice(f"the cache {path} {why}: nothing is read from it or kept there, and code is compiled anew")
