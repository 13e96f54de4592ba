"""Contents of a campaign as value objects: specimens to make, specimens to consolidate, and runs."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path as File
from typing import Any

from labkit.engines import Device
from labkit.grains.scene import Scene
from labkit.paths.path import Path
from labkit.paths.rates import on_grains
from labkit.records.schedule import Options, Schedule
from labkit.specimens.specimen import Recipe

TYPICAL_PRESSURE = 0.5e6  # Pa, assumed where the pressure of a specimen is not known before it is made


@dataclasses.dataclass(frozen=True)
class _Work:
    """Fields of every item: its name, and how it is computed."""

    name: str
    engine: str = dataclasses.field(default="fused", kw_only=True)
    threads: int = dataclasses.field(default=1, kw_only=True)
    precision: str = dataclasses.field(default="double", kw_only=True)

    def require_engine(self, scene: Scene) -> None:
        """Raise InputError if the engine does not support the scene or the precision."""
        Device(self.engine, self.threads, self.precision).require_scene(scene)


@dataclasses.dataclass(frozen=True)
class Specimen(_Work):
    """A specimen to make."""

    recipe: Recipe
    scene: Scene = dataclasses.field(default_factory=Scene)

    @property
    def expected_grains(self) -> int:
        """Approximate number of grains."""
        return self.recipe.expected_grains(self.scene)


@dataclasses.dataclass(frozen=True)
class Consolidated(_Work):
    """The specimen `source`, consolidated isotropically to `pressure`, Pa."""

    source: str
    pressure: float


@dataclasses.dataclass(frozen=True)
class PlannedRun(_Work):
    """A loading path applied to a specimen, or to the grains at the end of another run.

    `changes` are (parameter, value) pairs of the Scene that may differ from the specimen's.
    """

    specimen: str
    path: Path
    options: Options = dataclasses.field(default_factory=Options)
    changes: tuple[tuple[str, Any], ...] = ()

    def scene(self, specimen: Specimen) -> Scene:
        """Return the Scene of the run, for the Specimen from which it starts."""
        return specimen.scene.replace(**dict(self.changes))

    def loading(self, specimen: Specimen) -> Path:
        """Return the path with its rate.

        A typical value replaces a pressure that is unknown until the specimen has been made.
        """
        return on_grains(self.path, self.scene(specimen)).starting_at(TYPICAL_PRESSURE)


Item = Specimen | Consolidated | PlannedRun


@dataclasses.dataclass(frozen=True)
class Campaign:
    """Contents of a campaign file with its lists expanded; specimen names are unique, and so are run names.

    `use` lists the user-supplied Python files that it needs (labkit.extensions).
    """

    name: str
    specimens: tuple[Specimen, ...]
    consolidated: tuple[Consolidated, ...]
    runs: tuple[PlannedRun, ...]
    use: tuple[File, ...] = ()

    def origin(self, name: str) -> Specimen:
        """The Specimen from which the named specimen or run is derived, or that specimen itself.

        That of a run has the Scene of the run, which the next run takes over.
        """
        item = self._items[name]
        while isinstance(item, Consolidated):
            item = self._items[item.source]
        if isinstance(item, Specimen):
            return item
        origin = self.origin(item.specimen)
        return dataclasses.replace(origin, scene=item.scene(origin))

    @functools.cached_property
    def _items(self) -> dict[str, Item]:
        """All items by name; a specimen wins over a run of the same name."""
        items: tuple[Item, ...] = (*self.runs, *self.specimens, *self.consolidated)
        return {item.name: item for item in items}

    def consolidation(self, run: PlannedRun) -> str | None:
        """Name of the consolidation that labkit inserts before a run, or None.

        It is inserted if the run holds a stress to which its specimen was not consolidated. A run that continues from
        another one consolidates by itself if its stress differs.
        """
        start, pressure = self._items[run.specimen], run.path.start_pressure()
        if isinstance(start, PlannedRun):
            return None
        at = start.pressure if isinstance(start, Consolidated) else None
        return None if pressure is None or pressure == at else consolidation_name(run, pressure)


def consolidation_name(run: PlannedRun, pressure: float) -> str:
    """Name of a specimen that labkit consolidates to a pressure, Pa, before a run."""
    working = run.engine if run.precision == "double" else f"{run.engine}-{run.precision}"
    return f"{run.specimen}-at-p{pressure / 1e3:.10g}kPa-{working}"


def schedule_of(run: PlannedRun, specimen: Specimen) -> Schedule:
    """Return the Schedule (steps and records) of a PlannedRun of a Specimen.

    Raises InputError if rate, strain and time step are incompatible.
    """
    return Schedule.of(run.loading(specimen), run.scene(specimen).time_step, specimen.expected_grains, run.options)
