"""Makes the specimens and runs of one case on one engine, and keeps what labkit says of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import xarray as xr

import labkit as lk
from analysis.hard_cases.checks import Check
from analysis.hard_cases.scenes import HardScene
from labkit.dem import Exceeded, Ledger, State, read_state
from labkit.dem import Path as Loading
from labkit.errors import InputError, PhysicsError

Judged = tuple[str, list[Check]]  # what a case did, in words, and its checks


class Laboratory:
    """A scene, an engine, and a folder of its own.

    shared: folder of the specimens and reference runs, which are the engine fused's for either engine; extent: how
    much of the strains of a scene is made, 1 for all. It keeps the run files, the limits that runs have exceeded, and
    all that labkit said, as text.
    """

    def __init__(
        self, scene: HardScene, engine: str, grains: int, extent: float, folder: str | Path, shared: str | Path
    ) -> None:
        self.scene, self.engine, self.grains, self.extent = scene, engine, grains, extent
        self.folder, self.shared = Path(folder), Path(shared)
        for place in (self.folder, self.shared):
            place.mkdir(parents=True, exist_ok=True)
        self.runs: list[Path] = []
        self.exceeded: list[Exceeded] = []
        self.said: list[str] = []

    def specimen_file(self, grains: int | None = None) -> Path:
        """The state file of the scene's specimen, which is made if it is not there."""
        scene, grains = self.scene, grains or self.grains
        file = self.shared / f"e{scene.void_ratio:g}_f{scene.step1_friction:g}_n{grains}.state.nc"
        if not file.exists():
            recipe = lk.Recipe(scene.void_ratio, scene.step1_friction, grains=grains)
            lk.make_specimen(recipe, file=file, progress=False)
        return file

    def specimen(self, grains: int | None = None) -> State:
        """The scene's specimen."""
        return read_state(self.specimen_file(grains))

    def file(self, name: str) -> Path:
        """The name of a run file of the case."""
        return self.folder / f"{name}.run.nc"

    def run(
        self, state: State, path: Loading | None = None, name: str = "run", record_strain: float | None = None
    ) -> xr.Dataset:
        """Takes a specimen along the scene's path, or along another; the run, as labkit.open_run gives it."""
        file = self.file(name)
        done = lk.run(state, path or self.loading(), self.engine, file, progress=False, record_strain=record_strain)
        self.keep(name, done.exceeded)
        return done.data

    def keep(self, name: str, exceeded: tuple[Exceeded, ...]) -> None:
        """Counts a run file as one of the case's, and what it exceeded as said."""
        self.runs.append(self.file(name))
        self.exceeded += exceeded
        self.said += map(str, exceeded)

    def loading(self) -> Loading:
        """The scene's path."""
        return self.scene.loading(self.extent)

    def half_step(self, state: State) -> xr.Dataset:
        """The scene's run on the engine fused with half the time step: what a converged run gives."""
        file = self.shared / f"{self.scene.name}_n{state.number_of_grains}.run.nc"
        return lk.run(with_step(state, 0.5), self.loading(), file=file, progress=False).data

    def refused(self, attempt: Callable[[], object]) -> InputError | PhysicsError | None:
        """The error with which labkit gives up what it is asked for, or None if it does not."""
        try:
            attempt()
        except (InputError, PhysicsError) as error:
            self.said.append(str(error))
            return error
        return None

    def refused_run(self, state: State, name: str, path: Loading | None = None) -> str:
        """What labkit says of a run that it refuses or stops; empty if it does not."""
        file = self.file(name)
        error = self.refused(lambda: lk.run(state, path or self.loading(), self.engine, file, progress=False))
        return "" if error is None else str(error)

    def names_exceeded(self) -> set[str]:
        """The names of the limits that the runs say they have exceeded."""
        return {one.name for one in self.exceeded}


def with_step(state: State, factor: float) -> State:
    """The state with its time step multiplied."""
    scene = dataclasses.replace(state.scene, time_step_factor=factor * state.scene.time_step_factor)
    return state.replace(scene=scene)


def without_ledger(state: State) -> State:
    """The state of another run as a specimen: its energies are counted anew."""
    return state.replace(ledger=Ledger())
