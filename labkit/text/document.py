"""A YAML file as nodes with line numbers: reads the fields of a mapping as Parameters and collects every error."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from labkit.errors import InputError, nearest
from labkit.parameters import Parameter, Values
from labkit.process.extras import install_command
from labkit.text.foreign import note_file, require_regular
from labkit.text.labels import label_of, label_rows

if TYPE_CHECKING:
    from yaml.nodes import Node as YamlNode

MOST_COMBINATIONS = 10_000  # largest number of combinations of the listed values in an entry
MOST_ERRORS = 100  # maximum number of errors in one report
MOST_BYTES = 1_000_000  # largest size of a file
MOST_NODES = 100_000  # largest number of values in a file with all aliases expanded
MOST_SIMILAR = 1000  # largest number of names among which a similar name is searched
Made = TypeVar("Made")


class Errors:
    """The errors in a file, with their lines; files that it names are relative to its `folder`."""

    def __init__(self, folder: Path) -> None:
        """Start without errors."""
        self.folder = folder
        self.all: dict[tuple[int, str], None] = {}

    def add(self, line: int, text: str) -> None:
        """Add an error unless it is already listed."""
        self.all[line, text] = None

    @property
    def count(self) -> int:
        """Number of errors."""
        return len(self.all)

    def report(self, file: Path) -> str:
        """Report one line per error, in the order of the file."""
        number = "an error" if self.count == 1 else f"{self.count} errors"
        lines = [f"{file} has {number}, nothing was started"]
        lines += [f"  line {line}: {text}" for line, text in sorted(self.all)[:MOST_ERRORS]]
        return "\n".join(lines + ["  ..."] * (self.count > MOST_ERRORS))


@dataclasses.dataclass(frozen=True)
class Kind:
    """A kind of YAML file, for messages: its name, needs and contents, and the page that describes it."""

    name: str
    needs: str
    holds: str
    page: str


CAMPAIGN = Kind("campaign", "PyYAML and Snakemake", "`specimens:` and `runs:`", "docs/campaigns.md")


def read_text(file: Path, kind: Kind = CAMPAIGN) -> str:
    """Read the text of a file. Raises InputError if it cannot be read."""
    try:
        require_regular(file, f"give a {kind.name} file")
        if file.stat().st_size > MOST_BYTES:
            raise InputError(f"{file} has more than {MOST_BYTES / 1e6:g} MB: give a {kind.name} file, see {kind.page}")
        note_file(file)
        return file.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{file} is not UTF-8 text: give a {kind.name} file, see {kind.page}") from None
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}): give a {kind.name} file") from None


class Text(str):
    """A single value, with its line; `empty` is True if YAML reads it as null."""

    line: int
    size = 1
    empty: bool


class Rows(list["Node"]):
    """A list, with its first line; `size` is the number of its values with all aliases expanded."""

    line: int
    size: int


class Block(dict[str, "Node"]):
    """A mapping, with its first line and the lines of its names; `size` is as for Rows."""

    line: int
    size: int
    lines: dict[str, int]


Node = Text | Rows | Block


class TooManyValues(Exception):
    """The list or mapping at this line has too many values when its aliases are expanded, or contains itself."""


class Entry(NamedTuple):
    """An entry of a section: its name, its line and its content."""

    name: str
    line: int
    content: Node


def compose(text: str, errors: Errors, kind: Kind = CAMPAIGN) -> Block | None:
    """Parse the YAML mapping in a text, or return None after a syntax error. Raises InputError without PyYAML."""
    try:
        import yaml
    except ImportError:
        raise InputError(f"a {kind.name} needs {kind.needs}: {install_command('campaign')}") from None
    line, problem = 1, f"a {kind.name} file holds {kind.holds}, see {kind.page}"
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        document = None if root is None else _convert(root, errors, {})
        if isinstance(document, Block):
            return document
    except TooManyValues as error:
        line = error.args[0]
        problem = f"its aliases stand for more than {MOST_NODES} values: write them out, or leave some out"
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, problem = 1 if mark is None else mark.line + 1, f"this is not YAML: {error.problem}"
    except RecursionError:
        problem = f"nested too deep: a {kind.name} file holds names, and values of these names"
    except yaml.YAMLError as error:
        problem = f"this is not YAML: {str(error).splitlines()[0]}"
    errors.add(line, problem)
    return None


def _line(node: YamlNode) -> int:
    return int(node.start_mark.line) + 1


def _convert(node: YamlNode, errors: Errors, done: dict[int, Node | None]) -> Node:
    """Convert a node to Text, Rows or Block; add an error for each name that is not a word or not unique.

    `done` maps the id of a node to its content, or None while that node is being converted. Raises TooManyValues.
    """
    from yaml import MappingNode

    if id(node) in done:
        if (earlier := done[id(node)]) is None:
            raise TooManyValues(_line(node))
        return earlier
    content: Node
    done[id(node)] = None
    if isinstance(node.value, str):
        content = Text(node.value)
        content.empty = node.value == "" or node.tag.endswith(":null")
    elif isinstance(node, MappingNode):  # whatever its tag
        content = Block()
        content.lines = {}
        for key, value in node.value:
            if not isinstance(key.value, str):
                errors.add(_line(key), f"{kind_of(_convert(key, errors, done))} is not a name: write a word")
            elif key.value in content:
                first = f"first in line {content.lines[key.value]}"
                errors.add(_line(key), f"{key.value!r} is defined twice, {first}: choose another name")
            else:
                content[key.value], content.lines[key.value] = _convert(value, errors, done), _line(key)
    else:
        content = Rows(_convert(item, errors, done) for item in node.value)
        content.size = 1 + sum(item.size for item in content)
    if isinstance(content, Block):
        content.size = 1 + len(content) + sum(value.size for value in content.values())
    if content.size > MOST_NODES:
        raise TooManyValues(_line(node))
    content.line = _line(node)
    done[id(node)] = content
    return content


def kind_of(node: Node) -> str:
    """Describe a node, for messages."""
    if isinstance(node, Text):
        return "empty" if node == "" else "a single value"
    return "a list" if isinstance(node, Rows) else "a mapping"


@dataclasses.dataclass
class Fields:
    """The fields of one mapping.

    Args:
        where: Name of the mapping in messages.
        line: First line of the mapping.
        errors: Errors of the file.
        values: Values in SI units, name -> value; a list if several values were given.
        lines: Lines of the fields, name -> line.
        broken: Names whose values cannot be read.
        pairs: Values that belong together, as the Fields of each row of `pairs`.
    """

    where: str
    line: int
    errors: Errors
    values: Values = dataclasses.field(default_factory=dict)
    lines: dict[str, int] = dataclasses.field(default_factory=dict)
    broken: set[str] = dataclasses.field(default_factory=set)
    pairs: list[Fields] = dataclasses.field(default_factory=list)

    def has(self, name: str) -> bool:
        """Return True if the field is given, valid or not."""
        return name in self.values or name in self.broken

    def values_of(self, name: str) -> list[str]:
        """Return the values of a field as a list, which is empty if the field is missing or broken."""
        value = self.values.get(name, [])
        return value if isinstance(value, list) else [value]

    def combinations(self, listed: Collection[str] = ()) -> list[tuple[str, Fields]]:
        """Return (suffix of the name, Fields) for each combination of listed values; the lists in `kept` are not split.

        The rows of `pairs` are combined with the lists, each row as a whole.
        Adds an error if there are too many combinations.
        """
        lists = {name: value for name, value in self.values.items() if isinstance(value, list) and name not in listed}
        if max(len(self.pairs), 1) * math.prod(map(len, lists.values())) > MOST_COMBINATIONS:
            self.error(f"has more than {MOST_COMBINATIONS} combinations of values: make several campaigns of them")
            return []
        every = []
        for (of_row, row), values in itertools.product(
            label_rows(self.pairs) or [("", self)], itertools.product(*lists.values())
        ):
            suffix = "".join(f"-{label_of(*pair)}" for pair in zip(lists, values, lists.values(), strict=True))
            every.append((of_row + suffix, self._with(row, dict(zip(lists, values, strict=True)))))
        return every

    def _with(self, row: Fields, chosen: Mapping[str, object]) -> Fields:
        """Return the fields with one row of `pairs` and one value of each list."""
        values = {**self.values, **row.values, **chosen}
        lines, broken = {**self.lines, **row.lines}, self.broken | row.broken
        return dataclasses.replace(self, values=values, lines=lines, broken=broken, pairs=[])

    def error(self, problem: str, name: str | None = None, where: str | None = None) -> None:
        """Add an error at the line of a field, or of the mapping; `where` replaces the mapping's name."""
        self.errors.add(self.lines.get(name or "", self.line), f"{where or self.where}: {problem}")

    def require(self, needed: Iterable[Parameter], example: str | None = None) -> bool:
        """Return True if all these fields are given; for each missing field, add an error that suggests `example`."""
        missing = [parameter for parameter in needed if not self.has(parameter.name)]
        for parameter in missing:
            self.error(f"{parameter.name} is missing: give it, e.g. {example or parameter.example}")
        return not missing

    def attempt(self, make: Callable[..., Made], *arguments: object, where: str | None = None) -> Made | None:
        """Return the result of `make`, or None after recording its error; `where` replaces the mapping's name."""
        try:
            return make(*arguments)
        except InputError as error:
            self.error(error.message(), error.field, where)
        except ValueError as error:  # raised by a user-defined path
            self.error(str(error), None, where)
        return None


