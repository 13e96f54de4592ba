"""Checks that a file can be written, and creates folders for outputs."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

from labkit.errors import InputError
from labkit.io.atomic import require_no_link
from labkit.io.netcdf import kind_in_words, labkit_kind, require_name

WRITABLE = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH


def require_writable(path: str | os.PathLike[str], kind: str | None = None) -> None:
    """Raise InputError if `path` is a link or no file can be written there. Leaves no file behind.

    An existing file may be overwritten if it is a labkit file of this `kind`; if `kind` is None, only if it is not a
    labkit file.
    """
    path = Path(path)
    require_name(path)
    require_no_link(path)
    if path.is_dir():
        raise InputError(f"{path} is a directory: give a file name")
    if len(path.name.encode()) > 200:
        raise InputError(f"{path.name[:40]}... is too long for a file name: choose another -o")
    if path.exists():
        if not path.is_file():
            raise InputError(f"{path} is not a regular file: choose another -o")
        if not path.stat().st_mode & WRITABLE:
            raise InputError(f"{path} is read-only: change its permissions, or choose another -o")
        existing = labkit_kind(path)
        if (kind or existing) and existing != kind:
            raise InputError(f"{path} is {kind_in_words(existing)}: it would be overwritten; choose another -o")
    if not path.parent.is_dir():
        raise InputError(f"{path.parent} is not a directory: create it first, or choose another -o")
    try:
        tempfile.TemporaryFile(
            dir=path.parent, prefix=".labkit-"
        ).close()  # without a name: a signal leaves nothing behind
    except OSError as error:
        raise InputError(f"{path.parent} is not writable ({error.strerror}): choose another -o") from None


def make_folder(path: str | os.PathLike[str], option: str) -> Path:
    """Create a folder if it is missing, and return its path. Raises InputError that names `option` if this fails."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{option} {path} cannot be created ({error.strerror}): choose another folder") from None
    require_writable(path / "README.md")
    return path
