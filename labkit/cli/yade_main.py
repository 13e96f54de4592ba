"""The frame of the scripts in yade_scripts: options, progress, exit code."""

from __future__ import annotations

import shlex
import signal
import sys

from labkit.cli.arguments import Parser, parse_in_yade
from labkit.errors import InputError, Interrupted, PhysicsError, fail
from labkit.io.progress import reporter


def main(name, add_options, command):
    """Runs `command(options, progress, history)` inside YADE and exits with labkit's codes."""
    parser = Parser(prog=f"yade -n -x {sys.argv[0]}")
    add_options(parser)
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # YADE would ignore it; a run catches it for its checkpoint
    try:
        options = parse_in_yade(parser)
        command(options, reporter(name), "yade -n -x " + shlex.join(sys.argv))
    except InputError as error:
        sys.exit(fail(error, 2))
    except PhysicsError as error:
        sys.exit(fail(error, 1))
    except Interrupted as error:
        sys.exit(fail(error, error.code))
    except OSError as error:
        sys.exit(fail(f"{error.filename or 'a file'}: {error.strerror or error}", 1))
    sys.exit(0)
