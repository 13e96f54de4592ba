"""Command-line options, built from the parameter table; the same for `labkit`, `yade -n -x` and yade-batch."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Collection, Iterable
from typing import Any

from labkit.cli.parser import Options, Parser
from labkit.dem.engine import PRECISIONS
from labkit.dem.paths import Path
from labkit.dem.settings import SETTINGS
from labkit.engines import ENGINES, processors
from labkit.errors import InputError, instead_of, option_name
from labkit.extensions import Registry
from labkit.parameters import Parameter, help_of, parameters_of


def add_parameters(parser: Options, kind: type, leave_out: Iterable[str] = (), unset: bool = False) -> None:
    """Adds an option for every parameter of a dataclass; its value is text, which `given` collects.

    unset: True if the defaults are not those of the class but are determined at run time, so that the help omits them.
    """
    for known in parameters_of(kind).values():
        if known.option and known.name not in leave_out:
            _add(parser, known, help_of(known, None if unset else known.default))


def add_path_parameters(
    parser: Options,
    kinds: Iterable[type[Path]],
    leave_out: Iterable[str] = (),
    shown: Collection[type[Path]] | None = None,
) -> None:
    """Adds an option for every parameter of these paths; its help gives the meaning for each path.

    shown: the paths whose parameters appear in the help (default: all).
    """
    helps: dict[str, dict[str, list[str]]] = {}
    first: dict[str, Parameter] = {}
    for kind in kinds:
        for known in parameters_of(kind).values():
            if known.name in leave_out:
                continue
            first.setdefault(known.name, known)
            meanings = helps.setdefault(known.name, {})
            if shown is None or kind in shown:
                meanings.setdefault(help_of(known), []).append(kind.name)
    for name, meanings in helps.items():
        several = len(meanings) > 1
        texts = [f"{', '.join(paths)}: {text}" if several else text for text, paths in meanings.items()]
        _add(parser, first[name], "; ".join(texts) if texts else argparse.SUPPRESS)


def _add(parser: Options, known: Parameter, help: str) -> None:
    choices = f"; one of {', '.join(known.choices)}" if known.choices is not None else ""
    help = help if help == argparse.SUPPRESS else help + choices
    parser.add_argument(option_name(known.name), metavar=known.name.upper(), help=help)


def given(options: argparse.Namespace, kind: type) -> dict[str, Any]:
    """Parameters of a dataclass that are given on the command line, as text."""
    values = {name: getattr(options, name, None) for name in parameters_of(kind)}
    return {name: text for name, text in values.items() if text is not None}


def add_engine_options(parser: Options) -> None:
    """Adds --engine, --threads, --ranks and --precision."""
    engine = f"simulation engine, one of {', '.join(ENGINES)} (default: yade)"
    parser.add_argument("--engine", type=one_of(ENGINES), default="yade", help=engine)
    parser.add_argument("--threads", type=threads, default=1, metavar="N", help="number of threads (default: 1)")
    ranks = "number of MPI ranks of the engine lammps, instead of threads (default: 1)"
    parser.add_argument("--ranks", type=positive_int, metavar="N", help=ranks)
    parser.add_argument(
        "--precision",
        type=one_of(PRECISIONS),
        default="double",
        help="double, or mixed on the engines fused and cuda: faster, with half of the numbers in single precision "
        "(default: double)",
    )


def computation(options: argparse.Namespace) -> dict[str, Any]:
    """The fields of a Task that add_engine_options defines."""
    count = processors(options.engine, options.threads, options.ranks)
    return {"engine": options.engine, "threads": count, "precision": options.precision}


def add_settings_option(parser: Options) -> None:
    """Adds --settings, a choice from labkit.dem.settings."""
    parser.add_argument(
        "--settings",
        type=one_of(SETTINGS),
        help=f"trade-off between speed and accuracy, one of {', '.join(SETTINGS)}: chooses the size of a specimen, the "
        "rate of a run and the time step of both (default: standard)",
    )


def one_of(choices: Collection[str]) -> Callable[[str], str]:
    """Type of an option that accepts these values; for a registry, the message mentions --use."""

    def read(text: str) -> str:
        if text not in choices:
            allowed = choices.instead_of(text) if isinstance(choices, Registry) else instead_of(choices, text)
            raise argparse.ArgumentTypeError(f"{text!r} is unknown: give {allowed}")
        return text

    return read


def positive_int(text: str) -> int:
    """A positive integer."""
    if not (text.isascii() and text.isdecimal() and len(text) <= 18 and int(text) >= 1):
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is not a whole number above 0")
    return int(text)


def fraction(text: str) -> float:
    """A number above 0 and at most 1."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0 and at most 1")
    return value


def threads(text: str) -> int:
    """A number of threads that this computer can support."""
    value, most = positive_int(text), 4 * (os.cpu_count() or 1)
    if value > most:
        raise argparse.ArgumentTypeError(f"{value} threads are too many for this computer: give at most {most}")
    return value


def parse_in_yade(parser: Parser) -> argparse.Namespace:
    """Options of a script inside YADE, from a row of the yade-batch table if there is one, else from the command line.

    A column of the table has the name of an option with `_` for `-`; strings are quoted.
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
        raise InputError(f"{table} has an unknown column {unknown[0]!r}: use {', '.join(sorted(known))}")
    positional = [action.dest for action in parser._actions if not action.option_strings]
    values = {name: text.strip("'\"") for name, text in columns.items() if text != "*"}
    argv = [values.pop(name) for name in positional if name in values]
    for name, text in values.items():
        argv += [f"{option_name(name)}={text}"]
    return parser.parse_args(argv)


def require(value: Any, field: str, example: str | None = None) -> Any:
    """Returns the value. Raises InputError if it was not given. example: what to give."""
    if value is None:
        raise InputError(f"is missing: give {example or 'it'} (see --help)", field=field)
    return value
