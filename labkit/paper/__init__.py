"""The paper's tests at full size: from the run files of `labkit campaign paper` to results/paper.

`condense.py` makes thin run files that a repository can hold; everything else is made from these alone.
"""

from __future__ import annotations

from pathlib import Path

from labkit.runs.dataset import open_run
from labkit.errors import InputError


def runs(folder):
    """Name -> run (labkit.open_run) of the thin files in folder/runs. Raises InputError where there are none."""
    files = sorted((Path(folder) / "runs").glob("*.run.nc"))
    if not files:
        raise InputError(f"{folder}/runs holds no run files: make them with labkit paper CAMPAIGN -o {folder}")
    return {file.name.removesuffix(".run.nc"): open_run(file) for file in files}


def sources(found):
    """The files of runs, name -> run; those that were made in memory have none."""
    return [run.encoding["source"] for run in found.values() if "source" in run.encoding]
