"""Common entry point of the scripts in yade_scripts: options, progress, exit code."""

from __future__ import annotations

import argparse
import json
import shlex
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from labkit.cli.arguments import parse_in_yade
from labkit.cli.parser import Parser, named
from labkit.engines.tasks import done_file, execute, from_job
from labkit.errors import InputError, Interrupted, PhysicsError, exit_code, fail, sentence
from labkit.extensions import blamed
from labkit.io.progress import ERROR, reporter


def main(
    add_options: Callable[[argparse.ArgumentParser], None], command: Callable[[argparse.Namespace, str], None]
) -> NoReturn:
    """Runs `command(options, history)` inside YADE and exits with labkit's codes."""
    parser = Parser(prog=f"yade -n -x {sys.argv[0]}")
    add_options(parser)
    _finish(lambda: command(parse_in_yade(parser), "yade -n -x " + shlex.join(sys.argv)))


def do_task(file: str) -> NoReturn:
    """Carries out the task described in a file (labkit.engines.tasks); for labkit's own child process."""

    def work() -> None:
        task = from_job(json.loads(Path(file).read_text()))
        execute(task, reporter(task.kind))
        done_file(file).touch()

    _finish(work, report=_report)


def _finish(work: Callable[[], object], report: Callable[[BaseException], None] | None = None) -> NoReturn:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # YADE ignores it otherwise; a run catches it to write its checkpoint
    try:
        work()
    except Exception as error:
        place = blamed(error)
        if place is not None and not isinstance(error, (InputError, PhysicsError, Interrupted, OSError)):
            error = InputError(place)
        if not isinstance(error, (InputError, PhysicsError, Interrupted, OSError)):
            raise
        if report is not None:
            report(error)
            sys.exit(exit_code(error))
        sys.exit(fail(sentence(error, named), exit_code(error)))
    sys.exit(0)


def _report(error: BaseException) -> None:
    """Writes an error for the parent process, as JSON values."""
    known: dict[str, Any] = {"kind": type(error).__name__, "said": sentence(error), "code": exit_code(error)}
    if isinstance(error, InputError):
        known |= {"said": error.problem, "field": error.field, "allowed": error.allowed, "quoted": error.quoted}
        known |= {"value": error.value if isinstance(error.value, (int, float, str)) else None}
    print(ERROR + json.dumps(known), file=sys.stderr, flush=True)
