"""The recorder appends records, snapshots and a checkpoint to a run file, which is valid at all times, or to memory.

A save copies the file, appends to the copy and renames the copy over the original, so a process killed at any moment
leaves the previously saved file intact. The checkpoint, a State in the group `checkpoint`, is written with all earlier
records. How long a save takes determines which checkpoints are saved. A thread, the Writer, writes the file while the
run computes.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import json
import os
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from labkit.errors import InputError, PhysicsError
from labkit.extensions import is_labkits
from labkit.files.netcdf import damage_error, extend_netcdf, new_netcdf, open_netcdf
from labkit.files.schema import BY_VOLUME, ECCENTRICITY, LOSSES, Variable
from labkit.grains.state import State
from labkit.grains.state_file import attributes_of, checkpoint_of, state_in_run
from labkit.micro.snapshot import Snapshot
from labkit.paths.ending import endings_of
from labkit.paths.path import Path as LoadingPath
from labkit.paths.programme import PROGRESS
from labkit.process.interruption import only_writer, require_owner
from labkit.quantities.recorded import record_table
from labkit.records.checkpoint import Checkpoint, differences, position_of, ratcheting_of, write_checkpoint
from labkit.records.recordings import Recordings, append_records, create_run

if TYPE_CHECKING:
    import netCDF4

    from labkit.records.memory import RunInMemory

LEAST_PAUSE = 5.0  # least time (s) between the starts of two writes
SHARE = 0.05  # largest fraction of the time spent on writing


class Writer:
    """Runs one function at a time in a separate thread."""

    def __init__(self) -> None:
        """Create a writer; no thread is started yet."""
        self._executor = ThreadPoolExecutor(1)
        self._running: Future[None] | None = None
        self._started, self._took = -LEAST_PAUSE, 0.0  # start and duration (s) of the last write

    def start(self, write: Callable[[], None]) -> None:
        """Start running a function; the previous one must have ended (`wait`)."""
        self._started = time.monotonic()
        self._running = self._executor.submit(self._write_and_time, write)

    def is_due(self) -> bool:
        """Return True if a write should start now: none is running, and the last write is long enough ago."""
        if self._running is not None and not self._running.done():
            return False
        return not 0.0 <= time.monotonic() - self._started < max(LEAST_PAUSE, self._took / SHARE)  # or clock set back

    def wait(self) -> None:
        """Wait for the running function. Raises the exception with which it ended."""
        running, self._running = self._running, None
        if running is not None:
            running.result()

    def close(self) -> None:
        """Wait for the running function and end the thread. Raises the exception that ended the function."""
        try:
            self.wait()
        finally:
            self._executor.shutdown()

    def _write_and_time(self, write: Callable[[], None]) -> None:
        write()
        self._took = time.monotonic() - self._started


MOST_UNSAVED = 500_000_000  # largest number of bytes of unsaved snapshots
MARGIN = 900_000  # bytes by which a file may exceed its data: partly filled chunks, HDF5 tables


@dataclasses.dataclass(frozen=True, eq=False)
class StoredRun:
    """A run in a file: its checkpoint, its first and its last record."""

    point: Checkpoint
    first: dict[str, np.ndarray]
    last: dict[str, np.ndarray]
    about_zero: bool  # True if a version began it whose cycles were about zero from any state


class Recorder:
    """Writes a run to a file, with exclusive access while it is open as a context manager, or to memory.

    Args:
        output: The run file, or a RunInMemory for a run without a file.
        path: The loading path.
        settings: Everything else that determines the records.
        specimen: The initial State.
        extra: Variables recorded in addition to the variables of the path.
        all_saved: True to save every checkpoint.
    """

    def __init__(
        self,
        output: Path | RunInMemory,
        path: LoadingPath,
        settings: dict[str, object],
        specimen: State,
        extra: Mapping[str, Variable],
        all_saved: bool = False,
    ) -> None:
        """Store the arguments; the file is opened and locked by `with`."""
        losses = {name: LOSSES[name] for name in specimen.scene.contact_law.losses}
        shape = {} if specimen.bodies is None else ECCENTRICITY
        self.table = {
            **record_table(),
            **BY_VOLUME,
            **shape,
            **losses,
            **(PROGRESS if path.has_programmes else {}),
            **extra,
        }
        self.output = output
        self.scene = specimen.scene
        self.specimen = specimen.digest()
        self.undrained_before: tuple[float, ...] = ()  # stress at the start of undrained loading before this run, Pa
        self.path = path
        self.settings = settings
        self.all_saved = all_saved
        self.records = 0  # number of records in the file and in memory
        self._new, self._ready = Recordings(), Recordings()  # since the last checkpoint, and before it
        self._checkpoint: Checkpoint | None = None  # the last checkpoint, if it is not in the file yet
        self._writer = Writer()

    def __enter__(self) -> Recorder:
        self._lock = only_writer(self.output) if isinstance(self.output, Path) else contextlib.nullcontext()
        self._lock.__enter__()
        self._owner = os.getpid()
        return self

    def __exit__(self, *exception: Any) -> None:
        try:
            if os.getpid() == self._owner:  # a forked process leaves file and writer to its parent
                with contextlib.closing(self._writer):
                    self.flush()
        finally:
            self._lock.__exit__(*exception)

    def record(self, values: dict[str, object], snapshot: Snapshot | None = None) -> None:
        """Add one record (Instant.measure), and its contacts and positions if a snapshot is given."""
        if snapshot is not None:
            self._new.snapshots.append((self.records, dataclasses.replace(snapshot)))  # without its cached values
        self._new.records[self.records] = values
        self.records += 1

    def drop_last(self) -> None:
        """Drop the last record, which has no snapshot: the next record replaces it."""
        self.records -= 1

    def checkpoint(self, point: Checkpoint) -> None:
        """Store a checkpoint in memory; if a save is due, start to write the file up to this checkpoint."""
        self._note(point)
        if self.all_saved or self._ready.bytes > MOST_UNSAVED or self._writer.is_due():
            self._write()
            if not is_labkits(type(self.path)):
                self.wait()  # the path may read files while the run computes

    def save(self, point: Checkpoint) -> None:
        """Write all records so far and this checkpoint to the file."""
        self._note(point)
        self.flush()

    def flush(self) -> None:
        """Write everything up to the last checkpoint to the file."""
        self._write()
        self.wait()

    def wait(self) -> None:
        """Wait for the pending write; netCDF is not thread-safe.

        Raises PhysicsError if the file could not be written.
        """
        try:
            self._writer.wait()
        except OSError as error:
            assert isinstance(self.output, Path)
            save = "its last save is intact" if self.output.exists() else "there is no earlier save"
            room = "free some disk space and " * (error.errno in (errno.ENOSPC, errno.EDQUOT))
            said = f"{self.output} could not be saved ({error.strerror or error}); {save}"
            raise PhysicsError(f"{said}: {room}give the same command again") from None

    def _note(self, point: Checkpoint) -> None:
        self._checkpoint = point
        self._ready.extend(self._new)
        self._new = Recordings()

    def _write(self) -> None:
        """Start to write the last checkpoint, unless it is already written or being written."""
        require_owner(self._owner)
        point, ready = self._checkpoint, self._ready
        if point is not None:
            self.wait()
            self._checkpoint, self._ready = None, Recordings()
            if isinstance(self.output, Path):
                self._writer.start(lambda: self._append_to_file(point, ready))
            else:
                self._append_to_memory(self.output, point, ready)

    def _attributes(self, point: Checkpoint) -> dict[str, object]:
        """Return the attributes of a run file that change from one checkpoint to the next."""
        return {
            **attributes_of(point.state, "run"),
            "complete": np.int32(point.complete),
            "ended_because": point.endings.reason,
            "endings": point.endings.to_json(),
            "wall_time": float(point.wall_time),
            "steps": np.int64(point.state.step),
            "threads": np.int32(point.threads),
        }

    def _append_to_memory(self, memory: RunInMemory, point: Checkpoint, unsaved: Recordings) -> None:
        memory.recordings.extend(unsaved)
        memory.table, memory.attributes = self.table, self._identity | self._attributes(point)
        state = point.state.replace(history=memory.attributes["history"])
        memory.point = dataclasses.replace(point, state=state)

    def _append_to_file(self, point: Checkpoint, unsaved: Recordings) -> None:
        assert isinstance(self.output, Path)
        exists = self.output.exists()
        space = MARGIN + unsaved.bytes + point.state.nbytes
        with extend_netcdf(self.output, space) if exists else new_netcdf(self.output, space) as dataset:
            if not exists:
                create_run(dataset, self.table, point.state)
                dataset.setncatts(self._identity)
            append_records(dataset, self.table, unsaved)
            dataset.setncatts(self._attributes(point))
            write_checkpoint(dataset, point)

    @property
    def _identity(self) -> dict[str, object]:
        """Return the attributes of a run file that identify the run."""
        begun = {"undrained_before": np.array(self.undrained_before or (0.0,) * 9)}
        return {"path": self.path.name, "path_parameters": self.parameters(), "specimen": self.specimen, **begun}

    def parameters(self) -> str:
        """Return the path parameters and the settings as JSON, for the attribute `path_parameters`."""
        return json.dumps({**dataclasses.asdict(self.path), **self.settings})

    def _require_same_variables(self, dataset: netCDF4.Dataset) -> None:
        """Raise InputError unless the unfinished run in the file has the same variables as this run."""
        stored = {name for name, variable in dataset.variables.items() if variable.dimensions[:1] == ("time",)}
        for what, names in (("lacks", set(self.table) - stored), ("has", stored - set(self.table))):
            if names:
                raise InputError(
                    f"{self.output} was started with different statistics, it {what} {', '.join(sorted(names))}: "
                    "choose another file, or load the same extensions to resume it"
                )

    def _require_plausible(self, file: Path, state: State, dataset: netCDF4.Dataset) -> None:
        """Raise InputError if a checkpoint cannot belong to this run; its file may have no hash."""
        same = np.array_equal(state.radius, np.ma.getdata(dataset["grains"]["radius"][...]))
        if not same or state.scene != self.scene:
            raise damage_error(file, "the grains of its checkpoint are not those of the specimen")
        if self.records == 0 or not np.isclose(state.time, state.step * state.time_step, rtol=1e-6, atol=0.0):
            raise damage_error(file, "the time of its checkpoint is not that of its step")

    def resume(self) -> StoredRun | None:
        """Return the unfinished or complete run in the file, or None if there is no file yet.

        Raises InputError if the run in the file has different parameters or a different specimen.
        """
        file = self.output
        if not isinstance(file, Path) or not file.exists():
            return None
        with open_netcdf(file, "run") as dataset:
            stored = {"path": dataset.getncattr("path"), **json.loads(dataset.path_parameters)}
            requested = {"path": self.path.name, **json.loads(self.parameters())}
            if differs := differences(stored, requested):
                raise InputError(
                    f"{file} holds another run ({differs}): choose another file, or give the same options to resume it"
                )
            for name in BY_VOLUME.keys() - dataset.variables.keys():  # started by an earlier version
                del self.table[name]
            if not bool(dataset.complete):
                self._require_same_variables(dataset)
            if getattr(dataset, "specimen", None) != self.specimen:
                raise InputError(f"{file} was started with another specimen: choose another file")
            self.records = len(dataset.dimensions["time"])
            checkpoint = checkpoint_of(file, dataset)
            names, ends = set(self.table) & set(dataset.variables), (0, self.records - 1)
            first, last = ({name: dataset[name][end].filled() for name in names} for end in ends)
            try:
                position = position_of(checkpoint)
            except (TypeError, ValueError) as error:
                raise damage_error(file, f"its checkpoint: {error}") from None
            state = state_in_run(file, dataset)
            self._require_plausible(file, state, dataset)
            endings = endings_of({name: dataset.getncattr(name) for name in dataset.ncattrs()})
            ratcheting = ratcheting_of(checkpoint, self.records)
            is_complete, seconds = bool(dataset.complete), float(dataset.wall_time)
            point = Checkpoint(state, is_complete, seconds, 1, position, endings, ratcheting)
            return StoredRun(point, first, last, about_zero=not hasattr(dataset, "endings"))
