"""The paper's tests at full size: from the run files of the campaign `paper.yaml` to results/paper.

`condense.py` writes reduced run files, small enough for a repository; everything else is derived from them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import xarray as xr

import labkit as lk
from labkit.errors import InputError


def runs(folder: str | Path) -> dict[str, xr.Dataset]:
    """Name -> run (labkit.open_run) of the reduced files in folder/runs. Raises InputError if there are none."""
    files = sorted((Path(folder) / "runs").glob("*.run.nc"))
    if not files:
        raise InputError(f"{folder}/runs contains no run files: write them with ./lab paper CAMPAIGN -o {folder}")
    return {file.name.removesuffix(".run.nc"): lk.open_run(file) for file in files}


def sources(runs: Mapping[str, xr.Dataset]) -> list[str]:
    """Files of the runs (name -> run); runs in memory have none."""
    return [run.encoding["source"] for run in runs.values() if "source" in run.encoding]
