"""Starts YADE as a child process."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from labkit.dem.engine import Progress
from labkit.engines.child import Program, run_child
from labkit.errors import InputError
from labkit.io.progress import PIPE

PACKAGE = Path(__file__).resolve().parents[1]
PROGRAMS = ("yade", "yadedaily")
NOISE = ("Welcome to Yade", "Using python version", "TCP python prompt", "XMLRPC info", "Running script")


def yade_program() -> str | None:
    """Path of the yade program, or None if it is not installed.

    It is searched for on the search path (Debian, or a conda environment that is active), then next to Python and in
    $CONDA_PREFIX (a conda environment whose labkit was started without activation). `yadedaily` is the program of
    YADE's own Debian packages.
    """
    own = [str(Path(sys.executable).parent)]
    conda = [str(Path(os.environ["CONDA_PREFIX"]) / "bin")] if os.environ.get("CONDA_PREFIX") else []
    found = (shutil.which(name, path=place) for place in (None, *own, *conda) for name in PROGRAMS)
    return next(filter(None, found), None)


def find_yade() -> str:
    """Path of the yade program. Raises InputError with installation instructions if it is missing."""
    program = yade_program()
    if program is None:
        raise InputError(
            "YADE is not installed: on Debian or Ubuntu install it with `./lab` or `sudo apt-get install yade "
            "python3-netcdf4`; elsewhere see https://yade-dem.org/doc/installation.html"
        )
    return program


def find_script(name: str) -> Path:
    """Path of a script of yade_scripts, which is next to the package in a clone and inside the installed package."""
    for folder in (PACKAGE.parent / "yade_scripts", PACKAGE / "yade_scripts"):
        if (folder / name).is_file():
            return folder / name
    raise InputError(f"yade_scripts/{name} is missing from this installation: reinstall labkit")


def yade_environment() -> dict[str, str]:
    """Environment of a YADE process: labkit on the path, without variables of a virtual environment.

    Waiting OpenMP threads sleep: spinning threads halve YADE's speed on a computer that is busy with other work.
    """
    environment = {"OMP_WAIT_POLICY": "PASSIVE", **os.environ, "LABKIT_ROOT": str(PACKAGE.parent)}
    for unwanted in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "DISPLAY"):
        environment.pop(unwanted, None)
    return environment


def run_script(name: str, arguments: Sequence[str], threads: int, progress: Progress) -> None:
    """Run a script in YADE. Raises InputError, PhysicsError or Interrupted with the message of the child."""
    command = [find_yade(), "-n", "-x", f"-j{threads}", str(find_script(name)), *arguments]
    run_child(command, {**yade_environment(), PIPE: "1"}, progress, Program("YADE", NOISE))
