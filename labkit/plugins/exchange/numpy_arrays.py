"""NumPy files: one array of grains (.npy, as written by GrainLearning's post-processing) or named arrays (.npz)."""

from __future__ import annotations

import dataclasses
import io
import zlib
from collections.abc import Sequence
from pathlib import Path
from zipfile import BadZipFile, ZipFile

import numpy as np

from labkit.errors import InputError
from labkit.plugins.exchange.columns import BARE, CONTACT, GRAIN, Vocabulary, contacts_from, grains_from, renamed
from labkit.plugins.exchange.contact_list import ContactList
from labkit.plugins.exchange.formats import Format, damaged_file
from labkit.plugins.exchange.packing import Answers, Packing, answer_names
from labkit.text.foreign import content_of, require_modest

DAMAGED = (ValueError, OSError, EOFError, KeyError, RuntimeError, MemoryError, OverflowError, BadZipFile, zlib.error)
MAGIC = (b"\x93NUMPY", b"PK")  # first bytes of .npy and .npz


class NumpyArrays(Format):
    """Arrays of numbers; pickled objects are refused, because they could run arbitrary code when they are opened.

    An .npy file contains an array (n, k); if its columns are not x, y, z and a size, --columns must name them. An .npz
    file contains `position` (n, 3), `radius` or `diameter` (n,), optionally `id`, `cell`, and contacts as in a table.
    """

    name = "numpy"
    description = "NumPy array of grains (GrainLearning), .npy or .npz"
    endings = (".npy", ".npz")

    def recognises(self, file: Path, head: str) -> bool:
        return file.suffix in (".npy", ".npz")

    def read(self, file: Path, answers: Answers) -> Packing:
        arrays = _arrays(file)
        columns = _columns(GRAIN, arrays, answers.columns, file, BARE)
        listed = answers.contact_columns or "id1" in CONTACT.arrays(arrays, file)
        contacts = self.read_contacts(file, answers) if listed else None
        return dataclasses.replace(grains_from(columns, file), cell=arrays.get("cell"), contacts=contacts)

    def read_contacts(self, file: Path, answers: Answers) -> ContactList:
        return contacts_from(_columns(CONTACT, _arrays(file), answers.contact_columns, file), file)


def _columns(
    vocabulary: Vocabulary, arrays: dict[str, np.ndarray], text: str | None, file: Path, bare: Sequence[str] = ()
) -> dict[str, np.ndarray]:
    """Return the columns of named arrays, or of the single array of an .npy file, with the names in `given`.

    `bare` has the default names of the columns of a single array. Raises InputError unless it has rows and columns.
    """
    if "array" not in arrays:
        return vocabulary.arrays(arrays, file, renamed(vocabulary, text, arrays, file))
    values = arrays["array"]
    if values.ndim != 2:
        raise InputError(f"{file} holds an array of shape {values.shape}: give one row per grain, (n, k)")
    if values.dtype.kind not in "fiu":
        raise InputError(f"{file} holds {values.dtype.name}, not numbers: give an array of numbers")
    names = answer_names(text) or (bare if len(bare) == values.shape[1] else None)
    return vocabulary.columns(names, values, file)[0]


def _arrays(file: Path) -> dict[str, np.ndarray]:
    """Read arrays by name; the single array of an .npy file is named `array`. Raises InputError for pickled objects."""
    content = content_of(file)
    if not content.startswith(MAGIC):
        raise damaged_file(file, "it does not begin like a NumPy file")
    try:
        if content.startswith(b"PK"):
            with ZipFile(io.BytesIO(content)) as archive:
                require_modest(file, archive)
        loaded = np.load(io.BytesIO(content))
        arrays = {name: loaded[name] for name in loaded.files} if hasattr(loaded, "files") else {"array": loaded}
        if others := [name for name, array in arrays.items() if not isinstance(array, np.ndarray)]:
            raise damaged_file(file, f"{others[0]} is no array")
        return arrays
    except InputError:
        raise
    except DAMAGED as error:
        if "pickle" in str(error):
            raise InputError(
                f"{file} holds Python objects, which could run any code: save plain arrays with numpy.savez"
            ) from None
        raise damaged_file(file, "NumPy cannot read its arrays") from None
