"""Files of others: only regular files that do not expand too much are read, and doubts about them stop the reading."""

from __future__ import annotations

import contextlib
import dataclasses
import gzip
import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from labkit.errors import InputError

MOST_RATIO = 100  # largest ratio of the decompressed size to the size of the file
FREE = 100_000_000  # a file of any size may expand to this number of bytes
_noted: list[dict[str, str]] = []  # of commands, the innermost last


@contextlib.contextmanager
def noting_files(files: Mapping[str, str] = {}) -> Iterator[None]:
    """Context of a command: notes the text files that it reads, which the provenance of its results lists.

    `files` were read before, path -> SHA-256.
    """
    _noted.append({**files})
    try:
        yield
    finally:
        _noted.pop()


def note_file(file: str | os.PathLike[str]) -> None:
    """Note that the command has read a file."""
    if _noted:
        _noted[-1].setdefault(os.path.realpath(file), "")


def noted_files() -> dict[str, str]:
    """Return the text files that the command has read, path -> SHA-256, or an empty text if it is not known."""
    return {**_noted[-1]} if _noted else {}


def require_regular(file: str | os.PathLike[str], instead: str = "give another file") -> None:
    """Raise InputError for a pipe or a device, which may never end."""
    if Path(file).exists() and not Path(file).is_file():
        raise InputError(f"{file} cannot be read (not a regular file): {instead}")


def content_of(file: Path, most: int | None = None) -> bytes:
    """Return the bytes of a regular file, decompressed if it is a gzip file; at most the first `most` bytes if given.

    Raises InputError for any other file, and if it expands to more than FREE bytes and MOST_RATIO times its size.
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
    """Raise InputError if a zip archive expands to more than FREE bytes and MOST_RATIO times its size."""
    if sum(member.file_size for member in archive.infolist()) > _room(file):
        raise too_large(file)


def _room(file: Path) -> int:
    return max(FREE, MOST_RATIO * file.stat().st_size)


def too_large(file: Path) -> InputError:
    """Return the error for a file that would fill the memory."""
    return InputError(f"{file} holds more than {_room(file) / 1e6:.0f} MB when decompressed: give a smaller file")


@dataclasses.dataclass(frozen=True)
class Doubt:
    """An implausible property of a file; it is `serious` if what is made from the file would be useless."""

    text: str
    serious: bool = False

    def __str__(self) -> str:
        return self.text


def require_accepted(doubts: Sequence[Doubt], accept: bool, does: str) -> None:
    """Raise InputError for serious doubts unless the user accepts them; `--accept` does, e.g. imports, nevertheless."""
    serious = [str(doubt) for doubt in doubts if doubt.serious]
    if serious and not accept:
        raise InputError(f"{'; '.join(serious)} (--accept {does} it nevertheless)")
