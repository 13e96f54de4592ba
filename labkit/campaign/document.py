"""A YAML file as nodes with lines: fields of a mapping are read as Parameters, and every mistake is collected."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from labkit.errors import InputError
from labkit.parameters import Parameter

if TYPE_CHECKING:
    from yaml.nodes import Node

MOST_MISTAKES = 100  # that are shown
Made = TypeVar("Made")


class Mistakes:
    """Collects what is wrong in a file."""

    def __init__(self) -> None:
        """None yet."""
        self.all: list[tuple[int, str]] = []

    def add(self, line: int, text: str) -> None:
        """Adds a mistake, once."""
        if (line, text) not in self.all:
            self.all.append((line, text))

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.all)

    def report(self, file: Path) -> str:
        """One line per mistake, in the order of the file."""
        what = "a mistake" if self.count == 1 else f"{self.count} mistakes"
        lines = [f"{file} has {what}, nothing was started"]
        lines += [f"  line {line}: {text}" for line, text in sorted(self.all)[:MOST_MISTAKES]]
        return "\n".join(lines + ["  ..."] * (self.count > MOST_MISTAKES))


def read_text(file: Path) -> str:
    """The text of a file. Raises InputError if it cannot be read."""
    try:
        return file.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{file} is not UTF-8 text: give a campaign file, see README.md") from None
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}): give a campaign file") from None


def compose(text: str, mistakes: Mistakes) -> Node | None:
    """The YAML mapping in a text, or None after a mistake of YAML. Raises InputError without PyYAML."""
    try:
        import yaml
    except ImportError:
        raise InputError("a campaign needs PyYAML and Snakemake: pip install 'labkit[campaign]'") from None
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        mistakes.add(mark.line + 1, f"this is not YAML: {error.problem}")
        return None
    except RecursionError:
        mistakes.add(1, "it is nested too deep: a campaign file has names, and values of these names")
        return None
    except yaml.YAMLError as error:
        mistakes.add(1, f"this is not YAML: {str(error).splitlines()[0]}")
        return None
    if root is None or root.id != "mapping":
        mistakes.add(1, "a campaign file holds `specimens:` and `runs:`, see README.md")
        return None
    return root


def line_of(node: Node) -> int:
    """Where a node begins, from 1."""
    return node.start_mark.line + 1


class Entry(NamedTuple):
    """A key of a mapping, with its line, and its value."""

    name: str
    line: int
    value: Node


def entries(node: Node, where: str, mistakes: Mistakes) -> list[Entry]:
    """The entries of a mapping; a key that is there twice is a mistake."""
    if node.id != "mapping":
        mistakes.add(line_of(node), f"{where} is {_kind(node)}: write names and values, `key: value`")
        return []
    first: dict[str, Entry] = {}
    for key, value in node.value:
        if key.id != "scalar":
            mistakes.add(line_of(key), f"{where} has {_kind(key)} for a name: write a word")
        elif key.value in first:
            said = f"{key.value!r} is there twice, first in line {first[key.value].line}: give another name"
            mistakes.add(line_of(key), said)
        else:
            first[key.value] = Entry(key.value, line_of(key), value)
    return list(first.values())


def _kind(node: Node) -> str:
    empty = node.id == "scalar" and node.value == ""
    return "empty" if empty else {"scalar": "a single value", "sequence": "a list", "mapping": "a mapping"}[node.id]


@dataclasses.dataclass
class Fields:
    """What one mapping says. where: how messages call it; line: where it begins; values: name -> value in SI units (a
    list of them where there may be several); lines: name -> line; broken: names that were given and cannot be read.
    """

    where: str
    line: int
    mistakes: Mistakes
    values: dict[str, Any] = dataclasses.field(default_factory=dict)
    lines: dict[str, int] = dataclasses.field(default_factory=dict)
    broken: set[str] = dataclasses.field(default_factory=set)

    def has(self, name: str) -> bool:
        """Whether it is given, rightly or wrongly."""
        return name in self.values or name in self.broken

    def listed(self, name: str) -> list[Any]:
        """The values of a name that may have several; none if it is not given."""
        value = self.values.get(name, [])
        return value if isinstance(value, list) else [value]

    def mistake(self, text: str, name: str | None = None, where: str | None = None) -> None:
        """Adds a mistake in the line of a field, or of the whole. where: in place of the mapping's own."""
        self.mistakes.add(self.lines.get(name or "", self.line), f"{where or self.where}: {text}")

    def require(self, known: Iterable[Parameter], example: str | None = None) -> bool:
        """Whether all of these are given; those that are not are mistakes. example: of a value."""
        missing = [one for one in known if not self.has(one.name)]
        for one in missing:
            self.mistake(f"{one.name} is missing: give it, e.g. {example or one.example}")
        return not missing

    def attempt(self, make: Callable[[], Made], where: str | None = None) -> Made | None:
        """What `make` returns; None after its error became a mistake. where: in place of the mapping's own."""
        try:
            return make()
        except InputError as error:
            self.mistake(error.said(), error.field, where)
        except ValueError as error:  # of a path of one's own
            self.mistake(str(error), None, where)
        return None


