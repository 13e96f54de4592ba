"""A run that is killed and goes on."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import netCDF4
import numpy as np

from analysis.hard_cases.checks import between, true
from analysis.hard_cases.laboratory import Judged, Laboratory
from labkit.errors import InputError, PhysicsError
from labkit.io import RECORD
from labkit.runs import Run

KILLS = 10  # attempts to kill a run before it ends


def restart_in_reversal(lab: Laboratory) -> Judged:
    """See the scene of this name; on the command line, as a kill is one of a process."""
    whole_file, file = lab.file("run"), lab.file("killed")
    _finish(_command(lab, whole_file))
    whole = _kept(lab, whole_file)
    turn = int(np.argmax(whole["axial_strain"].values))
    file.unlink(missing_ok=True)
    _kill_after(turn, file, _command(lab, file))
    saved = _length(file) - 1
    strain = float(whole["axial_strain"][saved])
    _finish(_command(lab, file))
    _kept(lab, file)
    first, second = (_records(name) for name in lab.runs)
    different = [name for name in RECORD if not np.array_equal(first[name], second[name], equal_nan=True)]
    return f"turned at record {turn}, killed with record {saved} saved, axial strain {strain:.3%}; then went on", [
        between("record at the kill: in the leg after the turn", saved, turn, 3 * turn),
        true("the same records to the last bit" + ", not so: " * bool(different) + ", ".join(different), not different),
    ]


def _command(lab, file):
    """The command line of the scene's run, which saves every record."""
    path = lab.loading()
    turns = ",".join(f"{x:g}" for x in path.reversals)
    given = {
        "rate": path.rate,
        "pressure": f"{path.pressure:g} Pa",
        "reversals": turns,
        "record-strain": f"{lab.scene.strain * lab.extent / 10:.4g}",
        "save-every": 1,
        "engine": lab.engine,
        "output": file,
    }
    options = [f"--{name}={value}" for name, value in given.items()]
    return [sys.executable, "-m", "labkit.cli", "run", path.name, str(lab.specimen_file()), *options]


def _finish(command):
    """Runs a command to its end. Raises PhysicsError if it fails."""
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise PhysicsError(f"exit status {done.returncode}: {done.stderr.strip()}")


def _kept(lab, file):
    """The run in a file, counted as one of the case's."""
    run = Run.open(file)
    lab.keep(file.name.removesuffix(".run.nc"), run.exceeded)
    return run.data


def _kill_after(record, file, command):
    """Starts a run and kills it once the file holds `record`. Raises InputError if it always ends before."""
    for _ in range(KILLS):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while process.poll() is None and _length(file) <= record:
            time.sleep(0.001)
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
            process.wait()
            return
        if process.returncode:
            raise InputError(f"the run that was to be killed ended with exit status {process.returncode}: {command}")
        file.unlink()
    raise InputError(f"the run ended before it could be killed, {KILLS} times: take more --grains")


def _length(file):
    if not file.exists():
        return 0
    with netCDF4.Dataset(file) as dataset:
        return len(dataset.dimensions["time"])


def _records(file):
    with netCDF4.Dataset(file) as dataset:
        return {name: dataset[name][...].filled() for name in RECORD}
