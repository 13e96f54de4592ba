"""The state of an unfinished consolidation, kept in a file so that a killed command need not begin anew.

A consolidation that is continued ends at the same stresses as one that was not interrupted, but not with the same bits:
loading a state changes the order in which contact forces are summed.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import time
from pathlib import Path as File

from labkit.errors import InputError, Interrupted
from labkit.grains.state import State, read_state, write_state
from labkit.io.interruption import Signals
from labkit.paths.path import Path

PAUSE = 60.0  # s between two saves
SHARE = 0.05  # of the time may be spent on saving


class Interim:
    """Keeps states of the consolidation of a specimen along a path in a file.

    file: None to keep nothing; engine: its name.
    """

    def __init__(self, file: File | None, specimen: State, path: Path, engine: str) -> None:
        """Read nothing yet."""
        self.file = file
        aim = [specimen.digest(), path.name, dataclasses.asdict(path), engine]
        self._key = hashlib.sha256(json.dumps(aim).encode()).hexdigest()
        self._specimen = specimen
        self._saved, self._took = time.monotonic(), 0.0

    def resumed(self) -> State | None:
        """The last state that was kept of the same consolidation; None if there is none."""
        if self.file is None or not self.file.exists():
            return None
        try:
            state = read_state(self.file)
        except InputError:  # damaged, or of another version: begin anew
            return None
        if state.history != self._key:
            return None
        kept = self._specimen
        return state.replace(history=kept.history, recipe=kept.recipe, provenance=kept.provenance)

    def keep(self, state: State, signals: Signals) -> None:
        """Save a state if that is due. Raises Interrupted, after saving it, if a signal was caught."""
        now = time.monotonic()
        if self.file is None or not (signals.caught or now - self._saved > max(PAUSE, self._took / SHARE)):
            return
        write_state(self.file, state.replace(history=self._key, recipe="", provenance=""))
        self._saved, self._took = time.monotonic(), time.monotonic() - now
        if signals.caught:
            raise Interrupted(
                f"stopped by signal {signals.caught}; {self.file} keeps the consolidation so far: give the same "
                "command to continue it",
                128 + signals.caught,
            )

    def remove(self) -> None:
        """Delete the file, when the consolidation is complete."""
        if self.file is not None:
            self.file.unlink(missing_ok=True)


def interim_of(output: File | str | None) -> File | None:
    """Path of the file that keeps the consolidation of a command that writes `output`."""
    return None if output is None else File(output).with_name(f".{File(output).name}.consolidation")
