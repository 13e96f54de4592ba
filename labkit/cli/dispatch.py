"""Parses a command line, runs its command and reports an error in one line."""

from __future__ import annotations

import errno
import itertools
import os
import sys
from collections.abc import Mapping

import labkit
from labkit import extensions
from labkit.cli.descriptions import description_of, examples_of
from labkit.cli.parser import Parser, named
from labkit.cli.registry import Command, find, helps
from labkit.errors import InputError, Interrupted, PhysicsError, exit_code, fail, sentence
from labkit.io import streams
from labkit.io.interruption import ended_by_signals
from labkit.io.netcdf import TRUST

COMMANDS_EPILOG = """\
`labkit COMMAND --help` explains a command and gives an example.

exit codes: 0 done; 1 the simulation or a check failed; 2 invalid input; 130 or 143 stopped by a signal"""


def main(argv: list[str] | None = None) -> int:
    """Runs a command line and reports an error in one line.

    Returns 0 for success, 1 if the simulation or a check failed, 2 for invalid input, 128 + the number of a signal.
    """
    argv = sys.argv[1:] if argv is None else argv
    streams.prepare()
    code = _reported(argv)
    full = streams.flushed()
    return code if full is None else fail(f"standard output: {full.strerror}", code or 1)


def _reported(argv: list[str]) -> int:
    """Runs a command line and reports its error; returns its exit code."""
    try:
        with ended_by_signals():
            return call(argv)
    except (InputError, PhysicsError, Interrupted) as error:
        return fail(sentence(error, named), exit_code(error))
    except BrokenPipeError:  # the reader of the output closed it, as `head` does, when the results were written
        streams.silence()
        return 0
    except OSError as error:
        if error.filename is None and error.errno in (errno.ENOSPC, errno.EIO, errno.EBADF):
            streams.silence()
            return fail(f"standard output: {error.strerror}", 1)
        return fail(sentence(error), 1)
    except MemoryError as error:
        return fail(f"there is not enough memory ({str(error) or 'no details are known'}): use fewer grains or runs", 1)
    except RecursionError:
        return fail("a value is nested too deep: give a file that labkit wrote", 2)
    except KeyboardInterrupt:
        return fail("interrupted", 130)
    except Exception as error:  # from a user-defined path, law, statistic, engine or figure
        blamed = extensions.blamed(error)
        if blamed is None:
            raise
        return fail(blamed, 2)


def call(argv: list[str]) -> int:
    """Runs a command line and returns its exit code. Raises InputError, PhysicsError or Interrupted on failure."""
    os.environ["MPLBACKEND"] = "Agg"  # commands draw into files
    require_environment(os.environ)
    for file in files_to_use(argv):
        extensions.use(file)
    command = find(argv[0]) if argv else None
    options = parser_for(command, argv).parse_args(argv)
    if command is None:  # --help, --version and unknown commands were handled by the parser
        raise InputError("a command is missing: give one (see labkit --help)")
    if options.trust:
        os.environ[TRUST] = "1"  # for the processes of this command too
    return command.execute(options, argv) or 0


def require_environment(variables: Mapping[str, str]) -> None:
    """Raises InputError for environment variables with which Numba cannot start."""
    threads, layer = variables.get("NUMBA_NUM_THREADS"), variables.get("NUMBA_THREADING_LAYER")
    if threads is not None and not (threads.isascii() and threads.isdecimal() and 1 <= int(threads[:9]) <= 4096):
        raise InputError(f"the environment variable NUMBA_NUM_THREADS is {threads!r}: give 1 to 4096, or unset it")
    if layer is not None and layer not in LAYERS:
        raise InputError(
            f"the environment variable NUMBA_THREADING_LAYER is {layer!r}: give {', '.join(LAYERS)}, or unset it"
        )


LAYERS = ("default", "safe", "forksafe", "threadsafe", "tbb", "omp", "workqueue")


def files_to_use(argv: list[str]) -> list[str]:
    """Files named with --use; they are loaded first, because the options of a command may depend on them."""
    separate = [value for option, value in itertools.pairwise(argv) if option == "--use"]
    return separate + [word.removeprefix("--use=") for word in argv if word.startswith("--use=")]


def parser_for(command: Command | None, argv: list[str]) -> Parser:
    """The parser with the options of this command; other commands are listed by name only."""
    parser = Parser(
        prog="labkit",
        description="A virtual laboratory for granular soil: makes specimens, tests them and analyses the results.",
        epilog=COMMANDS_EPILOG,
    )
    parser.add_argument("--version", action="version", version=f"labkit {labkit.__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, summary in helps().items():
        one: Parser = commands.add_parser(name, help=summary, description=description_of(name, summary))
        if command is not None and name == command.name:
            one.command_line = argv[1:]
            command.options(one)
            one.add_argument(
                "--use",
                action="append",
                metavar="FILE",
                help="Python file that registers paths, contact laws, statistics, engines or figures",
            )
            one.add_argument(
                "--trust",
                action="store_true",
                help="read files whose hashes show that they are damaged or changed, as far as possible",
            )
            one.epilog = "\n\n".join(text for text in (one.epilog, examples_of(name)) if text)
            one.shorten_usage()
    return parser
