"""Finds YADE and runs scripts in YADE."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from labkit.errors import InputError, PhysicsError

PACKAGE = Path(__file__).resolve().parents[1]
PROGRAMS = ("yade", "yadedaily")


def yade_program() -> str | None:
    """Return the path of the yade program, or None if YADE is not installed.

    labkit searches the folders in $PATH (which include an active conda environment), then the folder of the Python
    interpreter, then $CONDA_PREFIX/bin (for labkit in a conda environment that is not active). `yadedaily` is the
    program in YADE's own Debian packages.
    """
    own = [str(Path(sys.executable).parent)]
    conda = [str(Path(os.environ["CONDA_PREFIX"]) / "bin")] if os.environ.get("CONDA_PREFIX") else []
    found = (shutil.which(name, path=place) for place in (None, *own, *conda) for name in PROGRAMS)
    return next(filter(None, found), None)


def find_yade() -> str:
    """Return the path of the yade program. Raises InputError with installation instructions if it is missing."""
    program = yade_program()
    if program is None:
        raise InputError(
            "YADE is not installed: on Debian or Ubuntu install it with `./lab` or `sudo apt-get install yade`; "
            "elsewhere see https://yade-dem.org/doc/installation.html"
        )
    return program


def find_script(name: str) -> Path:
    """Return the path of a script in yade_scripts, next to the package in a clone and inside it when installed."""
    for folder in (PACKAGE.parent / "yade_scripts", PACKAGE / "yade_scripts"):
        if (folder / name).is_file():
            return folder / name
    raise InputError(f"yade_scripts/{name} is missing from this installation: reinstall labkit")


def yade_environment() -> dict[str, str]:
    """Return the environment of a YADE process, without the variables of a virtual environment.

    Waiting OpenMP threads sleep, because spinning threads halve YADE's speed on a computer busy with other work. Python
    does not look for modules next to the script or in the current folder.
    """
    environment = {"OMP_WAIT_POLICY": "PASSIVE", **os.environ, "PYTHONSAFEPATH": "1", "HOME": _home()}
    for unwanted in ("PYTHONPATH", "PYTHONHOME", "IPYTHONDIR", "VIRTUAL_ENV", "DISPLAY"):
        environment.pop(unwanted, None)
    return environment


def _home() -> str:
    """Return a home folder with which YADE starts: the user's, or the null device, in which there is no file.

    YADE needs a home folder. If it looks writable and is not, such as /proc, YADE's IPython tries forever.
    """
    home = os.environ.get("HOME", os.devnull)
    with contextlib.suppress(OSError):
        if os.access(home, os.W_OK):
            os.rmdir(tempfile.mkdtemp(prefix=".labkit-", dir=home))
        return home
    return os.devnull


def yade_command(script: Path, arguments: Sequence[str], threads: int = 1) -> list[str]:
    """Return the command that runs a script in YADE without open ports. Raises InputError if YADE is missing."""
    program = find_yade()
    return [*_without_servers(program), program, "-n", "-x", f"-j{threads}", str(script), *arguments]


def _without_servers(program: str) -> list[str]:
    """Return the words before YADE's main program on the command line: its Python and yade_scripts/start_yade.py.

    The list is empty if the program is not written in Python, such as a script on a cluster that starts YADE; server.py
    then closes the ports.
    """
    with open(program, "rb") as file:
        first = file.readline(1000).decode(errors="replace")
    return [*shlex.split(first[2:]), str(find_script("start_yade.py"))] if re.match(r"#!.*python", first) else []


def run_script(script: Path, arguments: Sequence[str], threads: int = 1) -> str:
    """Run a script in YADE and return its output. Raises PhysicsError if it fails."""
    command = yade_command(script, arguments, threads)
    done = subprocess.run(command, env=yade_environment(), stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if done.returncode:
        reason = done.stderr.strip()[-300:]
        raise PhysicsError(f"{script.name} in YADE ended with exit status {done.returncode}: {reason}")
    return done.stdout
