"""One MPI rank of a task on the engine lammps: `mpiexec -n N python -m labkit.cli.lammps_main JOB`.

Rank 0 carries out the task, the others follow it. Errors are reported to the parent process, and the exit status is
zero, because mpiexec would comment on any other.
"""

from __future__ import annotations

import os
import signal
import sys
import traceback

from mpi4py import MPI

from labkit.cli.yade_main import do_task
from labkit.engines.lammps.engine import LammpsEngine, dismiss, domain_of, follow
from labkit.engines.lammps.process import number_file


def main(job: str) -> int:
    """Carry out the task in a file, or follow rank 0."""
    if MPI.COMM_WORLD.rank:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # rank 0 decides when to stop
            signal.signal(number, signal.SIG_IGN)
        follow(MPI.COMM_WORLD)
        return 0
    LammpsEngine.on_rank = True
    domain_of(MPI.COMM_WORLD)
    number_file(job).write_text(str(os.getpid()))
    try:
        do_task(job)
    except SystemExit:
        dismiss(MPI.COMM_WORLD)
    except BaseException:  # not one of labkit's errors: the other ranks would wait for ever
        traceback.print_exc()
        sys.stderr.flush()
        MPI.COMM_WORLD.Abort(1)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
