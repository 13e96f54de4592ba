"""The command line: `labkit COMMAND`.

registry      list of the commands; the decorator that makes a function a command
dispatch      parses a command line, calls its function, reports errors
arguments     options from the signature of a function and from the parameter table
parser        parser of command lines and its help
outputs       default names of output files, checks, figures and tables
simulate      specimen, consolidate, run, stratified
verify        verify, critical, info
figure        figure, grading, picture, watch
model         model, calibrate
campaign      campaign; job: one job of a campaign
others        one command each
"""

import os
from collections.abc import Callable

from labkit.cli.dispatch import main

__all__ = ["main", "program"]


def program(run: Callable[[], int] = main) -> int:
    """Run the command line of this process, or another function of a process of labkit; returns its exit code."""
    os.environ["MPLBACKEND"] = "Agg"  # commands draw into files
    # HDF5 refuses to open a file that it cannot lock. labkit's files need no such lock: they appear when complete.
    os.environ.setdefault("HDF5_USE_FILE_LOCKING", "FALSE")
    return run()
