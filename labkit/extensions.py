"""Extensions: registries of paths, contact laws, recorded statistics, figures and engines.

A user's file registers a class or a function:

    @labkit.register_path
    @dataclasses.dataclass(frozen=True)
    class ConstantAxialStress(labkit.Path): ...

and is loaded by `labkit COMMAND ... --use FILE`, by `use: FILE` in a campaign, by `labkit.use(FILE)`, or by the
environment variable LABKIT_USE (files, separated as in PATH; child processes inherit it). An installed package is
loaded if it has an entry point in the group `labkit.extensions` that names its module. labkit itself is not changed.
"""

from __future__ import annotations

import hashlib
import importlib
import inspect
import os
import sys
import traceback
import types
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar, cast

from labkit.errors import InputError, instead_of, require_file_name
from labkit.once import LOCK, once
from labkit.plugins import load_plugins, missing

VARIABLE = "LABKIT_USE"
GROUP = "labkit.extensions"


Entry = TypeVar("Entry")
Registered = TypeVar("Registered")


class Registry(Mapping[str, Entry], Generic[Entry]):
    """Mapping of name -> class or object. Built-in entries are imported on first use.

    Args:
        kind: Term for an entry in messages.
        builtin: Built-in entries, name -> `module:attribute`.
        meant: Common words that are no names -> the names to suggest instead.
    """

    every: ClassVar[list[Registry[Any]]] = []

    def __init__(self, kind: str, builtin: dict[str, str], meant: Mapping[str, str] | None = None) -> None:
        """Start with the built-in entries only."""
        self.kind, self._entries, self._meant = kind, dict[str, Entry | str](builtin), meant or {}
        self.every.append(self)

    def register(self, entry: Registered) -> Registered:
        """Register an entry under its `name` and return it; usable as a decorator.

        Raises InputError if the name is missing or already taken.
        """
        name = getattr(entry, "name", None)
        if not isinstance(name, str) or not name:
            raise InputError(f'{_label(entry)} has no name: give it one, e.g. name = "mine"')
        taken = self._entries.get(name)
        if taken is not None and _origin(taken) != _origin(entry):
            raise self._name_error(name)
        self._entries[name] = cast(Entry, entry)
        return entry

    def offer(self, name: str, place: str) -> None:
        """Register the entry at `place`, a `module:attribute` that is imported on first use.

        Raises InputError if the name is taken, for example by a user's file that was loaded earlier.
        """
        taken = self._entries.setdefault(name, place)
        if taken != place:
            raise self._name_error(name)

    def forget(self, file: str) -> None:
        """Remove the entries that a user's file has registered."""
        mine = [name for name, entry in self._entries.items() if _origin(entry).startswith(f"{file}:")]
        for name in mine:
            del self._entries[name]

    def _name_error(self, name: str) -> InputError:
        return InputError(f"is the name of another {self.kind}", field="name", value=name, allowed="another name")

    def __getitem__(self, name: str) -> Entry:
        if name not in self._entries:
            load_extensions()
        entry = self._entries[name]
        if isinstance(entry, str):
            module, attribute = entry.split(":")
            loaded: Entry = getattr(importlib.import_module(module), attribute)
            self._entries[name] = loaded
            return loaded
        return entry

    def __contains__(self, name: object) -> bool:
        if name not in self._entries:
            load_extensions()
        return name in self._entries

    def __iter__(self) -> Iterator[str]:
        load_extensions()
        return iter(tuple(self._entries))

    def __len__(self) -> int:
        load_extensions()
        return len(self._entries)

    def require(self, name: str, field: str | None = None) -> Entry:
        """Return the entry with this name. Raises InputError with a list of all names if the name is unknown."""
        try:
            return self[name]
        except KeyError:
            raise InputError(
                "is unknown", field=field or self.kind, value=name, allowed=self.instead_of(name), quoted=True
            ) from None

    def instead_of(self, name: object) -> str:
        """List the valid names, the most similar one first, for an error message."""
        meant = self._meant.get(str(name).lower())
        listed = instead_of(tuple(self), name) if meant is None else f"{meant}, or another of {', '.join(self)}"
        return f"{listed}, or load the file that registers it (--use FILE, labkit.use){missing()}"


def _origin(entry: object) -> str:
    """Return where an entry is defined, `module or file:name`, to recognise a file that is loaded twice."""
    if isinstance(entry, str):
        return entry
    definition = getattr(entry, "function", entry)  # Statistic and RunFigure objects wrap a function
    place = definition.__module__ if is_labkits(definition) else file_of(definition)
    return f"{place}:{_label(definition)}"


