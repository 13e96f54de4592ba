"""Checks that a file can be written, and creates folders for outputs."""

from __future__ import annotations

import os
import re
import stat
import tempfile
from collections.abc import Iterable
from pathlib import Path

from labkit.errors import InputError
from labkit.files.atomic import require_no_link
from labkit.files.netcdf import kind_in_words, labkit_kind, require_name

WRITABLE = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH


def require_writable(
    path: str | os.PathLike[str], kind: str | None = None, inputs: Iterable[str | os.PathLike[str]] = ()
) -> None:
    """Raise InputError if `path` is a link or no file can be written there. Leaves no file behind.

    An existing file may be overwritten if it is a labkit file of this `kind`; if `kind` is None, only if it is not a
    labkit file. `inputs` are the files that are read: none of them is overwritten.
    """
    path = Path(path)
    require_name(path)
    if os.path.realpath(path) in map(os.path.realpath, inputs):
        raise InputError(f"{path} is also an input, which would be overwritten: choose another name")
    require_no_link(path)
    if path.is_dir():
        raise InputError(f"{path} is a directory: give a file name")
    if len(path.name.encode()) > 200:
        raise InputError(f"{path.name[:40]}... is too long for a file name: choose another name")
    if path.exists():
        if not path.is_file():
            raise InputError(f"{path} is not a regular file: choose another name")
        if not path.stat().st_mode & WRITABLE:
            raise InputError(f"{path} is read-only: change its permissions, or choose another name")
        existing = labkit_kind(path)
        if (kind or existing) and existing != kind:
            raise InputError(f"{path} is {kind_in_words(existing)}: it would be overwritten; choose another name")
    if not path.parent.is_dir():
        raise InputError(f"{path.parent} is not a directory: create it first, or choose another name")
    try:
        tempfile.TemporaryFile(
            dir=path.parent, prefix=".labkit-"
        ).close()  # without a name: a signal leaves nothing behind
    except OSError as error:
        raise InputError(f"{path.parent} is not writable ({error.strerror}): choose another name") from None


def stem(file: str | os.PathLike[str]) -> str:
    """Return the name of a state, run or probes file without folder and extension, or what is left of it."""
    name = Path(file).name
    return re.sub(r"\.(run|state|probes)\.(nc|npz)$", "", name) or name


def require_different(*outputs: str | None) -> list[str]:
    """Return the outputs of a command that are not None. Raises InputError if two of them are the same file."""
    files = [file for file in outputs if file is not None]
    if len(set(map(os.path.realpath, files))) < len(files):
        raise InputError(f"two outputs have the same name, of {', '.join(files)}: use different names")
    return files


def make_folder(path: str | os.PathLike[str], option: str) -> Path:
    """Create a folder if it is missing, and return its path. Raises InputError that names `option` if this fails."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{option} {path} cannot be created ({error.strerror}): choose another folder") from None
    require_writable(path / "README.md")
    return path
