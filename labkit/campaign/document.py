"""A YAML file as nodes with line numbers: reads the fields of a mapping as Parameters and collects every error."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeGuard, TypeVar

from labkit.errors import InputError, nearest
from labkit.io.extras import install_command
from labkit.parameters import Parameter

if TYPE_CHECKING:
    from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

MOST_ERRORS = 100  # shown in one report
MOST_BYTES = 1_000_000  # of a file
MOST_NODES = 100_000  # values in a file, each alias counted with all that it stands for
MOST_SIMILAR = 1000  # names among which a similar one is looked for
Made = TypeVar("Made")


class Errors:
    """The errors in a file, with their lines."""

    def __init__(self) -> None:
        """No errors yet."""
        self.all: dict[tuple[int, str], None] = {}

    def add(self, line: int, text: str) -> None:
        """Adds an error unless it is already listed."""
        self.all[line, text] = None

    @property
    def count(self) -> int:
        """Number of errors."""
        return len(self.all)

    def report(self, file: Path) -> str:
        """One line per error, in the order of the file."""
        number = "an error" if self.count == 1 else f"{self.count} errors"
        lines = [f"{file} has {number}, nothing was started"]
        lines += [f"  line {line}: {text}" for line, text in sorted(self.all)[:MOST_ERRORS]]
        return "\n".join(lines + ["  ..."] * (self.count > MOST_ERRORS))


@dataclasses.dataclass(frozen=True)
class Kind:
    """A kind of YAML file, for messages: its name, what it needs, what it holds, and the page that describes it."""

    name: str
    needs: str
    holds: str
    page: str


CAMPAIGN = Kind("campaign", "PyYAML and Snakemake", "`specimens:` and `runs:`", "docs/campaigns.md")


def read_text(file: Path, kind: Kind = CAMPAIGN) -> str:
    """Text of a file. Raises InputError if it cannot be read."""
    try:
        if file.exists() and not file.is_file():
            raise InputError(f"{file} cannot be read (not a regular file): give a {kind.name} file")
        if file.stat().st_size > MOST_BYTES:
            raise InputError(f"{file} has more than {MOST_BYTES / 1e6:g} MB: give a {kind.name} file, see {kind.page}")
        return file.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{file} is not UTF-8 text: give a {kind.name} file, see {kind.page}") from None
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}): give a {kind.name} file") from None


def compose(text: str, errors: Errors, kind: Kind = CAMPAIGN) -> MappingNode | None:
    """The YAML mapping in a text, or None after a syntax error. Raises InputError if PyYAML is not installed."""
    try:
        import yaml
    except ImportError:
        raise InputError(f"a {kind.name} needs {kind.needs}: {install_command('campaign')}") from None
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        errors.add(1 if mark is None else mark.line + 1, f"this is not YAML: {error.problem}")
        return None
    except RecursionError:
        errors.add(1, f"nested too deep: a {kind.name} file holds names, and values of these names")
        return None
    except yaml.YAMLError as error:
        errors.add(1, f"this is not YAML: {str(error).splitlines()[0]}")
        return None
    if root is not None and (line := _exploding(root)) is not None:
        errors.add(line, f"its aliases stand for more than {MOST_NODES} values: write them out, or leave some out")
        return None
    if root is None or not is_mapping(root):
        errors.add(1, f"a {kind.name} file holds {kind.holds}, see {kind.page}")
        return None
    return root


def _exploding(root: Node) -> int | None:
    """Line of a list or mapping that stands for too many values through its aliases, or contains itself; else None."""
    sizes: dict[int, int] = {}
    stack, open_nodes = [(root, False)], set()
    while stack:
        node, visited = stack.pop()
        children = [] if is_scalar(node) else _children(node)
        if visited:
            open_nodes.discard(id(node))
            sizes[id(node)] = 1 + sum(sizes[id(child)] for child in children)
            if sizes[id(node)] > MOST_NODES:
                return line_of(node)
        elif id(node) in open_nodes:
            return line_of(node)
        elif id(node) not in sizes:
            open_nodes.add(id(node))
            stack.append((node, True))
            stack += [(child, False) for child in children]
    return None


def _children(node: Node) -> list[Node]:
    if is_mapping(node):
        return [child for pair in node.value for child in pair]
    return list(node.value)


def is_mapping(node: Node) -> TypeGuard[MappingNode]:
    """True for a mapping."""
    return _id(node) == "mapping"


def is_list(node: Node) -> TypeGuard[SequenceNode]:
    """True for a list."""
    return _id(node) == "sequence"


def is_scalar(node: Node) -> TypeGuard[ScalarNode]:
    """True for a single value."""
    return _id(node) == "scalar"


def _id(node: Node) -> str:
    return node.id  # type: ignore[attr-defined]  # every class of PyYAML's nodes has one, the stubs' base class does not


def line_of(node: Node) -> int:
    """Line at which a node begins, counted from 1."""
    return node.start_mark.line + 1


class Entry(NamedTuple):
    """A key of a mapping, with its line, and its value."""

    name: str
    line: int
    value: Node


def entries(node: Node, where: str, errors: Errors) -> list[Entry]:
    """Entries of a mapping; adds an error for a duplicate key. where: name of the mapping in messages."""
    if not is_mapping(node):
        errors.add(line_of(node), f"{where} is {_kind(node)}: write names and values, `key: value`")
        return []
    first: dict[str, Entry] = {}
    for key, value in node.value:
        if not is_scalar(key):
            errors.add(line_of(key), f"{where} has {_kind(key)} for a name: write a word")
        elif key.value in first:
            problem = f"{key.value!r} is defined twice, first in line {first[key.value].line}: choose another name"
            errors.add(line_of(key), problem)
        else:
            first[key.value] = Entry(key.value, line_of(key), value)
    return list(first.values())


def _kind(node: Node) -> str:
    empty = is_scalar(node) and node.value == ""
    return "empty" if empty else {"scalar": "a single value", "sequence": "a list", "mapping": "a mapping"}[_id(node)]


@dataclasses.dataclass
class Fields:
    """The fields of one mapping.

    where: name of the mapping in messages; line: where it begins; values: name -> value in SI units, a list where
    several values were given; lines: name -> line; broken: names whose value cannot be read.
    """

    where: str
    line: int
    errors: Errors
    values: dict[str, Any] = dataclasses.field(default_factory=dict)
    lines: dict[str, int] = dataclasses.field(default_factory=dict)
    broken: set[str] = dataclasses.field(default_factory=set)

    def has(self, name: str) -> bool:
        """True if the field is given, valid or not."""
        return name in self.values or name in self.broken

    def listed(self, name: str) -> list[Any]:
        """Values of a field, as a list: empty if the field is missing or broken."""
        value = self.values.get(name, [])
        return value if isinstance(value, list) else [value]

    def error(self, problem: str, name: str | None = None, where: str | None = None) -> None:
        """Adds an error at the line of a field, or of the mapping. where: replaces the mapping's name."""
        self.errors.add(self.lines.get(name or "", self.line), f"{where or self.where}: {problem}")

    def require(self, needed: Iterable[Parameter], example: str | None = None) -> bool:
        """True if all these fields are given; adds an error for each missing one. example: a value to suggest."""
        missing = [known for known in needed if not self.has(known.name)]
        for known in missing:
            self.error(f"{known.name} is missing: give it, e.g. {example or known.example}")
        return not missing

    def attempt(self, make: Callable[[], Made], where: str | None = None) -> Made | None:
        """Result of `make`, or None after adding the error that it raised. where: replaces the mapping's name."""
        try:
            return make()
        except InputError as error:
            self.error(error.said(), error.field, where)
        except ValueError as error:  # from a user-defined path
            self.error(str(error), None, where)
        return None


