"""How a run stops after a signal: at its next checkpoint, so that every record is kept and the bits of the run too."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path as File

from labkit.errors import Interrupted
from labkit.files.netcdf import open_netcdf
from labkit.paths.path import Path
from labkit.process.interruption import Signals, nothing_saved
from labkit.records.memory import RunInMemory
from labkit.records.recorder import Recorder

TO_RECORD, AT_ONCE = 8.0, 15.0  # s after a signal; queues and services kill a job 10 to 90 s after it


@dataclasses.dataclass
class Stopping:
    """Decides where a run stops after a signal, and says what its file then holds.

    The run goes on to its next checkpoint. After 8 s it stops at the next record; after 15 s, or at a second signal, at
    once. It can be resumed from there too, but not with the same bits. A run in memory always stops at once.

    Args:
        signals: The signals received.
        path: Path of the run.
        recorder: Recorder of the run.
        tell: Function that is called once with a text, when a run goes on after a signal.
    """

    signals: Signals
    path: Path
    recorder: Recorder
    tell: Callable[[str], None]
    message_shown: bool = False

    def __post_init__(self) -> None:
        """Note whether the signal came before the run, which then does not begin."""
        self.late = bool(self.signals.caught)

    def at_once(self) -> bool:
        """Return True if the run stops between two records."""
        signals = self.signals
        if not signals.caught or self.late or isinstance(self.recorder.output, RunInMemory):
            return bool(signals.caught)
        if not self.message_shown:
            self.message_shown = True
            self.tell(f"signal {signals.caught}: stops at the next save, after a second signal at once")
        return signals.repeated or signals.age > AT_ONCE

    def is_due(self, at_checkpoint: bool) -> bool:
        """Return True if the run stops at this record; `at_checkpoint` is True if a checkpoint was planned here."""
        return bool(self.signals.caught) and (at_checkpoint or self.signals.age > TO_RECORD or self.at_once())

    def error(self) -> Interrupted:
        """Return the error of the stopped run. Its file has been written: the error says what the file holds."""
        number, file = self.signals.caught, self.recorder.output
        if isinstance(file, RunInMemory):
            return nothing_saved(number)
        content = contents(file, self.path)
        return Interrupted(
            f"stopped by signal {number}; {file} is saved: {content}; give the same command to resume it", 128 + number
        )


def contents(file: File, path: Path) -> str:
    """Describe the records of an unfinished run file, e.g. `3 records, up to axial strain 0.60%`."""
    with open_netcdf(file, "run") as dataset:
        records, measure = len(dataset.dimensions["time"]), path.strain_measure()
        strain = float(measure.at(dataset["strain"][-1].filled()))
    return f"{records} record{'s' * (records > 1)}, up to {measure.name} {strain:.2%}"
