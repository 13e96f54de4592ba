"""The command line: `labkit COMMAND`.

registry      lists the commands, and has the decorator that makes a function a command
dispatch      parses a command line, calls the function of the command, reports errors
arguments     makes options from the signature of a function and from the table of parameters
parser        the parser of command lines and the layout of the help
outputs       names output files by default, checks them, writes figures and tables
simulate      specimen, consolidate, bond, run
verify        verify, critical, info
figure        figure, grading
model         model, calibrate
completion    completion
demo          demo

The other commands belong to plug-ins.
"""

import os
import signal
from collections.abc import Callable

from labkit.cli.dispatch import main
from labkit.process.interruption import interrupt_once

__all__ = ["main", "program"]


def program(run: Callable[[], int] = main) -> int:
    """Run the command line of this process, or another main function of labkit; returns the exit code."""
    os.environ["MPLBACKEND"] = "Agg"  # commands draw to files, without a display
    # HDF5 refuses to open a file that it cannot lock. labkit needs no lock: a file appears only when it is complete.
    os.environ.setdefault("HDF5_USE_FILE_LOCKING", "FALSE")
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not of a background job, which ignores it
        signal.signal(signal.SIGINT, interrupt_once)
    return run()
