"""Files of labkit without the netCDF library: the groups of a netCDF file as a zip archive of NumPy arrays (.npz).

A browser has no netCDF library, so labkit writes and reads such files there; everywhere else it reads them too, and
writes them if their name ends with .npz. The archive holds GROUP/VARIABLE.npy for each variable, which numpy.load
reads, and `header.json` with dimensions and attributes. A Dataset offers the part of netCDF4.Dataset that labkit
uses, so the schema, and the hash of the file are the same.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from labkit.errors import InputError
from labkit.text.foreign import require_modest

ENDING, START, HEADER, HDF5 = ".npz", b"PK", "header.json", b"\x89HDF"
KINDS = ("S1", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")  # types of numbers and characters in netCDF
FAILURES = (  # what the reading of a damaged or hostile archive may raise
    *(ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError, MemoryError, EOFError),
    *(zipfile.BadZipFile, zlib.error),
)


class Attributes:
    """Attributes of a variable or a group: text, numbers and arrays of numbers."""

    def __init__(self) -> None:
        """Start without attributes."""
        self._attributes: dict[str, Any] = {}

    def ncattrs(self) -> list[str]:
        """Return the names."""
        return list(self._attributes)

    def getncattr(self, name: str) -> Any:
        """Return a value. Raises AttributeError."""
        try:
            return self._attributes[name]
        except KeyError:
            raise AttributeError(f"NetCDF: there is no attribute {name}") from None

    def setncatts(self, values: Mapping[str, object]) -> None:
        """Set several values."""
        self._attributes |= {
            name: value if isinstance(value, str) else np.array(value)[()] for name, value in values.items()
        }

    def __getattr__(self, name: str) -> Any:
        return self.getncattr(name)

    def __setattr__(self, name: str, value: object) -> None:
        if name in OWN:
            object.__setattr__(self, name, value)
        else:
            self.setncatts({name: value})

    def __delattr__(self, name: str) -> None:
        del self._attributes[name]


OWN = ("_attributes", "name", "dimensions", "values", "parent", "variables", "groups", "path", "file", "mode")


class NamedArray(Attributes):
    """An array with names for its dimensions; writing beyond its end extends it."""

    def __init__(self, name: str, values: np.ndarray, dimensions: tuple[str, ...]) -> None:
        """Store the values."""
        super().__init__()
        self.name, self.values, self.dimensions = name, values, dimensions

    @property
    def dtype(self) -> np.dtype:
        """Type of the values."""
        return self.values.dtype

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the values."""
        return self.values.shape

    def __getitem__(self, rows: Any) -> np.ma.MaskedArray:
        return np.ma.array(self.values[rows])

    def __setitem__(self, rows: Any, values: ArrayLike) -> None:
        values = np.asarray(values)
        end = rows.stop if isinstance(rows, slice) else None
        end = len(values) if isinstance(rows, slice) and end is None and values.ndim else end
        if end is not None and end > len(self.values):
            more = np.zeros((end - len(self.values), *self.values.shape[1:]), self.dtype)
            self.values = np.concatenate([self.values, more])
        self.values[rows] = values


class Group(Attributes):
    """A group: dimensions (name -> its range, as long as the dimension), variables and groups within it."""

    def __init__(self, path: str = "/", parent: Group | None = None) -> None:
        """Start empty."""
        super().__init__()
        self.path, self.parent = path, parent
        self.dimensions: dict[str, range] = {}
        self.variables: dict[str, NamedArray] = {}
        self.groups: dict[str, Group] = {}

    def createDimension(self, name: str, size: int | None) -> None:  # noqa: N802
        """Add a dimension; one without a size has length 0 until a variable is written."""
        self.dimensions[name] = range(size or 0)

    def createGroup(self, name: str) -> Group:  # noqa: N802
        """Add a group and return it."""
        self.groups[name] = Group(f"{self.path.rstrip('/')}/{name}", self)
        return self.groups[name]

    def createVariable(self, name: str, kind: Any, dimensions: tuple[str, ...], **storage: object) -> NamedArray:  # noqa: N802
        """Add a variable and return it; how netCDF would store it does not matter."""
        shape = [self._length(dimension) for dimension in dimensions]
        self.variables[name] = NamedArray(name, np.zeros(shape, kind), dimensions)
        return self.variables[name]

    def __getitem__(self, name: str) -> Any:
        first, _, rest = name.strip("/").partition("/")
        if rest:
            return self.groups[first][rest]
        return self.groups[first] if first in self.groups else self.variables[first]

    def _length(self, dimension: str) -> int:
        return len(self._owner(dimension)[dimension])

    def _owner(self, dimension: str) -> dict[str, range]:
        """Return the dimensions of the group that defines this one: this group or one that contains it."""
        if dimension in self.dimensions:
            return self.dimensions
        if self.parent is None:
            raise KeyError(dimension)
        return self.parent._owner(dimension)

    def measure(self) -> None:
        """Give the dimensions the lengths of the variables that were written."""
        for variable in self.variables.values():
            for dimension, size in zip(variable.dimensions, variable.shape, strict=True):
                of = self._owner(dimension)
                of[dimension] = range(max(size, len(of[dimension])))
        for group in self.groups.values():
            group.measure()


