"""Makes arguments and options of a command from the signature of its function and from the table of parameters.

    def verify(
        run: Annotated[list[str], Option("run file")],
        *,
        rows: Annotated[int, Option("number of rows of the table")] = 20,
        computation: Annotated[Start, Made(start_of_options)],
    ) -> int:

Parameters before `*` become arguments, the rest options; a default makes either optional. A Section stands for several
options, for example for an option of each parameter of a dataclass, and collects the texts that the user gives.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import inspect
import os
import typing
from collections.abc import Callable, Collection, Iterable, Sequence
from types import NoneType
from typing import Annotated, Literal, TypeVar

from labkit.cli.parser import HELP, Parser, name_list, summary_of
from labkit.engines import ENGINES, Device
from labkit.engines.device import PRECISIONS
from labkit.errors import InputError, as_typed, instead_of, option_name
from labkit.files.atomic import target_of
from labkit.parameters import Parameter, Values, options_of, parameters_of
from labkit.paths.path import Path
from labkit.paths.registry import PATHS
from labkit.specimens.recipe import SETTINGS

NUMBER, STRAIN = Parameter("number"), Parameter("strain")
OUTPUTS = ("output", "csv", "json", "figure")  # options that name a file to write
Value = TypeVar("Value")
Reader = Callable[[str], object]  # converts text on the command line to a value
Texts = Values  # given parameter -> its text on the command line


@dataclasses.dataclass(frozen=True)
class Option:
    """An argument or an option with one value.

    Args:
        help: Help text; the default is added.
        metavar: Name of the value in the help (default: N for a number, else the name of the option).
        type: Converts text to the value (default: the type of the annotation; `int` means a whole number above 0).
        group: Title of the group of the option in the help.
    """

    help: str
    metavar: str | None = None
    type: Reader | None = None
    group: str | None = None


class Section:
    """Several options from which one argument of a command's function is made."""

    def add(self, parser: Parser) -> None:
        """Add the options to the parser; by default, there are none."""

    def read(self, options: argparse.Namespace) -> object:
        """Return the argument that the values of the options make. Raises InputError for invalid values."""
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class Single(Section):
    """A section with one option, which is a parameter of a function with its annotation."""

    parameter: inspect.Parameter
    kind: object
    option: Option

    def add(self, parser: Parser) -> None:
        option, name, default = self.option, self.parameter.name, self.parameter.default
        required = default is inspect.Parameter.empty
        read, metavar, several = _value(self.kind)
        help = option.help.replace("%", "%%")
        if not (required or default in (None, False, ()) or "(default" in help):
            help += f" (default: {as_typed(default)})"
        names, how = ["-o"] * (name == "output") + [option_name(name)], Values()
        if self.kind is bool:
            how["action"] = "store_true"
        elif self.parameter.kind is inspect.Parameter.KEYWORD_ONLY:
            how = {"nargs": "+" if several else None, "required": required, "metavar": option.metavar or metavar}
        else:
            how["nargs"] = ("+" if required else "*") if several else None if required else "?"
            names, how["metavar"] = [name], option.metavar or name.upper()
            default = None if default == () else default
        if self.kind is not bool:
            how["type"] = option.type or (number if read is float else read)
        parser.add_argument(*names, group=option.group, help=help, default=None if required else default, **how)

    def read(self, options: argparse.Namespace) -> object:
        """Return the value of the option; if it is an output that the user typed as a link, return the target."""
        value = getattr(options, self.parameter.name)
        typed = self.parameter.name in OUTPUTS and value not in (None, self.parameter.default)
        return target_of(value) if typed else value


def _value(kind: object) -> tuple[Reader, str | None, bool]:
    """Return the function that reads a type, the name of its values in the help, and True if the type is a list."""
    origin, parts = typing.get_origin(kind), [part for part in typing.get_args(kind) if part is not NoneType]
    if origin is Literal:
        return one_of(parts), f"{{{','.join(parts)}}}", False
    if parts:
        read, metavar, several = _value(parts[0])
        return read, metavar, several or origin in (list, Sequence)
    return (positive_int, "N", False) if kind is int else (typing.cast("Reader", kind), None, False)


