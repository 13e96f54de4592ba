"""NumPy files: one array of grains (.npy, as GrainLearning's post-processing saves them) or named arrays (.npz)."""

from __future__ import annotations

import io
import zipfile
import zlib
from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.exchange.answers import Answers, names_of
from labkit.exchange.columns import CONTACT, GRAIN, canonical, chosen, contacts_from, grains_from
from labkit.exchange.formats import Format, damaged, open_maybe_compressed
from labkit.exchange.packing import ContactList, Packing

MAGIC = (b"\x93NUMPY", b"PK")  # first bytes of .npy and .npz
LISTS = {"position": ("pos", "positions", "centers", "points"), "radius": ("radii",)}


class NumpyArrays(Format):
    """Arrays without pickled objects, which could run any code when they are opened.

    An .npy file is an array (n, k), whose columns --columns names unless they are x, y, z and a size. An .npz file
    holds `position` (n, 3), `radius` or `diameter` (n,), perhaps `id` and `cell`, and contacts as in a table.
    """

    name = "numpy"
    description = "NumPy array of grains (GrainLearning), .npy or .npz"
    endings = (".npy", ".npz")

    def recognises(self, file: Path, head: str) -> bool:
        return file.suffix in (".npy", ".npz")

    def read(self, file: Path, answers: Answers) -> Packing:
        arrays = _arrays(file)
        named = {own: arrays[name] for name in arrays if (own := _own(name)) is not None}
        if "position" in named:
            if named["position"].ndim != 2 or named["position"].shape[1] != 3:
                raise damaged(file, f"its positions have the shape {named['position'].shape}, not (n, 3)")
            for number, axis in enumerate("xyz"):
                named[axis] = named["position"][:, number]
        elif "array" in arrays:
            values = arrays["array"]
            if values.ndim != 2:
                raise InputError(f"{file} holds an array of shape {values.shape}: give one row per grain, (n, k)")
            names = names_of(answers.columns)
            if names is None and values.shape[1] != 4:
                raise InputError(
                    f"{file} has {values.shape[1]} columns without names: give --columns, e.g. x,y,z,radius,-"
                )
            named, _ = chosen(names or ("x", "y", "z", "size"), values, {**GRAIN, "size": ("size",)}, file)
        position, size, size_is, identity = grains_from(named, file)
        cell = arrays.get("cell")
        contacts = self.read_contacts(file, answers) if "id1" in _contact_columns(arrays) else None
        return Packing(position, size, size_is, identity, cell, None, contacts)

    def read_contacts(self, file: Path, answers: Answers) -> ContactList:
        arrays = _arrays(file)
        columns = _contact_columns(arrays)
        if "array" in arrays:
            names = names_of(answers.contact_columns)
            if names is None:
                raise InputError(f"{file} does not name its columns: give --contact-columns, e.g. id1,id2,fx,fy,fz")
            columns, _ = chosen(names, arrays["array"], CONTACT, file)
        return contacts_from(columns, file)


def _arrays(file: Path) -> dict[str, np.ndarray]:
    """Name -> array; the one array of an .npy file is called `array`. Raises InputError for pickled objects."""
    with open_maybe_compressed(file) as handle:
        content = handle.read()
    if not content.startswith(MAGIC):
        raise damaged(file, "it does not begin like a NumPy file")
    try:
        loaded = np.load(io.BytesIO(content))
        return {name: loaded[name] for name in loaded.files} if hasattr(loaded, "files") else {"array": loaded}
    except ValueError as error:
        if "pickle" in str(error):
            raise InputError(
                f"{file} holds Python objects, which could run any code: save plain arrays with numpy.savez"
            ) from None
        raise damaged(file, error) from None
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise damaged(file, error) from None


def _own(name: str) -> str | None:
    for own, spellings in LISTS.items():
        if name.lower() == own or name.lower() in spellings:
            return own
    return canonical(name, GRAIN)


def _contact_columns(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of the contacts in named arrays; arrays (n, 3) are split into components."""
    columns: dict[str, np.ndarray] = {}
    for name, values in arrays.items():
        parts = {name: values}
        if values.ndim == 2 and values.shape[1] == 3:
            parts = {f"{name.rstrip('s')}_{axis}": values[:, k] for k, axis in enumerate("xyz")}
        for part, column in parts.items():
            own = canonical(part, CONTACT)
            if own is not None and column.ndim == 1:
                columns[own] = column
    return columns
