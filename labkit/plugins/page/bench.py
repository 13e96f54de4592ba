"""The bench: makes specimens and carries out tests for a page, one record after another.

The page sends what the user chose, and receives messages. A run is a generator of requests to the engine; between two
of them the bench lets the page speak, so that a run can be paused and ended.
"""

from __future__ import annotations

import asyncio
import contextlib
import csv
import dataclasses
import io
import itertools
import json
import tempfile
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from labkit.errors import InputError, PhysicsError
from labkit.grains.state import State
from labkit.grains.state_file import read_state, write_state
from labkit.paths.facts import facts_of
from labkit.paths.path import Path as LoadingPath
from labkit.plugins import module_of_plugin
from labkit.plugins.page.form import Choices, Texts, chosen_path, require_number
from labkit.plugins.page.panels import panels, rose, row
from labkit.quantities.scalars import Facts
from labkit.records.schedule import Options
from labkit.simulation.tasks import RunTask, require_possible

OPTIONS = Options(snapshots=25, save_every=1)  # a run can be continued from each of its records
ROOM = 1.5  # grains may move so much farther from the centre than at the start, in the picture


def read_archive(archive: bytes) -> State:
    """Return the State in a State or run file. Raises InputError if it is damaged."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "file.npz")
        file.write_bytes(archive)
        try:
            return read_state(file)
        except InputError as error:
            raise InputError(str(error).replace(str(file), "this file")) from None


def archive_of(write: Callable[[Path], object]) -> bytes:
    """Return the content of a file that a function writes."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "file.npz")
        write(file)
        return file.read_bytes()


class Bench:
    """A specimen, and the test on it; `post` takes the messages to the page, JSON."""

    def __init__(self, post: Callable[[str], object]) -> None:
        """Start without a specimen."""
        self._post = post
        self._made: object = None  # what the specimen was made of
        self.specimen: State | None = None
        self.task: RunTask | None = None
        self._requests: Generator[None, None, bool] | None = None
        self._may_go_on = asyncio.Event()

    def tell(self, **message: object) -> None:
        """Send a message to the page."""
        self._post(json.dumps(message))

    async def start(self, texts: Texts, archive: bytes | None = None) -> None:
        """Make the specimen, unless it is there or in the archive, and load it along the path."""
        with self._errors():
            chosen = Choices.of(texts)
            wanted = chosen.recipe, chosen.scene, chosen.pressure
            self.end()
            if archive is not None:
                self.specimen, self._made = read_archive(archive), wanted
            elif self._made != wanted:
                self.specimen = chosen.specimen(lambda done, text: self.tell(status=f"specimen: {text}", done=done))
                self._made = wanted
            assert self.specimen is not None
            await self._load(self.specimen, chosen.path)

    def open_state(self, archive: bytes) -> None:
        """Take the specimen from a State file of the user."""
        with self._errors():
            state = read_archive(archive)
            require_number(len(state.radius))
            self.end()
            self.task, self.specimen, self._made = None, state, None
            self.tell(status=f"State with {state.contents}: choose a path, and go on with it", opened=True)

    async def go_on(self, texts: Texts) -> None:
        """Load the grains along the path from where the test is now."""
        with self._errors():
            path, state = chosen_path(texts), self.task.memory.state if self.task else self.specimen
            if state is None:
                raise InputError("there are no grains yet: run a test first, or load a State")
            self.end()
            await self._load(state, path)

    def pause(self) -> None:
        """Hold the run before its next request."""
        self._may_go_on.clear()

    def resume(self) -> None:
        """Let a paused run go on."""
        self._may_go_on.set()

    def end(self) -> None:
        """End the run; its records so far stay."""
        requests, self._requests = self._requests, None
        self._may_go_on.set()
        if requests is not None:
            requests.close()

    async def _load(self, state: State, path: LoadingPath) -> None:
        task = self.task = RunTask(state=state, path=path, options=OPTIONS)
        require_possible(task)
        requests = self._requests = task.device.carry_out(
            task.run(lambda done, text: self.tell(status=f"{path.name}: {text}", done=done))
        )
        self.tell(panels=panels(facts_of(task.path)), path=path.name, note=task.warning)
        show = Show(task, self.tell)
        self.resume()
        for _ in requests:
            show.what_is_new()
            await asyncio.sleep(0)
            await self._may_go_on.wait()
            if self._requests is not requests:
                return
        show.what_is_new()
        self.tell(finished=True, status=f"{path.name}: finished")

    @contextlib.contextmanager
    def _errors(self) -> Iterator[None]:
        """Context in which errors are told to the page in one sentence; the field in which it belongs comes with it."""
        try:
            yield
        except InputError as error:
            self.tell(error=error.message(lambda name: name.replace("_", " ")), field=error.field)
        except PhysicsError as error:
            self.tell(error=str(error), finished=True)
        except MemoryError:
            self.tell(lack=True, finished=True)

    def run_file(self) -> bytes:
        """Return the run as a file that labkit opens everywhere."""
        assert self.task is not None
        return archive_of(self.task.memory.write)

    def state_file(self) -> bytes:
        """Return the grains as they are now, as a State file."""
        state = self.task.memory.state if self.task else self.specimen
        assert state is not None
        return archive_of(lambda file: write_state(file, state))

    def records(self) -> str:
        """Return the records of the run as CSV, one column per component, named as in tables of labkit."""
        assert self.task is not None
        table, records = self.task.memory.table, self.task.memory.recordings.records.values()
        columns: list[np.ndarray] = []
        names: list[str] = []
        for name, variable in table.items():
            letters = ["".join(axes) for axes in itertools.product(*("xyz" for _ in variable.dimensions[1:]))]
            unit = "" if variable.units == "1" else f" [{variable.units}]"
            names += [f"{name}_{letter}{unit}" if letter else f"{name}{unit}" for letter in letters]
            columns += [*np.array([np.ravel(np.asarray(record[name])) for record in records]).T]
        text = io.StringIO()
        csv.writer(text).writerows([names, *zip(*columns, strict=True)])
        return text.getvalue()


class Show:
    """Tells a page of the records and snapshots of a run that it has not seen."""

    def __init__(self, task: RunTask, tell: Callable[..., None]) -> None:
        """Store the run, of which nothing was shown."""
        self._task, self._tell = task, tell
        self._records = self._snapshots = 0
        self._frames: Any = None  # in the form of the viewer

    def what_is_new(self) -> None:
        """Send the rows of new records, and the last snapshot if it is new."""
        recordings = self._task.memory.recordings
        for number in range(self._records, len(recordings.records)):
            self._tell(row=row(recordings.records[number], self._facts()), number=number)
        self._records = len(recordings.records)
        if len(recordings.snapshots) == self._snapshots:
            return
        self._snapshots, (_, snapshot) = len(recordings.snapshots), recordings.snapshots[-1]
        common = None
        if self._frames is None:
            frames = module_of_plugin("the page", "labkit.plugins.pictures.frames")
            self._frames = frames.Frames([snapshot], ROOM)
            common = self._frames.common()
        self._tell(common=common, snapshot=self._frames.frame(snapshot), rose=rose(snapshot))

    def _facts(self) -> Facts:
        """Return the facts of the run; pore pressures refer to the start of undrained loading."""
        facts, state = facts_of(self._task.path), self._task.memory.state
        start = state.undrained_stress if state else ()
        return dataclasses.replace(facts, reference=np.reshape(start, (3, 3))) if any(start) else facts
