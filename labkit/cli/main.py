"""Reads a command line, runs its command, and says in one line what went wrong."""

from __future__ import annotations

import importlib
import os
import sys

import labkit
from labkit import extensions
from labkit.cli.arguments import Parser, named
from labkit.cli.registry import COMMANDS
from labkit.errors import InputError, Interrupted, PhysicsError, exit_code, fail, sentence

MODULES = ("simulate", "look", "model", "bench", "campaign", "demo")


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


def call(argv: list[str]) -> int:
    """Runs a command and returns its exit code. Raises InputError, PhysicsError or Interrupted where it gives up."""
    os.environ.setdefault("MPLBACKEND", "Agg")  # commands draw into files
    for name in MODULES:
        importlib.import_module(f"labkit.cli.{name}")
    for file in files_to_use(argv):
        extensions.use(file)
    options = parser_for(argv).parse_args(argv)
    return COMMANDS[options.command].execute(options, argv) or 0


def files_to_use(argv: list[str]) -> list[str]:
    """What the command line names with --use: the options of a command may depend on it."""
    after = [value for option, value in zip(argv, argv[1:]) if option == "--use"]
    return after + [word.removeprefix("--use=") for word in argv if word.startswith("--use=")]


def parser_for(argv: list[str]) -> Parser:
    """The parser, with the options of the command that this line asks for; of all others only the names."""
    parser = Parser(prog="labkit", description="A virtual laboratory for granular soil.")
    parser.add_argument("--version", action="version", version=f"labkit {labkit.__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, dest="command")
    for command in COMMANDS.values():
        one = commands.add_parser(command.name, help=command.help, description=f"{command.help}.")
        if argv[:1] == [command.name]:
            command.options(one)
            one.add_argument("--use", action="append", metavar="FILE", help="Python file of your own that registers "
                             "paths, contact laws, statistics, engines or figures")  # fmt: skip
    return parser
