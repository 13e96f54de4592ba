"""Writes files while the n-th file call fails, for many n; started by test_failing_disk.py with faults.c preloaded.

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
from labkit.errors import PhysicsError
from labkit.files.atomic import write_text
from labkit.files.netcdf import extend_netcdf
from labkit.grains.state_file import read_state, write_state
from labkit.model import Model, drive, isotropic_state
from labkit.model.run_file import write_result

DISK = ctypes.CDLL(None)
BEFORE = b"what was there before"
AFTER = ("fsync",)  # calls after the file is closed
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
        "run": grow,
    }
    run = Path(folder) / "before.nc"
    write_result(run, result)
    content = {"run": run.read_bytes()}
    print(json.dumps({
        f"{name}, {kind}": fail_at_each(write, Path(folder), name, number, content.get(name, BEFORE))
        for name, write in writers.items() for kind, number in KINDS.items()
    }))  # fmt: skip


def grow(file: Path) -> None:
    """Add records to a run file, as the recorder does."""
    with extend_netcdf(file, 100_000) as dataset:
        first = len(dataset.dimensions["time"])
        for name in ("axial_strain", "stress", "cell"):
            dataset[name][first : first + 300] = dataset[name][-1]


def fail_at_each(write, folder: Path, name: str, number: int, before: bytes) -> dict[str, object]:
    """Let some file calls fail once, each in a separate process, because a command that fails ends."""
    file, problems, crashes = folder / f"{name}.nc", [], 0
    file.write_bytes(before)
    calls = in_fork(lambda: attempt(write, file, 10**6, number) and DISK.calls())
    last = list(range(max(1, calls - 3), calls + 1))
    chosen = sorted({*range(1, calls, max(1, calls // 5)), *last}) if number == errno.EIO else last
    for n in chosen:
        file.unlink(missing_ok=True)
        file.write_bytes(before)
        code = in_fork(lambda n=n: attempt(write, file, n, number))
        left = [other for other in folder.iterdir() if other != file and other.suffix == ".tmp"]
        if code == DONE and read_back(name, file):
            continue  # a failed call without consequence
        if code < 0 and number == errno.EIO and n == calls - len(AFTER):
            crashes += 1
        elif code < 0:
            problems.append(f"call {n} of {calls}: signal {-code}")
        elif code != REPORTED:
            problems.append(f"call {n} of {calls}: " + ("another error" if code == OTHER else f"exit code {code}"))
        elif left:
            problems.append(f"call {n} of {calls}: left {left}")
        if code != DONE and file.read_bytes() != before:
            problems.append(f"call {n} of {calls}: the file that was there is lost")
        for other in left:
            other.unlink()
    return {"failures": len(chosen), "crashes": crashes, "problems": problems}


def in_fork(do) -> int:
    """The exit code, or minus the signal, of a forked process that does something."""
    child = os.fork()
    if child == 0:
        os._exit(do())
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def attempt(write, file: Path, n: int, number: int) -> int:
    """Write a file while its n-th call fails; returns what happened, as an exit code."""
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


if __name__ == "__main__":
    main(*sys.argv[1:])
