"""Run: what came out of a test, as values."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Sequence
from pathlib import Path as File
from typing import Any

import xarray

from labkit.dem.limits import RECORDED, Exceeded, exceeded
from labkit.dem.paths import Path, path_of
from labkit.dem.scene import Scene
from labkit.micro.snapshot import Snapshot
from labkit.runs.dataset import open_run
from labkit.runs.figures import FIGURES


class Snapshots(Sequence[Snapshot]):
    """The snapshots of a run; one is read when it is asked for."""

    def __init__(self, data: xarray.Dataset) -> None:
        """data: of labkit.open_run."""
        self._data = data

    def __len__(self) -> int:
        return int(self._data.sizes["snapshot"])

    def __getitem__(self, number: Any) -> Any:
        if isinstance(number, slice):
            return [self[k] for k in range(*number.indices(len(self)))]
        if not -len(self) <= number < len(self):
            raise IndexError(f"snapshot {number}: this run has {len(self)}")
        return self._data.lab.snapshot(number)


@dataclasses.dataclass(frozen=True, eq=False)
class Run:
    """The result of a test. data: the xarray.Dataset that labkit.open_run gives for a run file, with the accessor
    `.lab`; file: the run file, None for a run in memory.
    """

    data: xarray.Dataset
    file: File | None = None

    @classmethod
    def open(cls, file: str | os.PathLike[str]) -> Run:
        """The run in a file; nothing is read before it is asked for. Raises InputError if it is not a run file."""
        return cls(open_run(file), File(file))

    @property
    def complete(self) -> bool:
        """Whether the path has been followed to its end."""
        return bool(self.data.attrs["complete"])

    @property
    def exceeded(self) -> tuple[Exceeded, ...]:
        """The limits that it left, each an Exceeded with name, limit, largest, records, of and strain; empty if none.

        They are those of the inertial number (3e-4), of the mean overlap (2 % of D) and of the mean stress (0.02 E).
        """
        return exceeded({name: self.data[name].values for name in RECORDED}, self.scene)

    @property
    def snapshots(self) -> Snapshots:
        """The Snapshots: `run.snapshots[-1]` is the last."""
        return Snapshots(self.data)

    @property
    def scene(self) -> Scene:
        """The Scene of its grains."""
        return self.data.lab.scene

    @property
    def path(self) -> Path | None:
        """Its loading path; None where nobody in this process knows it (see labkit.use)."""
        return path_of(self.data.attrs["path"], json.loads(self.data.attrs["path_parameters"]))

    @property
    def engine(self) -> str:
        """Name of the engine."""
        return str(self.data.attrs["engine"])

    @property
    def threads(self) -> int | None:
        """Threads of the last command that worked on it; None if the file does not say."""
        return int(self.data.attrs["threads"]) if "threads" in self.data.attrs else None

    @property
    def wall_time(self) -> float:
        """Seconds that it took."""
        return float(self.data.attrs["wall_time"])

    @property
    def steps(self) -> int:
        """Time steps."""
        return int(self.data.attrs["steps"])

    @property
    def provenance(self) -> dict[str, Any]:
        """What made it (labkit.io.provenance)."""
        return json.loads(self.data.attrs.get("provenance") or "{}")

    def plot(self, figure: str = "test", **options: Any) -> Any:
        """A matplotlib Figure, one of labkit.runs.figures.FIGURES. Raises InputError for an unknown name."""
        return FIGURES.require(figure, "figure")(self.data, **options)[0]

    def __repr__(self) -> str:
        state = "complete" if self.complete else "not complete"
        where = "in memory" if self.file is None else str(self.file)
        return (
            f"Run({self.data.attrs['path']} on {self.engine}, {state}, {self.data.sizes['time']} records, "
            f"{len(self.snapshots)} snapshots of {self.data.sizes['grain']} grains, {where})"
        )