def is_labkits(entry: object) -> bool:
    """Return True if a class or function is part of labkit, not of an extension; one without a module is not."""
    return str(entry.__module__).startswith("labkit.")


def file_of(entry: object) -> str | None:
    """Return the path of the file that defines a class or function; None if it was defined interactively."""
    try:
        return str(Path(inspect.getfile(cast(type, entry))).resolve())
    except (TypeError, OSError):
        return None


def use(file: str | os.PathLike[str]) -> None:
    """Load a file that registers extensions, for this process and its child processes.

    Raises InputError if the file does not exist, cannot be imported or registers a name that is already taken.
    """
    require_file_name(file, "labkit.use('mine.py')")
    path = Path(os.path.realpath(file))  # Path.resolve raises an error for a loop of links
    if not path.is_file():
        problem = "is not a file" if path.exists() else "does not exist"
        raise InputError(problem, field="use", value=str(file), allowed="a Python file that registers extensions")
    if os.pathsep in str(path):
        problem = f"has {os.pathsep!r} in its path, which separates the files of {VARIABLE}"
        raise InputError(problem, field="use", value=str(path), allowed="the file in another folder")
    with LOCK:  # another thread must not take the file for loaded before its end
        _load(str(path))
    files = files_in_use()
    if str(path) not in files:
        os.environ[VARIABLE] = os.pathsep.join([*files, str(path)])


def files_in_use() -> list[str]:
    """Return the absolute paths of the extension files in use."""
    return [file for file in os.environ.get(VARIABLE, "").split(os.pathsep) if file]


@once
def load_extensions() -> None:
    """Load the plug-ins, the files of LABKIT_USE and the installed extensions, once per process."""
    load_plugins()
    load_plugins("engines")
    for file in files_in_use():
        _load(file)
    from importlib.metadata import entry_points

    for point in entry_points(group=GROUP):
        try:
            point.load()
        except Exception as error:
            problem = f"the installed extension {point.value} cannot be loaded ({type(error).__name__}: {error})"
            raise InputError(f"{problem}: repair or uninstall it") from error


def _load(file: str) -> None:
    # A hash of the text names the module. Cached compiled code is found by this name, even for a copy of the file.
    try:
        source = Path(file).read_bytes()
    except OSError as error:
        problem = f"cannot be read ({error.strerror}; {VARIABLE} names it)"
        raise InputError(problem, field="use", value=file, allowed="a Python file that registers extensions") from None
    name = f"labkit_extension_{hashlib.sha256(source).hexdigest()[:12]}"
    main = getattr(sys.modules.get("__main__"), "__file__", None)
    if name in sys.modules or (main and str(Path(main).resolve()) == file):
        return  # already loaded, or the file is the running program
    if not file.endswith(".py"):
        raise InputError("is not a Python file", field="use", value=file, allowed="a file whose name ends in .py")
    sys.modules[name] = types.ModuleType(name)
    sys.modules[name].__file__ = file
    try:
        exec(compile(source, file, "exec"), vars(sys.modules[name]))  # no .pyc file is read or written
    except BaseException as error:
        for registry in Registry.every:
            registry.forget(file)
        del sys.modules[name]
        if isinstance(error, InputError):
            raise InputError(f"is refused: {error}", field="use", value=file) from error
        if isinstance(error, KeyboardInterrupt):
            raise
        problem = f"cannot be loaded ({blame(error, [file]) or f'{type(error).__name__}: {error}'})"
        raise InputError(problem, field="use", value=file, allowed="a file that Python can import") from error


def blame(error: BaseException, files: Sequence[str] = ()) -> str | None:
    """Return file, line and message of an error raised in a user's file, as one line; None for any other error.

    Args:
        error: The error, with its traceback.
        files: Paths of the user's files (default: the extension files in use).
    """
    files, line = files or files_in_use(), None
    for frame in traceback.extract_tb(error.__traceback__):
        if str(Path(frame.filename)) in files:
            line = f"{Path(frame.filename).name} line {frame.lineno}"
    text = (str(error).strip() or type(error).__name__).splitlines()[0]
    return None if line is None else f"{line}: {type(error).__name__}: {text}"


def require_subclass(kind: object, base: type) -> None:
    """Raise InputError if a user registers something else than a subclass of `base`."""
    if not (isinstance(kind, type) and issubclass(kind, base) and kind is not base):
        raise InputError(f"{_label(kind)} is not a subclass of labkit.{base.__name__}: register one")


def require_function(entry: object) -> None:
    """Raise InputError if a user registers something else than a function."""
    if not callable(entry):
        raise InputError(f"{_label(entry)} is not a function: register one")


def _label(entry: object) -> str:
    return str(getattr(entry, "__qualname__", type(entry).__name__))