def read_fields(
    node: Node,
    known: Mapping[str, Parameter],
    where: str,
    errors: Errors,
    several: Collection[str] = (),
    sections: Collection[str] = (),
    line: int | None = None,
) -> Fields:
    """Reads the fields of a mapping; adds an error for each name or value that is not valid and leaves it out.

    known: name -> Parameter; several: names that accept a list of values; sections: names that are read elsewhere.
    """
    fields = Fields(where, line or line_of(node), errors)
    for name, at, value in entries(node, where, errors):
        if name in sections:
            continue
        fields.lines[name] = at
        if name in known:
            _read(fields, known[name], value, name in several and known[name].kind is not tuple)
        else:
            fields.error(f"{name!r} is unknown{similar(name, list(dict.fromkeys((*known, *sections))))}", name)
    return fields


def _read(fields: Fields, known: Parameter, node: Node, several: bool) -> None:
    """Reads one field: a value, or a list of values."""
    name, listed = known.name, is_list(node) and (several or known.kind is tuple)
    where, errors = f"{fields.where}: {name}", fields.errors
    nodes = node.value if listed else [node]
    if not nodes:
        errors.add(line_of(node), f"{where} is an empty list: give a value, or leave it out")
    texts = [scalar(one, where, errors) for one in nodes]
    fields.broken.add(name)  # removed below if the value is valid
    if not nodes or None in texts:
        return
    if known.kind is tuple:
        given: list[tuple[int, Any]] = [(line_of(node), texts)]
    else:
        given = list(zip(map(line_of, nodes), texts, strict=True))
    values = []
    for line, value in given:
        try:
            values.append(known.read(value))
        except InputError as error:
            errors.add(line, f"{fields.where}: {error.said()}")
    if len(values) < len(given):
        return
    if known.kind is not tuple and len(set(values)) < len(values):
        errors.add(line_of(node), f"{where} lists the same value twice: leave one out")
        return
    fields.broken.discard(name)
    fields.values[name] = values if listed and several else values[0]


def scalar(node: Node, where: str, errors: Errors) -> str | None:
    """Text of a single value, or None after adding an error."""
    if not is_scalar(node):
        errors.add(line_of(node), f"{where} is {_kind(node)}: give one value")
    elif node.value == "" or node.tag.endswith(":null"):
        errors.add(line_of(node), f"{where} is empty: give a value, or leave it out")
    else:
        return str(node.value)
    return None


def similar(name: str, known: Collection[str]) -> str:
    """A suggestion for a misspelled name, to append to the message."""
    if not 0 < len(known) <= MOST_SIMILAR:
        return ""
    close = nearest(name, known)
    return f": did you mean {close!r}?" if close else f": use {', '.join(known)}"
