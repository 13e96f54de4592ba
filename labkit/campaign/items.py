"""What a campaign holds, as values: specimens to make, specimens to consolidate, and runs."""

from __future__ import annotations

import dataclasses
from pathlib import Path as File
from typing import Any

from labkit.dem.paths import Path
from labkit.dem.scene import Scene
from labkit.dem.simulation import Options, Schedule
from labkit.dem.specimen import Recipe

USUAL_PRESSURE = 0.5e6  # Pa, stands for the pressure of a specimen that is not made yet


@dataclasses.dataclass(frozen=True)
class Specimen:
    """A specimen to make."""

    name: str
    recipe: Recipe
    scene: Scene = Scene()
    engine: str = "yade"
    threads: int = 1

    @property
    def expected_grains(self) -> int:
        """Number of grains, about."""
        return self.recipe.expected_grains(self.scene)


@dataclasses.dataclass(frozen=True)
class Consolidated:
    """The specimen `source` brought to `pressure`, Pa, in all directions."""

    name: str
    source: str
    pressure: float
    engine: str = "yade"
    threads: int = 1


@dataclasses.dataclass(frozen=True)
class Run:
    """A loading path of a specimen. changes: (parameter of the Scene, value) of those that the specimen need not
    share.
    """

    name: str
    specimen: str
    path: Path
    options: Options = Options()
    changes: tuple[tuple[str, Any], ...] = ()
    engine: str = "yade"
    threads: int = 1

    def scene(self, specimen: Specimen) -> Scene:
        """The Scene of the run of a Specimen."""
        return dataclasses.replace(specimen.scene, **dict(self.changes))

    def loading(self) -> Path:
        """The path; where its pressure is the specimen's own, which is not known yet, a usual one stands."""
        return self.path.starting_at(USUAL_PRESSURE)


Item = Specimen | Consolidated | Run


@dataclasses.dataclass(frozen=True)
class Campaign:
    """What a file asks for, lists multiplied out; names are unique among specimens and among runs.

    use: Python files of the user's own that it needs, see labkit.extensions.
    """

    name: str
    specimens: tuple[Specimen, ...]
    consolidated: tuple[Consolidated, ...]
    runs: tuple[Run, ...]
    use: tuple[File, ...] = ()

    def origin(self, name: str) -> Specimen:
        """The Specimen that a specimen's name goes back to."""
        sources = {item.name: item.source for item in self.consolidated}
        while name in sources:
            name = sources[name]
        return next(item for item in self.specimens if item.name == name)

    def consolidation(self, run: Run) -> str | None:
        """The name of the consolidation that labkit adds before a run, where the run holds a stress that its specimen
        was not brought to; None for any other run.
        """
        at = next((item.pressure for item in self.consolidated if item.name == run.specimen), None)
        pressure = run.path.start_pressure()
        return None if pressure in (None, at) else consolidation_name(run.specimen, pressure, run.engine)


def consolidation_name(specimen: str, pressure: float, engine: str) -> str:
    """How labkit calls a specimen that it brings to a pressure, Pa, before a run."""
    return f"{specimen}-at-p{pressure / 1e3:.10g}kPa-{engine}"


def schedule_of(run: Run, specimen: Specimen) -> Schedule:
    """The Schedule of a Run of a Specimen: how many steps and records. Raises InputError when they do not fit."""
    return Schedule.of(run.loading(), run.scene(specimen).time_step, specimen.expected_grains, run.options)
