"""The paper's tests at full size: from the run files of their campaign, `paper.yaml`, to results/paper.

`condense.py` makes thin run files that a repository can hold; everything else is made from these alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import xarray as xr

import labkit as lk
from labkit.errors import InputError


def runs(folder: str | Path) -> dict[str, xr.Dataset]:
    """Name -> run (labkit.open_run) of the thin files in folder/runs. Raises InputError if there are none."""
    files = sorted((Path(folder) / "runs").glob("*.run.nc"))
    if not files:
        raise InputError(f"{folder}/runs holds no run files: make them with ./lab paper CAMPAIGN -o {folder}")
    return {file.name.removesuffix(".run.nc"): lk.open_run(file) for file in files}


def sources(found: Mapping[str, xr.Dataset]) -> list[str]:
    """The files of runs, name -> run; those that were made in memory have none."""
    return [run.encoding["source"] for run in found.values() if "source" in run.encoding]
