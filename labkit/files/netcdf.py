"""Reads and writes all netCDF files of labkit.

Reading: HDF5 checks its own checksums, which cover data, attributes and tables, and the schema is checked before a
value is used. An error of the netCDF library becomes one sentence that names the file.

Writing: a complete file gets the hash of its data, and only then does it appear under its name.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from labkit.errors import InputError
from labkit.files.atomic import reserve, whole_file
from labkit.files.hashes import DamagedVariable, data_sha256
from labkit.files.library import LIBRARY
from labkit.files.opening import dataset_at, require_name
from labkit.files.schema import AXES, SIZES, TIME, Variable, require_schema
from labkit.parameters import Values

if TYPE_CHECKING:
    import netCDF4
    import xarray

CHUNK = {"time": 256, "snapshot": 1, "contact": 8192, "grain": 16384}  # values in a chunk along a dimension
LOCKING = "HDF5_USE_FILE_LOCKING"  # environment variable of HDF5
MARGIN = 50_000  # approximate size of a small file without its arrays, bytes
NETCDF = "NetCDF:"  # start of messages of the netCDF library
ADVICE = "restore a copy or create it again"


# --- reading --------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def open_netcdf(path: str | os.PathLike[str], kind: str) -> Iterator[netCDF4.Dataset]:
    """Context with a netCDF4.Dataset open for reading, after its schema has been checked.

    `kind` is "state", "run", "probes" or "statistics". Raises InputError if the file is damaged or of another kind.
    """
    path = Path(path)
    with _open_named(path, f"give a labkit {kind} file") as dataset:
        actual = _text(dataset, "labkit_file")
        if actual != kind:
            raise InputError(f"{path} is {kind_in_words(actual)}: give a labkit {kind} file")
        require_schema(path, dataset, kind)
        yield dataset


def labkit_kind(path: str | os.PathLike[str]) -> str | None:
    """Return the kind of a labkit file, e.g. `state`; None for any other file."""
    path = Path(path)
    if not path.is_file():
        return None
    require_name(path)
    try:
        with LIBRARY, dataset_at(path) as dataset:
            return _text(dataset, "labkit_file")
    except (OSError, RuntimeError, UnicodeError):
        return None


def attribute_of(path: str | os.PathLike[str], name: str) -> str | None:
    """Return a text attribute of any netCDF file, or None. Raises InputError if the file is damaged."""
    with _open_named(Path(path), "give a netCDF file") as dataset:
        return _text(dataset, name)


def hash_verdict(path: str | os.PathLike[str]) -> str | None:
    """Return whether the data of a netCDF file are the `same` as their hash, or it `differs`; None without a hash."""
    with _open_named(Path(path), "give a netCDF file") as dataset:
        stored = _text(dataset, "data_sha256")
        with contextlib.suppress(DamagedVariable):
            return stored and ("same" if data_sha256(dataset) == stored else "differs")
        return "differs"


def kind_in_words(kind: str | None) -> str:
    """Describe a kind of file within a sentence."""
    return f"a labkit {kind} file" if kind else "not a labkit file"


@contextlib.contextmanager
def _open_named(path: Path, instead: str) -> Iterator[netCDF4.Dataset]:
    """Context with an open file, whose errors name it."""
    if not path.is_file():
        raise InputError(f"{path} does not exist: {instead}")
    require_name(path)
    with LIBRARY:
        try:
            dataset = dataset_at(path)
        except PermissionError:
            raise InputError(f"{path} is not readable: change its permissions, or choose another file") from None
        except (OSError, RuntimeError, UnicodeError):
            advice = f"; if its file system has no locks, set {LOCKING}=FALSE before Python starts"
            advice = "" if os.environ.get(LOCKING) == "FALSE" else advice
            raise InputError(f"{path} is not a netCDF file, or is damaged: {instead}{advice}") from None
        with contextlib.closing(dataset), name_damage(path):
            yield dataset


@contextlib.contextmanager
def name_damage(path: str | os.PathLike[str]) -> Iterator[None]:
    """Context in which an error of the netCDF library becomes an InputError that names the file."""
    try:
        yield
    except (OSError, RuntimeError, AttributeError) as error:
        if not _is_of_library(error):
            raise
        raise damage_error(path, str(error)) from None


def _is_of_library(error: Exception) -> bool:
    return isinstance(error, DamagedVariable) or str(error).startswith(NETCDF)


def damage_error(path: str | os.PathLike[str], why: str) -> InputError:
    """Return the error for a damaged file."""
    return InputError(f"{path} is damaged ({why}): {ADVICE}")


def _text(dataset: netCDF4.Dataset, name: str) -> str | None:
    """Return a text attribute of a file; None if it is missing or not text."""
    try:
        value = dataset.getncattr(name) if name in dataset.ncattrs() else None
    except (RuntimeError, OSError, UnicodeError, AttributeError):
        return None
    return value if isinstance(value, str) else None


# --- writing --------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def new_netcdf(path: str | os.PathLike[str], size: int = 0) -> Iterator[netCDF4.Dataset]:
    """Context with a new netCDF4.Dataset; on success it becomes the file `path`.

    The file is not created unless the disk has room for `size` bytes. Raises OSError with `path` as its file name if
    the disk is full or fails.
    """
    require_name(path)
    with whole_file(path) as temporary, name_failure(path), _on_disk(temporary, "w", size) as dataset:
        yield dataset


@contextlib.contextmanager
def extend_netcdf(path: Path, more: int) -> Iterator[netCDF4.Dataset]:
    """Context with a copy of the file `path` open for changes; the copy replaces the file on success.

    At most `more` bytes may be added. Raises OSError as new_netcdf does.
    """
    with whole_file(path) as temporary, name_failure(path):
        shutil.copyfile(path, temporary)
        with _on_disk(temporary, "a", os.path.getsize(temporary) + more) as dataset:
            yield dataset


def write_xarray(path: str | os.PathLike[str], data: xarray.Dataset, **encoding: object) -> None:
    """Write an xarray.Dataset atomically as a netCDF file with its hash. Raises OSError as new_netcdf does."""
    from xarray.backends import NetCDF4DataStore

    require_name(path)
    with whole_file(path) as temporary, name_failure(path), LIBRARY:
        reserve(temporary, MARGIN + 2 * data.nbytes)
        with contextlib.closing(NetCDF4DataStore.open(temporary, mode="w", lock=LIBRARY)) as store:
            data.dump_to_store(store, **encoding)
        finish(temporary)


@contextlib.contextmanager
def _on_disk(file: Path, mode: Literal["w", "a"], size: int) -> Iterator[netCDF4.Dataset]:
    """Context with an open netCDF4.Dataset; on success the file has its hash.

    HDF5 may crash the interpreter if its last write fails. The disk space is therefore allocated first
    (`reserve`), and everything is on the disk before the file is closed: closing only rewrites the first 48 bytes. (A
    netCDF-4 file created in memory cannot be extended, and needs its size in memory.)
    """
    reserve(file, size or MARGIN)
    with open(file, "ab") as handle:
        with LIBRARY, dataset_at(file, mode) as dataset:
            yield dataset
            set_hash(dataset)
            dataset.sync()
            os.fsync(handle.fileno())
    _require_whole(file)


def finish(file: Path) -> None:
    """Add the hash to a complete netCDF file that was just written."""
    with LIBRARY, dataset_at(file, "a") as dataset:
        set_hash(dataset)
    _require_whole(file)


def set_hash(dataset: netCDF4.Dataset) -> None:
    """Write the hash of the data of an open file, unless it is an unfinished run."""
    for name in {"data_sha256", "seal"} & set(dataset.ncattrs()):  # the second is of files of earlier versions
        dataset.delncattr(name)
    if getattr(dataset, "complete", 1):
        dataset.data_sha256 = data_sha256(dataset)


def _require_whole(file: Path) -> None:
    """Raise OSError if a file that was just closed is truncated."""
    with LIBRARY, dataset_at(file):
        pass


@contextlib.contextmanager
def name_failure(path: str | os.PathLike[str]) -> Iterator[None]:
    """Context in which an error of the netCDF library while writing becomes an OSError with the file name."""
    try:
        yield
    except (PermissionError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and not _is_of_library(error):
            raise
        said = error if isinstance(error, RuntimeError) else "HDF5 cannot open it"  # the reason is unknown
        left = shutil.disk_usage(os.path.dirname(os.path.realpath(path))).free / 1e6
        raise OSError(None, f"it could not be written ({said}; {left:.3g} MB are free there)", str(path)) from error


def create_variables(
    group: netCDF4.Dataset, table: Mapping[str, Variable], sizes: Mapping[str, int], compressed: bool = True
) -> None:
    """Create the variables of a schema table in a netCDF group; dimensions without a size are unlimited.

    Coordinate variables label the dimensions `i` and `j` with x, y, z. Every chunk has a checksum (fletcher32),
    which any program that reads the file checks.
    """
    for variable in table.values():
        for dimension in variable.dimensions:
            if not _has_dimension(group, dimension):
                group.createDimension(dimension, {**SIZES, **sizes}.get(dimension))
                if dimension in AXES:
                    _create_labels(group, dimension)
        how = storage(variable, sizes, compressed)
        created = group.createVariable(variable.name, variable.dtype, variable.dimensions, **how)
        created.setncatts(variable.attributes | (TIME if variable.name == "time" else {}))


def _create_labels(group: netCDF4.Dataset, dimension: str) -> None:
    """Write the labels of the components along a dimension as characters, which have a checksum, unlike strings."""
    if not _has_dimension(group, "letter"):
        group.createDimension("letter", 1)
    labels = group.createVariable(dimension, "S1", (dimension, "letter"), fletcher32=True)
    labels.setncatts({"units": "1", "long_name": "component", "_Encoding": "utf-8"})
    labels[:] = np.array(AXES[dimension], "S1")[:, np.newaxis]  # netCDF4 before 1.7.2 would split text into bytes


def storage(variable: Variable, sizes: Mapping[str, int], compressed: bool) -> Values:
    """Return the storage options of a variable, as netCDF4 and xarray name them; see create_variables."""
    lengths = {**SIZES, **sizes}
    chunks = tuple(_chunk_size(name, lengths.get(name)) for name in variable.dimensions)
    packed = {"zlib": compressed, "complevel": int(compressed), "shuffle": compressed}
    return {**packed, "fletcher32": True, "chunksizes": chunks}


def _chunk_size(dimension: str, size: int | None) -> int:
    """Return the chunk length along a dimension; `size` is None for an unlimited dimension."""
    return CHUNK[dimension] if size is None else min(CHUNK.get(dimension, size), max(size, 1))


def _has_dimension(group: netCDF4.Dataset | None, name: str) -> bool:
    """Return True if a group, or a group that contains it, has a dimension with this name."""
    return group is not None and (name in group.dimensions or _has_dimension(group.parent, name))