def read_fields(
    node: Node,
    parameters: Mapping[str, Parameter],
    where: str,
    errors: Errors,
    several: Collection[str] = (),
    sections: Collection[str] = (),
    line: int | None = None,
) -> Fields:
    """Read the fields of a mapping; add an error for each invalid name or value, and leave it out.

    Args:
        node: The mapping.
        parameters: Valid fields, name -> Parameter.
        where: Name of the mapping in messages.
        errors: Errors of the file.
        several: Names that accept a list of values.
        sections: Names that are read elsewhere.
        line: Line of the mapping (default: the line of the node).
    """
    fields = Fields(where, line or node.line, errors)
    if not isinstance(node, Block):
        errors.add(node.line, f"{where} is {kind_of(node)}: write names and values, `key: value`")
        return fields
    fields.lines = dict(node.lines)
    for name, value in node.items():
        if name in parameters and name not in sections:
            _read(fields, parameters[name], value, name in several and parameters[name].kind is not tuple)
        elif name not in sections:
            fields.error(f"{name!r} is unknown{similar(name, list(dict.fromkeys((*parameters, *sections))))}", name)
    return fields


def _read(fields: Fields, parameter: Parameter, node: Node, several: bool) -> None:
    """Read one field: a value, or a list of values."""
    name, errors, is_list = (
        parameter.name,
        fields.errors,
        isinstance(node, Rows) and (several or parameter.kind is tuple),
    )
    where = f"{fields.where}: {name}"
    nodes: Sequence[Node] = node if is_list and isinstance(node, Rows) else [node]
    if not nodes:
        errors.add(node.line, f"{where} is an empty list: give a value, or leave it out")
    texts = [scalar(node, where, errors) for node in nodes]
    fields.broken.add(name)  # removed below if the value is valid
    if not nodes or None in texts:
        return
    lined: Sequence[tuple[int, object]] = [(value.line, value) for value in nodes]
    values = []
    for line, value in [(node.line, texts)] if parameter.kind is tuple else lined:
        try:
            values.append(parameter.read(parameter.require_unit(value)))
        except InputError as error:
            errors.add(line, f"{fields.where}: {error.message()}")
            return
    if parameter.kind is not tuple and len(set(values)) < len(values):
        errors.add(node.line, f"{where} lists the same value twice: leave one out")
        return
    fields.broken.discard(name)
    fields.values[name] = values if is_list and several else values[0]


def scalar(node: Node, where: str, errors: Errors) -> str | None:
    """Return the text of a single value, or None after adding an error."""
    if isinstance(node, Text) and not node.empty:
        return str(node)
    problem = "empty: give a value, or leave it out" if isinstance(node, Text) else f"{kind_of(node)}: give one value"
    errors.add(node.line, f"{where} is {problem}")
    return None


def similar(name: str, names: Collection[str]) -> str:
    """Suggest the most similar known name for a misspelled name, for the end of a message."""
    if not 0 < len(names) <= MOST_SIMILAR:
        return ""
    close = nearest(name, names)
    return f": did you mean {close!r}?" if close else f": use {', '.join(names)}"
