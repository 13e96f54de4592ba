"""Starts a task on several ranks with mpiexec, and says how to install LAMMPS."""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import sys
from pathlib import Path

from labkit.dem.engine import Progress
from labkit.engines.child import Program, run_child
from labkit.errors import InputError
from labkit.io.extras import install_command
from labkit.io.progress import PIPE

LAUNCHER = "LABKIT_MPIEXEC"  # environment variable: the command that starts MPI programs, e.g. `srun`
ROOT = Path(__file__).resolve().parents[3]


def require_lammps() -> None:
    """Raise InputError with the installation command if LAMMPS or MPI is missing."""
    missing = [name for name in ("lammps", "mpi4py") if importlib.util.find_spec(name) is None]
    if missing:
        raise InputError(
            f"LAMMPS is not installed (no Python module {missing[0]}): install it with {install_command('lammps')}"
        )


def launcher() -> list[str]:
    """The command that starts MPI programs. Raises InputError if there is none."""
    if os.environ.get(LAUNCHER):
        return shlex.split(os.environ[LAUNCHER])
    beside = Path(sys.executable).parent / "mpiexec"  # the one of the MPI library that pip installed
    program = str(beside) if beside.exists() else shutil.which("mpiexec")
    if not program:
        raise InputError(
            f"mpiexec is not on the PATH: install it with {install_command('lammps')}, or name the command of the "
            f"cluster in {LAUNCHER}"
        )
    return [program]


def run_ranks(job: str, ranks: int, progress: Progress) -> None:
    """Carry out the task in a file on `ranks` ranks. Raises InputError, PhysicsError or Interrupted."""
    require_lammps()
    python = [sys.executable, "-m", "labkit.cli.lammps_main", job]
    path = os.pathsep.join(one for one in (str(ROOT), os.environ.get("PYTHONPATH", "")) if one)
    environment = {**os.environ, PIPE: "1", "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    run_child(
        [*launcher(), "-n", str(ranks), *python], environment, progress, Program("LAMMPS", number_file=number_file(job))
    )


def number_file(job: str) -> Path:
    """File in which rank 0 writes its process number."""
    return Path(f"{job}.pid")