def read_fields(
    node: Node,
    known: Mapping[str, Parameter],
    where: str,
    mistakes: Mistakes,
    several: Collection[str] = (),
    sections: Collection[str] = (),
    line: int | None = None,
) -> Fields:
    """The fields of a mapping; what is unknown or cannot be read is a mistake and is left out.

    known: name -> Parameter; several: names that may have a list of values; sections: names that others read.
    """
    fields = Fields(where, line or line_of(node), mistakes)
    for name, at, value in entries(node, where, mistakes):
        if name in sections:
            continue
        fields.lines[name] = at
        if name in known:
            _read(fields, known[name], value, name in several and known[name].kind is not tuple)
        else:
            fields.mistake(f"{name!r} is unknown{similar(name, (*known, *sections))}", name)
    return fields


def _read(fields: Fields, known: Parameter, node: Node, several: bool) -> None:
    """Reads one field, a value or several."""
    name, listed = known.name, node.id == "sequence" and (several or known.kind is tuple)
    where, mistakes = f"{fields.where}: {name}", fields.mistakes
    nodes = node.value if listed else [node]
    if not nodes:
        mistakes.add(line_of(node), f"{where} is an empty list: give a value, or leave it out")
    texts = [scalar(one, where, mistakes) for one in nodes]
    fields.broken.add(name)  # until it is known to be right
    if not nodes or None in texts:
        return
    read = []
    for line, value in (
        [(line_of(node), texts)] if known.kind is tuple else zip(map(line_of, nodes), texts, strict=True)
    ):
        try:
            read.append(known.read(value, unit_needed=True))
        except InputError as error:
            mistakes.add(line, f"{fields.where}: {error.said()}")
    if known.kind is not tuple and len(read) == len(texts) > len(set(read)):
        mistakes.add(line_of(node), f"{where} has the same value twice: leave one out")
    elif len(read) == (1 if known.kind is tuple else len(texts)):
        fields.broken.discard(name)
        fields.values[name] = read if listed and several else read[0]


def scalar(node: Node, where: str, mistakes: Mistakes) -> str | None:
    """The text of a single value, or None after a mistake."""
    if node.id != "scalar":
        mistakes.add(line_of(node), f"{where} is {_kind(node)}: give one value")
    elif node.value == "" or node.tag.endswith(":null"):
        mistakes.add(line_of(node), f"{where} is empty: give a value, or leave it out")
    else:
        return node.value
    return None


def similar(name: str, known: Collection[str]) -> str:
    """What a wrong name may have been meant for, to be put behind the mistake."""
    if not known:
        return ""
    close = difflib.get_close_matches(name, known, 1)
    return f": did you mean {close[0]!r}?" if close else f": use {', '.join(known)}"