class Dataset(Group):
    """A file, read when it is opened ("r") or written by `sync` ("w")."""

    def __init__(self, file: Path, mode: str = "r") -> None:
        """Open the file. Raises OSError if it is damaged, InputError if it is another kind of file."""
        super().__init__()
        self.file, self.mode = file, mode
        if mode == "a":
            raise InputError(f"{file} cannot be extended: continue from its State (labkit.read_state) in a new run")
        if mode == "r":
            if file.read_bytes()[:4] == HDF5:
                raise InputError(
                    f"{file} is netCDF (HDF5), which Python cannot read here: on your computer, "
                    "labkit export FILE -o new.state.npz writes it as an archive, which can be read"
                )
            try:
                with zipfile.ZipFile(file) as archive:
                    require_modest(file, archive)
                    _fill(self, json.loads(archive.read(HEADER)), archive)
            except InputError:
                raise
            except FAILURES:
                raise OSError(None, "it is no archive of labkit", str(file)) from None

    def sync(self) -> None:
        """Write the file."""
        if self.mode != "r":
            with zipfile.ZipFile(self.file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
                self.measure()
                archive.writestr(HEADER, json.dumps(_described(self, archive)))

    def close(self) -> None:
        """Do nothing, because the file is closed after each use."""

    def __enter__(self) -> Dataset:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def is_archive(file: str | os.PathLike[str]) -> bool:
    """Return True if a file begins like an archive."""
    with open(file, "rb") as handle:
        return handle.read(len(START)) == START


def copy(source: Any, target: Any) -> Any:
    """Copy a group, with all in it, between this form and netCDF4, in either direction; return the target."""
    target.setncatts({name: source.getncattr(name) for name in source.ncattrs()})
    for name, dimension in source.dimensions.items():
        target.createDimension(name, len(dimension))
    for name, variable in source.variables.items():
        written = target.createVariable(name, variable.dtype, variable.dimensions)
        written.setncatts({key: variable.getncattr(key) for key in variable.ncattrs()})
        written[...] = np.ma.getdata(variable[...])
    for name, group in source.groups.items():
        copy(group, target.createGroup(name))
    return target


def _described(group: Group, archive: zipfile.ZipFile) -> dict[str, Any]:
    """Write the arrays of a group and return the rest of it, for the header."""
    for name, variable in group.variables.items():
        data = io.BytesIO()
        np.lib.format.write_array(data, np.ascontiguousarray(variable.values), allow_pickle=False)
        archive.writestr(f"{group.path.strip('/')}/{name}.npy".lstrip("/"), data.getvalue())
    return {
        "dimensions": {name: len(rows) for name, rows in group.dimensions.items()},
        "attributes": _as_json(group),
        "variables": {
            name: {"dimensions": v.dimensions, "attributes": _as_json(v)} for name, v in group.variables.items()
        },
        "groups": {name: _described(inner, archive) for name, inner in group.groups.items()},
    }


def _as_json(of: Attributes) -> dict[str, Any]:
    values = {name: of.getncattr(name) for name in of.ncattrs()}
    return {
        name: value if isinstance(value, str) else [value.dtype.str, value.tolist()] for name, value in values.items()
    }


def _fill(group: Group, header: Mapping[str, Any], archive: zipfile.ZipFile) -> None:
    """Read a group. Raises many kinds of errors if the archive is damaged."""
    for name, size in header["dimensions"].items():
        group.createDimension(name, int(size))
    _set(group, header["attributes"])
    for name, about in header["variables"].items():
        data = io.BytesIO(archive.read(f"{group.path.strip('/')}/{name}.npy".lstrip("/")))
        values, dimensions = np.lib.format.read_array(data, allow_pickle=False), tuple(about["dimensions"])
        if values.dtype.str[1:] not in KINDS or values.shape != tuple(map(group._length, dimensions)):
            raise ValueError(name)
        group.variables[name] = NamedArray(name, values, dimensions)
        _set(group.variables[name], about["attributes"])
    for name, inner in header["groups"].items():
        _fill(group.createGroup(name), inner, archive)


def _set(of: Attributes, values: Mapping[str, Any]) -> None:
    if not {value[0][1:] for value in values.values() if not isinstance(value, str)} <= {*KINDS}:
        raise ValueError("another type")
    of.setncatts(
        {name: value if isinstance(value, str) else np.array(value[1], value[0]) for name, value in values.items()}
    )