def sections_of(function: Callable[..., object]) -> dict[str, Section]:
    """Return the sections of a command's function, argument -> Section."""
    hints = typing.get_type_hints(function, include_extras=True)
    sections: dict[str, Section] = {}
    for name, parameter in inspect.signature(function).parameters.items():
        kind, *marks = typing.get_args(hints[name])
        mark = next(candidate for candidate in marks if isinstance(candidate, Option | Section))
        sections[name] = Single(parameter, kind, mark) if isinstance(mark, Option) else mark
    return sections


# --- sections --------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class ParameterTexts(Section):
    """An option for each parameter of a dataclass; the argument holds the texts that the user gives.

    Args:
        kind: The dataclass.
        title: Title of the group in the help.
        note: Line below the title.
        leave_out: Parameters without an option.
        unset: True if the defaults are determined at run time, so that the help omits them.
        as_instance: True if the argument is an instance of the dataclass, made from the texts.
    """

    kind: type
    title: str
    note: str | None = None
    leave_out: Collection[str] = ()
    unset: bool = False
    as_instance: bool = False

    def add(self, parser: Parser) -> None:
        for parameter in self._parameters():
            help = help_of(parameter, None if self.unset else parameter.default)
            _add(parser, parameter, help, self.title, self.note)

    def read(self, options: argparse.Namespace) -> object:
        texts = _texts_of(options, self._parameters())
        return self.kind(**texts) if self.as_instance else texts

    def _parameters(self) -> list[Parameter]:
        return [parameter for parameter in options_of(self.kind).values() if parameter.name not in self.leave_out]


Instance = functools.partial(ParameterTexts, as_instance=True)


@dataclasses.dataclass(frozen=True)
class PathOptions(Section):
    """An option for each parameter of the loading paths; if the user names a path, the help shows only its options."""

    leave_out: Collection[str] = ()

    def add(self, parser: Parser) -> None:
        """Add the options; their help gives the meaning of a parameter for each path."""
        explained = paths_to_explain(parser.words)
        helps: dict[str, dict[str, list[str]]] = {}
        first: dict[str, Parameter] = {}
        for kind in PATHS.values():
            for parameter in self._of(kind):
                first.setdefault(parameter.name, parameter)
                meanings = helps.setdefault(parameter.name, {})
                if kind in explained:
                    meanings.setdefault(help_of(parameter), []).append(kind.name)
        for name, meanings in helps.items():
            texts = [f"{', '.join(paths)}: {text}" if len(meanings) > 1 else text for text, paths in meanings.items()]
            _add(parser, first[name], "; ".join(texts) if texts else argparse.SUPPRESS, "loading path")

    def read(self, options: argparse.Namespace) -> Texts:
        """Return the texts that the user gave."""
        return _texts_of(options, [parameter for kind in PATHS.values() for parameter in self._of(kind)])

    def _of(self, kind: type[Path]) -> list[Parameter]:
        return [parameter for parameter in parameters_of(kind).values() if parameter.name not in self.leave_out]


def paths_to_explain(words: Collection[str]) -> list[type[Path]]:
    """Return the loading paths for the help: the path that the words name, or all paths."""
    named = [PATHS[word] for word in words if word in PATHS][:1] if HELP & set(words) else []
    return named or list(PATHS.values())


def list_of_paths(words: Collection[str]) -> str:
    """List the loading paths, for the end of the help of a command."""
    return name_list("loading path", {kind.name: summary_of(kind) for kind in paths_to_explain(words)})


def help_of(parameter: Parameter, default: object = dataclasses.MISSING) -> str:
    """Return the help text of an option, with its unit and default."""
    default = parameter.default if default is dataclasses.MISSING else default
    unit = f" in {parameter.unit}" if parameter.unit != "1" else ""
    suffix = "" if default is dataclasses.MISSING or default is None else f" (default: {as_typed(default)})"
    text, bracket, rest = parameter.help.partition(" (default: ")  # the text may contain a default in words
    return f"{text}{unit}{bracket}{rest}{suffix}".replace("%", "%%")


def _add(parser: Parser, parameter: Parameter, help: str, group: str, note: str | None = None) -> None:
    choices = f"; one of {', '.join(parameter.choices)}" if parameter.choices is not None else ""
    help = help if help == argparse.SUPPRESS else help + choices
    parser.add_argument(option_name(parameter.name), group=group, note=note, metavar=parameter.name.upper(), help=help)


