"""Reads a command line, runs its command, and says in one line what went wrong."""

from __future__ import annotations

import itertools
import os
import sys

import labkit
from labkit import extensions
from labkit.cli.parser import Parser, named
from labkit.cli.registry import Command, find, helps
from labkit.errors import InputError, Interrupted, PhysicsError, exit_code, fail, sentence


def main(argv: list[str] | None = None) -> int:
    """Runs a command; returns 0 done, 1 the physics or a check failed, 2 bad input, 128 + the number of a signal."""
    argv = sys.argv[1:] if argv is None else argv
    try:
        return call(argv)
    except (InputError, PhysicsError, Interrupted) as error:
        return fail(sentence(error, named), exit_code(error))
    except BrokenPipeError:  # whoever read the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        return fail(sentence(error), 1)
    except KeyboardInterrupt:
        return fail("interrupted", 130)
    except Exception as error:  # of a path, law, statistic, engine or figure of the user's own
        said = extensions.blamed(error)
        if said is None:
            raise
        return fail(said, 2)


def call(argv: list[str]) -> int:
    """Runs a command and returns its exit code. Raises InputError, PhysicsError or Interrupted where it gives up."""
    os.environ.setdefault("MPLBACKEND", "Agg")  # commands draw into files
    for file in files_to_use(argv):
        extensions.use(file)
    command = find(argv[0]) if argv else None
    options, unknown = parser_for(command).parse_known_args(argv)
    if unknown:
        raise InputError(f"{unknown[0]} is not an option of {_told(command)}")
    if command is None:  # --help and --version have ended, and what is unknown was refused
        raise InputError("a command is missing: give one (see labkit --help)")
    return command.execute(options, argv) or 0


def files_to_use(argv: list[str]) -> list[str]:
    """What the command line names with --use: the options of a command may depend on it."""
    after = [value for option, value in itertools.pairwise(argv) if option == "--use"]
    return after + [word.removeprefix("--use=") for word in argv if word.startswith("--use=")]


def parser_for(command: Command | None) -> Parser:
    """The parser, with the options of this command; of all others it knows the names."""
    parser = Parser(prog="labkit", description="A virtual laboratory for granular soil.")
    parser.add_argument("--version", action="version", version=f"labkit {labkit.__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, said in helps().items():
        one = commands.add_parser(name, help=said, description=f"{said[0].upper()}{said[1:]}.")
        if command is not None and name == command.name:
            command.options(one)
            one.add_argument(
                "--use",
                action="append",
                metavar="FILE",
                help="Python file of your own that registers paths, contact laws, statistics, engines or figures",
            )
    return parser


def _told(command: Command | None) -> str:
    name = "labkit" if command is None else f"labkit {command.name}"
    return f"{name} (see {name} --help)"
