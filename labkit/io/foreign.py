"""Untrusted files: only regular files are read, and they may not expand too much when decompressed.

Tables in such files: the cells of a line, and whether one is a number.
"""

from __future__ import annotations

import gzip
import os
import zipfile
import zlib
from pathlib import Path

from labkit.errors import InputError

MOST_RATIO = 100  # highest ratio of the size after decompression to that of the file
FREE = 100_000_000  # bytes that a file of any size may expand to


def require_regular(file: str | os.PathLike[str], instead: str = "give another file") -> None:
    """Raises InputError for a pipe or a device, which may never end."""
    if Path(file).exists() and not Path(file).is_file():
        raise InputError(f"{file} cannot be read (not a regular file): {instead}")


def content_of(file: Path, most: int | None = None) -> bytes:
    """The bytes of a regular file, or at most the first `most`, after decompression if it is compressed with gzip.

    Raises InputError for anything but a regular file, and for a file that holds more than MOST_RATIO times its size.
    """
    require_regular(file)
    try:
        with open(file, "rb") as handle:
            if handle.read(2) != b"\x1f\x8b":
                handle.seek(0)
                return handle.read(-1 if most is None else most)
        with gzip.open(file, "rb") as unpacked:
            content = unpacked.read(_room(file) + 1 if most is None else most)
    except (EOFError, gzip.BadGzipFile, zlib.error):
        raise InputError(
            f"{file} is damaged or of an unknown version (gzip cannot unpack it): give another file"
        ) from None
    if len(content) > _room(file):
        raise too_large(file)
    return content


def require_modest(file: Path, archive: zipfile.ZipFile) -> None:
    """Raises InputError if the members of a zip archive hold more than MOST_RATIO times its size."""
    if sum(member.file_size for member in archive.infolist()) > _room(file):
        raise too_large(file)


def cells(line: str) -> list[str]:
    """The cells of a line of a table, separated by commas, semicolons, tabs or blanks, with or without quotes."""
    separator = next((mark for mark in ",;\t" if mark in line), None)
    return [cell.strip().strip('"') for cell in line.split(separator)]


def is_number(word: str) -> bool:
    """True for the text of a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _room(file: Path) -> int:
    return max(FREE, MOST_RATIO * file.stat().st_size)


def too_large(file: Path) -> InputError:
    """Return the error for a file that would fill the memory."""
    return InputError(f"{file} holds more than {_room(file) / 1e6:.0f} MB when decompressed: give a smaller file")
