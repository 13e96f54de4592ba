"""Parses a command line, calls the function of the command and reports an error in one line."""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
import shlex
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence

from labkit import extensions
from labkit.cli.parser import HELP, Parser, name_list, on_command_line, wrap
from labkit.cli.registry import Command, Function, find_command, summaries
from labkit.errors import InputError, PhysicsError, exit_code, fail, instead_of, notice, sentence
from labkit.parameters import Values
from labkit.plugins import missing
from labkit.process import streams
from labkit.process.interruption import end_on_signals
from labkit.text.foreign import noting_files
from labkit.version import __version__

DESCRIPTION = "A virtual laboratory for granular soil: makes specimens, tests them and analyses the results."
EPILOG = """\
`labkit COMMAND --help` explains a command and gives an example.

exit codes: 0 done; 1 the simulation or a check failed; 2 invalid input; 130 or 143 stopped by a signal"""
UNWRITABLE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)  # standard output is full or gone
LAYERS = ("default", "safe", "forksafe", "threadsafe", "tbb", "omp", "workqueue")  # Numba's threading layers


def main(argv: list[str] | None = None) -> int:
    """Run a command line and report an error in one line.

    Returns 0 for success, 1 if the simulation or a check failed, 2 for invalid input, and 128 plus the number of the
    signal if a signal stopped it.
    """
    words = sys.argv[1:] if argv is None else argv
    return report_errors(lambda: _call(words))


def report_errors(work: Callable[[], int]) -> int:
    """Call a function that returns an exit code, and report an error in one line; returns the exit code."""
    with _settings(), noting_files():
        code = _run_and_report(work)
        full = streams.flush_output()
        return code if full is None else fail(f"standard output: {full.strerror}", code or 1)


@contextlib.contextmanager
def _settings() -> Iterator[None]:
    """Apply the settings of a command, and restore the old settings afterwards: a user's program may call `main`."""
    environment, show = dict(os.environ), warnings.showwarning
    warnings.showwarning = lambda message, *_, **__: notice(message)
    try:
        with streams.usable_streams():
            yield
    finally:
        warnings.showwarning = show
        for name in os.environ.keys() - environment.keys():
            del os.environ[name]
        os.environ.update(environment)


def _run_and_report(work: Callable[[], int]) -> int:
    """Call a function that returns an exit code, and report an error; returns the exit code."""
    try:
        with end_on_signals():
            return work()
    except (InputError, PhysicsError, KeyboardInterrupt) as error:
        return fail(sentence(error, on_command_line), exit_code(error))
    except BrokenPipeError:  # the reader closed the output, as `head` does; the results are already written
        streams.silence(sys.stdout)
        return 0
    except OSError as error:
        if error.filename is None and error.errno in UNWRITABLE:
            streams.silence(sys.stdout)
            return fail(f"standard output: {error.strerror}", 1)
        return fail(sentence(error), 1)
    except MemoryError as error:
        return fail(f"there is not enough memory ({str(error) or 'no details are known'}): use fewer grains or runs", 1)
    except RecursionError:
        return fail("a value is nested too deep: give a file that labkit wrote", 2)
    except Exception as error:  # raised by a user-defined path, law, statistic, engine, figure or command
        blamed = extensions.blame(error)
        if blamed is None:
            raise
        return fail(blamed, 2)


def _call(argv: list[str]) -> int:
    """Run a command line and return its exit code. Raises InputError, PhysicsError or Interrupted on failure."""
    require_environment(os.environ)
    separate = [value for option, value in itertools.pairwise(argv) if option == "--use"]
    for file in separate + [word.removeprefix("--use=") for word in argv if word.startswith("--use=")]:
        extensions.use(file)  # first, because the options of a command may depend on it
    if not argv or argv[0].startswith("-"):
        parser = Parser("labkit", (), DESCRIPTION, "labkit [-h] [--version] COMMAND ...")
        parser.add_argument("--version", action="version", version=f"labkit {__version__}")
        parser.epilog = wrap(f"{name_list('command', summaries())}\n\n{EPILOG}")
        parser.read(argv)
        raise InputError("COMMAND is missing: give one (see labkit --help)")
    function, arguments = parse(argv)
    return function(**arguments) or 0


def parse(argv: Sequence[str]) -> tuple[Function, Values]:
    """Return the function that a command line calls, and its arguments. Raises InputError for an invalid line."""
    command = find_command(argv[0])
    if command is None:
        allowed = f"{instead_of(summaries(), argv[0])}{missing()}"
        raise InputError(f"COMMAND {argv[0]!r} is unknown: give {allowed} (see labkit --help)")
    from labkit.cli.arguments import Made

    options = parser_for(command, argv[1:]).read(argv[1:])
    options.command_line = shlex.join(["labkit", *argv])
    return command.function, Made(command.function).arguments(options)


def parser_for(command: Command, words: Sequence[str]) -> Parser:
    """Return the parser with the options of a command; the help depends on the words to be parsed."""
    from labkit.cli.arguments import Made

    parser = Parser(f"labkit {command.name}", words, command.description)
    Made(command.function).add(parser)
    use = "Python file that registers paths, contact laws, statistics, engines, figures or commands"
    parser.add_argument("--use", action="append", metavar="FILE", help=use)
    lists = command.epilog(list(words)) if command.epilog and HELP & set(words) else ""
    parser.epilog = wrap("\n\n".join(text for text in (lists, command.examples) if text))
    parser.shorten_usage()
    return parser


def require_environment(variables: Mapping[str, str]) -> None:
    """Raise InputError if an environment variable or the clock has a value with which Numba or Python cannot start."""
    try:
        time.time()
    except OverflowError:
        raise InputError("the clock of this computer is not between the years 1678 and 2262: set it") from None
    threads, layer = variables.get("NUMBA_NUM_THREADS"), variables.get("NUMBA_THREADING_LAYER")
    if threads is not None and not (threads.isascii() and threads.isdecimal() and 1 <= int(threads[:9]) <= 4096):
        raise InputError(f"the environment variable NUMBA_NUM_THREADS is {threads!r}: give 1 to 4096, or unset it")
    if layer is not None and layer not in LAYERS:
        allowed = ", ".join(LAYERS)
        raise InputError(f"the environment variable NUMBA_THREADING_LAYER is {layer!r}: give {allowed}, or unset it")
