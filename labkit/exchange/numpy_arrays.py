"""NumPy files: one array of grains (.npy, as GrainLearning's post-processing saves them) or named arrays (.npz)."""

from __future__ import annotations

import dataclasses
import io
import zipfile
import zlib
from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.exchange.answers import Answers, answer_names
from labkit.exchange.columns import BARE, CONTACT, GRAIN, contacts_from, grains_from
from labkit.exchange.formats import Format, damaged_file
from labkit.exchange.packing import ContactList, Packing
from labkit.io.foreign import content_of, require_modest

MAGIC = (b"\x93NUMPY", b"PK")  # first bytes of .npy and .npz


class NumpyArrays(Format):
    """Arrays without pickled objects, which could run any code when they are opened.

    An .npy file is an array (n, k), whose columns --columns names unless they are x, y, z and a size. An .npz file
    holds `position` (n, 3), `radius` or `diameter` (n,), optionally `id` and `cell`, and contacts as in a table.
    """

    name = "numpy"
    description = "NumPy array of grains (GrainLearning), .npy or .npz"
    endings = (".npy", ".npz")

    def recognises(self, file: Path, head: str) -> bool:
        return file.suffix in (".npy", ".npz")

    def read(self, file: Path, answers: Answers) -> Packing:
        arrays = _arrays(file)
        if "array" in arrays:
            values = _matrix(arrays["array"], file)
            bare = BARE if values.shape[1] == len(BARE) else None
            columns, _ = GRAIN.columns(answer_names(answers.columns) or bare, values, file)
        else:
            columns = GRAIN.arrays(arrays, file)
        contacts = self.read_contacts(file, answers) if "id1" in CONTACT.arrays(arrays, file) else None
        return dataclasses.replace(grains_from(columns, file), cell=arrays.get("cell"), contacts=contacts)

    def read_contacts(self, file: Path, answers: Answers) -> ContactList:
        arrays = _arrays(file)
        if "array" in arrays:
            values = _matrix(arrays["array"], file)
            columns, _ = CONTACT.columns(answer_names(answers.contact_columns), values, file)
        else:
            columns = CONTACT.arrays(arrays, file)
        return contacts_from(columns, file)


def _matrix(values: np.ndarray, file: Path) -> np.ndarray:
    """Return the array of an .npy file. Raises InputError unless it has rows and columns."""
    if values.ndim != 2:
        raise InputError(f"{file} holds an array of shape {values.shape}: give one row per grain, (n, k)")
    if values.dtype.kind not in "fiu":
        raise InputError(f"{file} holds {values.dtype.name}, not numbers: give an array of numbers")
    return values


def _arrays(file: Path) -> dict[str, np.ndarray]:
    """Read arrays by name; the one array of an .npy file is called `array`. Raises InputError for pickled objects."""
    content = content_of(file)
    if not content.startswith(MAGIC):
        raise damaged_file(file, "it does not begin like a NumPy file")
    try:
        if content.startswith(b"PK"):
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                require_modest(file, archive)
        loaded = np.load(io.BytesIO(content))
        return {name: loaded[name] for name in loaded.files} if hasattr(loaded, "files") else {"array": loaded}
    except ValueError as error:
        if "pickle" in str(error):
            raise InputError(
                f"{file} holds Python objects, which could run any code: save plain arrays with numpy.savez"
            ) from None
        raise damaged_file(file, error) from None
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise damaged_file(file, error) from None
