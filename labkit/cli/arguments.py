"""Options of the command line, made of the table of parameters; the same for `labkit`, `yade -n -x` and yade-batch."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable
from typing import Any

from labkit.cli.parser import Parser
from labkit.dem.settings import SETTINGS
from labkit.engines import ENGINES
from labkit.errors import InputError, option_name
from labkit.parameters import Parameter, help_of, parameters_of


def add_parameters(
    parser: argparse.ArgumentParser, kind: type, leave_out: Iterable[str] = (), unset: bool = False
) -> None:
    """An option for every parameter of a dataclass; its value is text, which `given` reads.

    unset: the defaults are not the class's but something that the help cannot know.
    """
    for known in parameters_of(kind).values():
        if known.option and known.name not in leave_out:
            _add(parser, known, help_of(known, None if unset else known.default))


def add_path_parameters(parser: argparse.ArgumentParser, kinds: Iterable[type], leave_out: Iterable[str] = ()) -> None:
    """An option for every parameter that any of these paths has; the help says what it is for which path."""
    options: dict[str, dict[str, list[str]]] = {}
    first: dict[str, Parameter] = {}
    for kind in kinds:
        for known in parameters_of(kind).values():
            if known.name in leave_out:
                continue
            first.setdefault(known.name, known)
            options.setdefault(known.name, {}).setdefault(help_of(known), []).append(kind.name)  # type: ignore[attr-defined]
    for name, helps in options.items():
        said = [f"{text}, of {', '.join(paths)}" if len(helps) > 1 else text for text, paths in helps.items()]
        _add(parser, first[name], "; ".join(said))


def _add(parser: argparse.ArgumentParser, known: Parameter, help: str) -> None:
    choices = f"; one of {', '.join(known.choices)}" if known.choices is not None else ""
    parser.add_argument(option_name(known.name), metavar=known.name.upper(), help=help + choices)


def given(options: argparse.Namespace, kind: type) -> dict[str, str]:
    """The parameters of a dataclass that the command line gives, as text."""
    found = {name: getattr(options, name, None) for name in parameters_of(kind)}
    return {name: text for name, text in found.items() if text is not None}


def add_engine_options(parser: argparse.ArgumentParser) -> None:
    """--engine and --threads."""
    engines = tuple(ENGINES)
    parser.add_argument("--engine", choices=engines, default="yade", help="what moves the grains (default: yade)")
    parser.add_argument("--threads", type=threads, default=1, help="threads of the engine (default: 1)")


def add_settings_option(parser: argparse.ArgumentParser) -> None:
    """--settings, of labkit.dem.settings."""
    parser.add_argument(
        "--settings",
        choices=SETTINGS,
        help="how fast and how accurate, see results/speed_error: size "
        "of a specimen, rate of a run, time step of both (default: standard)",
    )


def positive_int(text: str) -> int:
    """A whole number from 1."""
    value = int(text)
    if value < 1:
        raise ValueError(text)
    return value


def threads(text: str) -> int:
    """A number of threads that this computer can bear."""
    value, most = positive_int(text), 4 * (os.cpu_count() or 1)
    if value > most:
        raise argparse.ArgumentTypeError(f"{value} threads are too many for this computer: give at most {most}")
    return value


def parse_in_yade(parser: Parser) -> argparse.Namespace:
    """The options of a script inside YADE: of a yade-batch table where there is one, else of the command line.

    A column of the table is the name of an option with `_` for `-`; strings stand in quotes.
    """
    if not os.environ.get("YADE_BATCH"):
        return parser.parse_args(sys.argv[1:])
    from yade import utils

    table, _, line = os.environ["YADE_BATCH"].rpartition(":")
    row = utils.TableParamReader(table).paramDict()[int(line)]
    known = {action.dest for action in parser._actions} - {"help"}
    columns = {name: text for name, text in row.items() if name != "description" and not name.startswith("!")}
    unknown = sorted(set(columns) - known)
    if unknown:
        raise InputError(f"{table} has a column {unknown[0]!r}: use {', '.join(sorted(known))}")
    positional = [action.dest for action in parser._actions if not action.option_strings]
    values = {name: text.strip("'\"") for name, text in columns.items() if text != "*"}
    argv = [values.pop(name) for name in positional if name in values]
    for name, text in values.items():
        argv += [f"{option_name(name)}={text}"]
    return parser.parse_args(argv)


def require(value: Any, field: str, instead: str | None = None) -> Any:
    """Raises InputError if something without a default was not given."""
    if value is None:
        raise InputError(f"is missing: give it{' ' * bool(instead)}{instead or ''} (see --help)", field=field)
    return value
