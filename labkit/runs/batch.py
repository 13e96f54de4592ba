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

    run: the Run, up to where it failed if it did, None if it failed before its first record; failure: why, one
    sentence, empty if it did not fail.
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

    tests: name -> (specimen, path), of any number of grains, scene and path; folder: for the run files, NAME.run.nc. A
    run that is there and unfinished is resumed, a finished one is kept. precision, recording: as for labkit.run. One
    test that fails does not stop the others.
    Raises InputError for a test that cannot be started, before any is, Interrupted after Ctrl-C or SIGTERM, with
    checkpoints in the files.
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
