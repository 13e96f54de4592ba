"""The interface of a file format, and the registry of formats, to which users can add their own formats.

Each format is a subclass of Format in a file of its own. It reads only what the file contains: missing information is
None in the Packing, and the user must give it (labkit.plugins.exchange.packing).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, TypeVar

from labkit.errors import InputError
from labkit.extensions import Registry, require_subclass
from labkit.files.netcdf import labkit_kind
from labkit.plugins.exchange.contact_list import ContactList
from labkit.plugins.exchange.packing import Answers, Packing
from labkit.text.foreign import content_of, require_regular
from labkit.text.reading import decode, read_table, text_of

if TYPE_CHECKING:
    from labkit.grains.state import State

TABLE = "labkit does not read it: export the grains as a table of x y z radius"
NOT_READ = {  # first characters of a file -> what it is, and what to give
    r"---\s{1,9}(creator|timestep|time|units|natoms):": "a LAMMPS dump in YAML: write it with dump custom",
    r"(//[^\n]*\s{1,9}){0,9}Begin [A-Z]": f"a Kratos model part, {TABLE}",
    r"LammpS RestartT": "a binary restart file of LAMMPS: write a data file with lmp -restart2data",
    r"Number of particles =": f"a configuration of AtomEye, {TABLE}",
    r"LSMGenGeo|LSMGeometry": f"a geometry of ESyS-Particle, {TABLE}",
    r"\s{0,99}(<|\{|\[\s{0,9}\{)": f"XML, HTML or JSON, {TABLE}",
}
HEAD = 4096  # number of bytes from which a format is recognised


class Format:
    """A file format. A subclass implements one or more of `read`, `read_contacts`, and `write` or `write_frames`.

    Users choose a format by its `name`; its file names end with one of the `endings`, e.g. `.dump`; the help shows the
    `description`.
    """

    name: ClassVar[str]
    description: ClassVar[str] = ""
    endings: ClassVar[tuple[str, ...]] = ()
    keeps_clumps: ClassVar[bool] = False  # True if written files record which spheres form a clump
    keeps_contacts: ClassVar[bool] = False  # True if written files contain the contacts

    def recognises(self, file: Path, head: str) -> bool:
        """Return True if a file has this format; `head` holds its first characters, after decompression."""
        return False  # the default, for a format that is only written

    def read(self, file: Path, answers: Answers) -> Packing:
        """Read the grains of a file, and its contacts if it has any. Raises InputError for a damaged file."""
        raise InputError(f"{file}: labkit does not read grains from {self.name} files")

    def read_contacts(self, file: Path, answers: Answers) -> ContactList:
        """Read the contacts of a file that contains only contacts. Raises InputError for a damaged file."""
        raise InputError(f"{file}: labkit does not read contact lists from {self.name} files")

    def write(self, state: State, file: Path) -> None:
        """Write the grains and contacts of a State."""
        self.write_frames([state], file)

    def write_frames(self, states: Iterable[State], file: Path) -> None:
        """Write several States one after another, in a format that has trajectories."""
        raise InputError(f"{file}: labkit does not write {self.name} files")

    def can(self, *methods: str) -> bool:
        """Return True if labkit can do one of these with files of this format, e.g. `read` or `write_frames`."""
        return any(getattr(type(self), method) is not getattr(Format, method) for method in methods)


Kind = TypeVar("Kind", bound=Format)

# A file is compared with the formats in this order; any other text is a table.
FORMATS = Registry[type[Format]](
    "file format",
    {
        "sphere_pack": "labkit.plugins.exchange.yade:SpherePack",
        "yade_save": "labkit.plugins.exchange.yade:YadeSave",
        "yade_script": "labkit.plugins.exchange.yade:YadeScript",
        "lammps_data": "labkit.plugins.exchange.lammps:LammpsData",
        "lammps_dump": "labkit.plugins.exchange.lammps:LammpsDump",
        "lammps_local": "labkit.plugins.exchange.lammps:LammpsLocal",
        "mercury": "labkit.plugins.exchange.mercury:MercuryRestart",
        "ondem": "labkit.plugins.exchange.ondem:OnDem",
        "extended_xyz": "labkit.plugins.exchange.extended_xyz:ExtendedXyz",
        "vtk": "labkit.plugins.exchange.vtk:Vtk",
        "state_archive": "labkit.plugins.exchange.archive:StateArchive",
        "numpy": "labkit.plugins.exchange.numpy_arrays:NumpyArrays",
        "table": "labkit.plugins.exchange.tables:TextTable",
    },
)


def register_format(kind: type[Kind]) -> type[Kind]:
    """Register a subclass of Format under its `name`, and return the subclass; used as a decorator."""
    require_subclass(kind, Format)
    return FORMATS.register(kind)


def format_of(file: Path, name: str | None = None) -> Format:
    """Return the format with this name or, without a name, the format that recognises the file. Raises InputError."""
    if name is None and not file.exists():
        raise InputError(f"{file} does not exist: give a file of grains or contacts")
    if not file.is_dir():
        require_regular(file)
    if file.suffix in (".nc", ".npz") and (kind := labkit_kind(file)):
        raise InputError(f"{file} is a {kind} file of labkit: commands read it as it is, without import")
    if name is not None:
        return FORMATS.require(name, "format")()
    head = head_of(file)
    order = sorted(FORMATS, key=lambda name: name == "table")  # tables come last, after the formats that users add
    for name in order:
        other = next((what for start, what in NOT_READ.items() if name == "table" and re.match(start, head)), None)
        if other is not None:
            raise InputError(f"{file} is {other}")
        candidate = FORMATS[name]()
        if candidate.recognises(file, head):
            return candidate
    reason = "" if file.is_dir() else _no_table(file)
    raise InputError(
        f"{file} has no format that labkit recognises{reason}: give --format (in Python format=), one of "
        f"{', '.join(FORMATS)}, or a file of columns x y z radius"
    )


def _no_table(file: Path) -> str:
    """Return why a file is not a table, in brackets. Raises InputError, which says what it is, if it is not text."""
    text = text_of(file)
    try:
        read_table(text, "it")
    except InputError as error:
        return f" ({str(error).removesuffix(': give a table')})"
    return ""


def writers() -> dict[str, Format]:
    """Return the formats that can be written, name -> format."""
    return {name: writer for name in FORMATS if (writer := FORMATS[name]()).can("write", "write_frames")}


def format_to_write(file: Path, name: str | None) -> Format:
    """Return the format to write, chosen by name or by the ending of the file name. Raises InputError."""
    known_formats = writers()
    if name is not None:
        if name not in known_formats:
            allowed = f"one of {', '.join(known_formats)}"
            raise InputError("cannot be written", field="format", value=name, allowed=allowed, quoted=True)
        return known_formats[name]
    for writer in known_formats.values():
        if file.name.lower().endswith(writer.endings):
            return writer
    endings = ", ".join(ending for writer in known_formats.values() for ending in writer.endings)
    raise InputError(f"{file} has an unknown file extension: use one of {endings}, or give --format")


def head_of(file: Path) -> str:
    """Read the first characters of a file, after decompression; empty for a folder."""
    return "" if file.is_dir() else decode(content_of(file, HEAD))


def damaged_file(file: Path, problem: object) -> InputError:
    """Return the InputError for a file that cannot be read; `problem` is a sentence or an exception."""
    if isinstance(problem, InputError):  # its message already says what to do
        return problem
    words = "it ends too early" if isinstance(problem, IndexError) else problem
    return InputError(f"{file} is damaged or of an unknown version ({words}): give another file")
