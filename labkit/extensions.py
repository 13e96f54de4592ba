"""Extending labkit from outside: registries of paths, contact laws, recorded statistics and engines.

A user's own file registers a class or a function:

    @labkit.register_path
    @dataclasses.dataclass(frozen=True)
    class ConstantAxialStress(labkit.Path): ...

and becomes known by `labkit COMMAND ... --use FILE`, by `use: FILE` in a campaign, by the environment variable
LABKIT_USE (files, separated as in PATH; child processes inherit it), or as an installed package with an entry point in
the group `labkit.extensions` that names its module. No file of labkit changes.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.util
import inspect
import os
import sys
import traceback
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from labkit.errors import InputError

VARIABLE = "LABKIT_USE"
GROUP = "labkit.extensions"


class Registry(Mapping[str, Any]):
    """Name -> class, instance or function. What labkit brings is loaded when it is first asked for.

    kind: what messages call an entry; builtin: name -> `module:attribute`; aliases: other names of entries.
    """

    def __init__(self, kind: str, builtin: dict[str, str], aliases: dict[str, str] | None = None) -> None:
        """Registers nothing yet beyond `builtin`."""
        self.kind, self._entries, self._aliases = kind, dict[str, Any](builtin), aliases or {}

    def register(self, entry: Any) -> Any:
        """Makes an entry known under its `name`; a decorator. Raises InputError for a name that is taken."""
        name = getattr(entry, "name", None)
        if not isinstance(name, str) or not name:
            raise InputError(f'{_label(entry)} has no name: give it one, e.g. name = "mine"')
        taken = self._entries.get(name, self._aliases.get(name))
        if taken is not None and _origin(taken) != _origin(entry):
            raise InputError(f"is the name of another {self.kind}", field="name", value=name, allowed="another name")
        self._entries[name] = entry
        return entry

    def __getitem__(self, name: str) -> Any:
        if self._aliases.get(name, name) not in self._entries:
            load_extensions()
        name = self._aliases.get(name, name)
        entry = self._entries[name]
        if isinstance(entry, str):
            module, attribute = entry.split(":")
            self._entries[name] = entry = getattr(importlib.import_module(module), attribute)
        return entry

    def __contains__(self, name: object) -> bool:
        if name not in self._entries and name not in self._aliases:
            load_extensions()
        return name in self._entries or name in self._aliases

    def __iter__(self) -> Iterator[str]:
        load_extensions()
        return iter(tuple(self._entries))

    def __len__(self) -> int:
        load_extensions()
        return len(self._entries)

    def require(self, name: str, field: str | None = None) -> Any:
        """The entry of that name. Raises InputError that lists the names there are."""
        try:
            return self[name]
        except KeyError:
            said = {"field": field or self.kind, "value": name, "allowed": self.allowed}
            raise InputError("is unknown", quoted=True, **said) from None

    @property
    def allowed(self) -> str:
        """What to give, for an error."""
        return f"one of {', '.join(self)}, or load the file that registers it (--use FILE, labkit.use)"

    def name(self, name: str) -> str:
        """The name proper of an entry that may be called by an earlier one."""
        return self._aliases.get(name, name)

    def earlier(self, name: str) -> tuple[str, ...]:
        """The earlier names of an entry."""
        return tuple(alias for alias, known in self._aliases.items() if known == name)

    def names(self) -> tuple[str, ...]:
        """All names, those of earlier versions too."""
        return (*self, *self._aliases)


def _origin(entry: Any) -> str:
    """Where an entry was defined: a file that is loaded twice registers the same thing."""
    if isinstance(entry, str):
        return entry
    kind = getattr(entry, "function", entry)  # a statistic is made of one
    return f"{file_of(kind)}:{kind.__qualname__}"


def file_of(entry: Any) -> str | None:
    """The file that defines a class or function, None for one of a session without a file."""
    try:
        return str(Path(inspect.getfile(entry)).resolve())
    except (TypeError, OSError):
        return None


def use(file: str | os.PathLike[str]) -> None:
    """Loads a file that registers extensions, for this process and for its children. Raises InputError."""
    path = Path(file).resolve()
    if not path.is_file():
        allowed = "a Python file that registers extensions"
        raise InputError("does not exist", field="use", value=str(file), allowed=allowed)
    _load(str(path))
    known = used()
    if str(path) not in known:
        os.environ[VARIABLE] = os.pathsep.join([*known, str(path)])


def used() -> list[str]:
    """The files in use, absolute."""
    return [file for file in os.environ.get(VARIABLE, "").split(os.pathsep) if file]


@functools.cache
def load_extensions() -> None:
    """Loads the files of LABKIT_USE and the installed extensions, once."""
    for file in used():
        _load(file)
    from importlib.metadata import entry_points

    for point in entry_points(group=GROUP):
        try:
            point.load()
        except Exception as error:
            said = f"the installed extension {point.value} cannot be loaded ({type(error).__name__}: {error})"
            raise InputError(f"{said}: repair or remove it") from error


def _load(file: str) -> None:
    # named after its text: Numba's cache asks for the module by its name, also where the file is a copy
    name = f"labkit_extension_{hashlib.sha256(Path(file).read_bytes()).hexdigest()[:12]}"
    main = getattr(sys.modules.get("__main__"), "__file__", None)
    if name in sys.modules or (main and str(Path(main).resolve()) == file):
        return  # it is here already, perhaps as the program itself
    specification = importlib.util.spec_from_file_location(name, file)
    if specification is None or specification.loader is None:
        raise InputError("is not a Python file", field="use", value=file, allowed="a file that ends in .py")
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module
    try:
        specification.loader.exec_module(module)
    except InputError as error:
        del sys.modules[name]
        raise InputError(f"is refused: {error}", field="use", value=file) from error
    except BaseException as error:
        del sys.modules[name]
        if isinstance(error, (SystemExit, Exception)):
            said = f"cannot be loaded ({type(error).__name__}: {error})"
            raise InputError(said, field="use", value=file, allowed="a file that Python can import") from error
        raise


def blamed(error: BaseException) -> str | None:
    """Where in a file of the user's own an error arose, as one line; None if it did not arise there."""
    files, line = used(), None
    for frame in traceback.extract_tb(error.__traceback__):
        if str(Path(frame.filename)) in files:
            line = f"{Path(frame.filename).name} line {frame.lineno}"
    text = (str(error).strip() or type(error).__name__).splitlines()[0]
    return None if line is None else f"{line}: {type(error).__name__}: {text}"


def _label(entry: Any) -> str:
    return str(getattr(entry, "__qualname__", type(entry).__name__))
