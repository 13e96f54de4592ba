"""Many tests at once, from Python.

outcomes = labkit.run_batch({"a": (state, path), "b": (other, another)}, "results")
outcomes["a"].run, outcomes["a"].failure
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path as File
from typing import NamedTuple

from labkit.engines import Start, start_of
from labkit.errors import InputError, PhysicsError
from labkit.grains.state import State
from labkit.io.files import require_writable
from labkit.paths.path import Path
from labkit.records.schedule import Options
from labkit.runs.batches import execute_together
from labkit.runs.laboratory import load_task, recording_options, warn
from labkit.runs.run import Run


class Outcome(NamedTuple):
    """The result of one test of a batch.

    `run` is the Run, up to the point of failure if it failed, or None if it failed before its first record. `failure`
    is one sentence that says why it failed, or empty.
    """

    run: Run | None
    failure: str


def run_batch(
    tests: Mapping[str, tuple[State, Path]],
    folder: str | os.PathLike[str],
    engine: str | Start = "cuda",
    precision: str = "double",
    options: Options | None = None,
    **recording: object,
) -> dict[str, Outcome]:
    """Load specimens along paths, on the engine cuda together, on others one after the other; name -> Outcome.

    An unfinished run in the folder is resumed, a finished one is kept. A test that fails does not stop the others.
    Raises InputError, before any test starts, if one cannot be started, and Interrupted after Ctrl-C or SIGTERM, with
    checkpoints in the files.

    Args:
        tests: Name -> (specimen, path); the number of grains, the scene and the path may differ.
        folder: Folder for the run files, NAME.run.nc.
        engine: Engine, or its name.
        precision: Precision, as for labkit.run.
        options: Options, as for labkit.run.
        recording: Fields of Options, as for labkit.run.
    """
    options = recording_options(run_batch, options, recording)
    files = {name: File(folder) / f"{name}.run.nc" for name in tests}
    tasks = []
    for name, (state, path) in tests.items():
        require_writable(files[name], "run")
        start = start_of(engine, precision=precision)
        tasks.append(load_task(state, path, start=start, output=str(files[name]), options=options))
        warn(tasks[-1].warning)
    outcomes = {}
    for (name, file), failure in zip(files.items(), execute_together(tasks), strict=True):
        if failure is not None and not isinstance(failure, (InputError, PhysicsError)):
            raise failure
        outcomes[name] = Outcome(Run.open(file) if file.exists() else None, "" if failure is None else str(failure))
    return outcomes
