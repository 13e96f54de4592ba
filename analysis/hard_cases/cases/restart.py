"""A run that is killed and resumed."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import netCDF4
import numpy as np
import xarray as xr

from analysis.hard_cases.checks import between, true
from analysis.hard_cases.laboratory import Judged, Laboratory
from labkit.errors import InputError, PhysicsError
from labkit.files import RECORD
from labkit.paths import CyclicConstantMeanStress
from labkit.results import Run

KILLS = 10  # attempts to kill a run before it finishes


def restart_in_reversal(lab: Laboratory) -> Judged:
    """Runs the scene of the same name from the command line, because only a process can be killed."""
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
    return f"reversal at record {turn}, killed with record {saved} saved, axial strain {strain:.3%}; then resumed", [
        between("record at the kill, in the leg after the reversal", saved, turn, 3 * turn),
        true("the same records to the last bit" + ", except " * bool(different) + ", ".join(different), not different),
    ]


def _command(lab: Laboratory, file: Path) -> list[str]:
    """Command line of the scene's run, which saves every record."""
    path = lab.loading()
    assert isinstance(path, CyclicConstantMeanStress)
    turns = ",".join(f"{x:g}" for x in path.reversals)
    values = {
        "rate": path.rate,
        "pressure": f"{path.pressure:g} Pa",
        "reversals": turns,
        "record-strain": f"{lab.scene.strain * lab.extent / 10:.4g}",
        "save-every": 1,
        "engine": lab.device.name,
        "precision": lab.device.precision,
        "output": file,
    }
    options = [f"--{name}={value}" for name, value in values.items()]
    return [sys.executable, "-P", "-m", "labkit.cli", "run", path.name, str(lab.specimen_file()), *options]


def _finish(command: list[str]) -> None:
    """Runs a command to completion. Raises PhysicsError if it fails."""
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise PhysicsError(f"exit status {done.returncode}: {done.stderr.strip()}")


def _kept(lab: Laboratory, file: Path) -> xr.Dataset:
    """Adds the run in a file to the case; its dataset."""
    run = Run.open(file)
    lab.keep(file.name.removesuffix(".run.nc"), run.exceeded)
    return run.data


def _kill_after(record: int, file: Path, command: list[str]) -> None:
    """Starts a run and kills it once its file holds `record`. Raises InputError if it always finishes before."""
    for _ in range(KILLS):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while process.poll() is None and _length(file) <= record:
            time.sleep(0.01)
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
            process.wait()
            return
        if process.returncode:
            raise InputError(
                f"the run ended with exit status {process.returncode} before it could be killed: {command}"
            )
        file.unlink()
    raise InputError(f"the run finished before it could be killed {KILLS} times: increase --grains")


def _length(file: Path) -> int:
    if not file.exists():
        return 0
    with netCDF4.Dataset(file) as dataset:
        return len(dataset.dimensions["time"])


def _records(file: Path) -> dict[str, np.ndarray]:
    with netCDF4.Dataset(file) as dataset:
        return {name: dataset[name][...].filled() for name in RECORD}
