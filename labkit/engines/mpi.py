"""MPI on this computer: its library, its launcher, and the memory that it needs."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from labkit.errors import InputError
from labkit.process.extras import install_command, require_library

LAUNCHER = "LABKIT_MPIEXEC"  # environment variable with the command that starts MPI programs, e.g. `srun`
LOCAL = "mpiexec.gforker"  # MPICH's launcher for ranks on one computer, which opens no port
MEMORY = {"UCX_TLS": "shm,self"}  # ranks on one computer then communicate through memory, without open ports
SHARED = Path("/dev/shm")  # where MPI makes the memory that ranks on one computer share (Linux)
LEAST, EACH = 5, 2  # MB of it that MPI needs at least, and for each rank


def mpi_library() -> Any:
    """Return mpi4py's module MPI; the first call starts MPI. Raises InputError without MPI or its memory."""
    if not os.environ.get(LAUNCHER):
        os.environ.setdefault("UCX_TLS", MEMORY["UCX_TLS"])
    mpi4py = require_library("mpi4py", "MPI ranks", "lammps")
    mpi4py.rc.finalize = False  # MPI would wait for ranks that were killed
    if "mpi4py.MPI" not in sys.modules:  # MPICH waits for ever if a killed process of this number left its memory
        require_shared_memory(1)
        (SHARED / f"mpich_shm_{os.getpid():x}_0").unlink(missing_ok=True)
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"MPI cannot be loaded ({reason}): install it with {install_command('lammps')}") from None
    return MPI


def require_shared_memory(ranks: int) -> None:
    """Raise InputError if MPI could not make the memory that `ranks` share: it would end this process itself."""
    size = max(LEAST, EACH * ranks)
    if not SHARED.is_dir() or not hasattr(os, "posix_fallocate"):  # another system
        return
    try:
        with tempfile.TemporaryFile(dir=SHARED) as file:
            os.posix_fallocate(file.fileno(), 0, size * 1_000_000)
    except OSError as error:
        raise InputError(
            f"MPI needs {size} MB of memory in {SHARED} ({os.strerror(error.errno or 0)}): delete what killed programs "
            f"left there, or give a container more, e.g. `docker run --shm-size 1g`"
        ) from None


def launcher() -> list[str]:
    """Return the command that starts MPI programs. Raises InputError if none is found."""
    if os.environ.get(LAUNCHER):
        try:
            return shlex.split(os.environ[LAUNCHER])
        except ValueError:
            problem = f"{LAUNCHER}={os.environ[LAUNCHER]} has a quote without its partner"
            raise InputError(f"{problem}: name the command of the cluster") from None
    beside = Path(sys.executable).parent  # the launchers of the MPI library that pip installed
    program = shutil.which(LOCAL, path=beside) or shutil.which("mpiexec", path=beside) or shutil.which("mpiexec")
    if not program:
        raise InputError(
            f"mpiexec is not on the PATH: install it with {install_command('lammps')}, or name the command of the "
            f"cluster in {LAUNCHER}"
        )
    return [program]
