"""Writes files while the n-th file call fails, for every n; started by test_failing_disk.py with faults.c preloaded.

Prints, for each kind of file and of failure, the number of failures, and what was wrong.
"""

from __future__ import annotations

import ctypes
import errno
import json
import os
import sys
import traceback
from pathlib import Path

import labkit as lk
from labkit.dem.state import read_state, write_state
from labkit.errors import PhysicsError
from labkit.io.atomic import write_text
from labkit.model import Model, drive, isotropic_state
from labkit.model.run_file import write_result

DISK = ctypes.CDLL(None)
BEFORE = b"what was there before"
NOT_REACHED, DONE, REPORTED, OTHER = 10, 11, 12, 13
KINDS = {"disk full": errno.ENOSPC, "input/output error": errno.EIO, "short write": 0}


def main(specimen: str, folder: str) -> None:
    """Write a text, a state file and a prediction of the model, with every failure."""
    state = read_state(specimen)
    model = Model()
    result = drive(model, lk.paths.ConstantVolume(strain=0.01), isotropic_state(model, 0.67, 4e5))
    writers = {
        "text": lambda file: write_text(file, "text\n" * 1000),
        "state": lambda file: write_state(file, state),
        "model": lambda file: write_result(file, result),
    }
    print(json.dumps({f"{name}, {kind}": fail_at_each(write, Path(folder), name, number)
                      for name, write in writers.items() for kind, number in KINDS.items()}))  # fmt: skip


def fail_at_each(write, folder: Path, name: str, number: int) -> dict[str, object]:
    """Let each file call fail once, each time in a process of its own, as a command that fails ends."""
    file, problems, failed = folder / f"{name}.nc", [], 0
    for n in range(1, 10_000):
        file.unlink(missing_ok=True)
        file.write_bytes(BEFORE)
        child = os.fork()
        if child == 0:
            os._exit(attempt(write, file, n, number))
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if code == NOT_REACHED:
            return {"failures": failed, "problems": problems, "left": leftovers(folder, file)}
        failed += 1
        if code == DONE and read_back(name, file):
            continue  # a failed call without consequence
        if code != REPORTED:
            problems.append(f"call {n}: " + ("another error" if code == OTHER else f"exit code {code}"))
        elif file.read_bytes() != BEFORE:
            problems.append(f"call {n}: the file that was there is lost")
    raise RuntimeError("the writer never succeeds")


def attempt(write, file: Path, n: int, number: int) -> int:
    """Write a file while its n-th call fails; what happened, as an exit code."""
    DISK.arm(n, number)
    try:
        write(file)
        return NOT_REACHED if DISK.calls() < n else DONE
    except (OSError, PhysicsError) as error:
        DISK.arm(-1, 0)
        if str(file) in str(error):
            return REPORTED
        print(f"does not name the file: {error!r}", file=sys.stderr)
    except Exception:
        traceback.print_exc()
    return OTHER


def read_back(name: str, file: Path) -> bool:
    """True if a file can be read and has its hashes."""
    try:
        if name == "text":
            return file.read_text() == "text\n" * 1000
        return (read_state if name == "state" else lk.open_run)(file) is not None
    except lk.InputError:
        return False


def leftovers(folder: Path, file: Path) -> list[str]:
    """Files other than the output."""
    return sorted(other.name for other in folder.iterdir() if other != file and other.suffix != ".nc")


if __name__ == "__main__":
    main(*sys.argv[1:])