def _texts_of(options: argparse.Namespace, parameters: Iterable[Parameter]) -> Texts:
    texts = ((row, getattr(options, row.name)) for row in parameters)
    return {row.name: row.require_unit(text) for row, text in texts if text is not None}


@dataclasses.dataclass(frozen=True)
class Made(Section):
    """The arguments and options of a function, whose result is one argument of a command."""

    function: Callable[..., object]

    def add(self, parser: Parser) -> None:
        for section in sections_of(self.function).values():
            section.add(parser)

    def arguments(self, options: argparse.Namespace) -> Values:
        """Return the arguments of the function that the values of the options make. Raises InputError."""
        return {name: section.read(options) for name, section in sections_of(self.function).items()}

    def read(self, options: argparse.Namespace) -> object:
        return self.function(**self.arguments(options))


class CommandLine(Section):
    """The command line as typed, for the history of a file; this section adds no option."""

    def read(self, options: argparse.Namespace) -> str:
        return str(options.command_line)


# --- types of values -------------------------------------------------------------------------------------------------


def one_of(choices: Collection[str]) -> Callable[[str], str]:
    """Return the type of an option that accepts these values; if they are a registry, errors mention --use."""

    def read(text: str) -> str:
        if text not in choices:
            raise argparse.ArgumentTypeError(f"{text!r} is unknown: give {instead_of(choices, text)}")
        return text

    return read


def positive_int(text: str) -> int:
    """Convert text to a positive integer."""
    if not (text.isascii() and text.isdecimal() and len(text) <= 18 and int(text) >= 1):
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is not a whole number above 0")
    return int(text)


def number(text: str, parameter: Parameter = NUMBER) -> float:
    """Convert text to a number."""
    try:
        return float(parameter.read(parameter.require_unit(text)))
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error).removeprefix(f"{parameter.name} ")) from None


def strain(text: str) -> float:
    """Convert text to a strain; a number above 1 needs a unit."""
    return number(text, STRAIN)


def threads(text: str) -> int:
    """Convert text to a number of threads that this computer can run."""
    value, most = positive_int(text), 4 * (os.cpu_count() or 1)
    if value > most:
        raise argparse.ArgumentTypeError(f"{value} threads are too many for this computer: give at most {most}")
    return value


def require(value: Value | None, field: str, example: str | None = None) -> Value:
    """Return the value. Raises InputError with an example if the user did not give it."""
    if value is None:
        raise InputError(f"is missing: give {example or 'it'} (see --help)", field=field)
    return value


# --- options of several commands -------------------------------------------------------------------------------------


def device_of_options(
    *,
    engine: Annotated[
        str, Option(f"simulation engine, one of {', '.join(ENGINES)}", type=one_of(ENGINES), group="computation")
    ] = "fused",
    threads: Annotated[int, Option("number of threads", type=threads, group="computation")] = 1,
    ranks: Annotated[
        int, Option("number of MPI ranks of the engines fused and lammps", type=positive_int, group="computation")
    ] = 1,
    precision: Annotated[str, Option(PRECISION, type=one_of(PRECISIONS), group="computation")] = "double",
) -> Device:
    """Return the requested engine. Raises InputError for threads or ranks that it does not have."""
    return Device(engine, threads, precision, ranks)


PRECISION = "double, or mixed on the engine fused: faster, with half of the numbers in single precision"

FROM = "state file, or run file, which stands for its final state"
FromSnapshot = Annotated[
    int | None, Option("take this snapshot of a run file, at rest; a negative number counts from the end", type=int)
]
Csv = Annotated[str | None, Option("also write the table as CSV, to this file", "FILE")]
Working = Annotated[Device, Made(device_of_options)]
History = Annotated[str, CommandLine()]
Preset = Annotated[
    str | None,
    Option(
        f"trade-off between speed and accuracy, one of {', '.join(SETTINGS)}: chooses the size of a specimen, the "
        "rate of a run and the time step of both (default: standard)",
        type=one_of(SETTINGS),
        group="computation",
    ),
]
