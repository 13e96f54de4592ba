"""Specimens and runs of one case on one engine, and what labkit reports about them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import xarray as xr

import labkit as lk
from analysis.hard_cases.checks import Check
from analysis.hard_cases.scenes import ENGINES, HardScene
from labkit.engines import Device
from labkit.errors import InputError, PhysicsError
from labkit.grains import Ledger, State, read_state
from labkit.paths import Path as Loading
from labkit.records import Exceeded

Judged = tuple[str, list[Check]]  # a description of what happened in a case, and its checks


class Laboratory:
    """Makes the specimens and runs of a scene on an engine, a key of ENGINES, in a separate folder.

    `shared` is the folder of the specimens and reference runs, always made with the `fused` engine, and `extent` the
    fraction of the scene's strain to apply. The case collects its run files in `runs`, the limits that they exceeded in
    `exceeded`, and all messages of labkit in `messages`.
    """

    def __init__(
        self, scene: HardScene, engine: str, grains: int, extent: float, folder: str | Path, shared: str | Path
    ) -> None:
        self.scene, self.grains, self.extent = scene, grains, extent
        name, precision = ENGINES[engine]
        self.device = Device(name, precision=precision)
        self.folder, self.shared = Path(folder), Path(shared)
        for place in (self.folder, self.shared):
            place.mkdir(parents=True, exist_ok=True)
        self.runs: list[Path] = []
        self.exceeded: list[Exceeded] = []
        self.messages: list[str] = []

    def specimen_file(self, grains: int | None = None) -> Path:
        """The state file of the scene's specimen, which is made if it does not exist."""
        scene, grains = self.scene, grains or self.grains
        file = self.shared / f"e{scene.void_ratio:g}_f{scene.step1_friction:g}_n{grains}.state.nc"
        if not file.exists():
            recipe = lk.Recipe(scene.void_ratio, scene.step1_friction, grains=grains, cell="fixed")
            lk.make_specimen(recipe, file=file, progress=False)
        return file

    def specimen(self, grains: int | None = None) -> State:
        """The scene's specimen."""
        return read_state(self.specimen_file(grains))

    def file(self, name: str) -> Path:
        """Path of a run file of the case."""
        return self.folder / f"{name}.run.nc"

    def run(
        self, state: State, path: Loading | None = None, name: str = "run", record_strain: float | None = None
    ) -> xr.Dataset:
        """Runs a specimen along the scene's path, or along another; returns the dataset of the run."""
        run = self.started(state, name, path, record_strain)
        self.keep(name, run.exceeded)
        return run.data

    def started(
        self, state: State, name: str, path: Loading | None = None, record_strain: float | None = None
    ) -> lk.Run:
        """Runs a specimen on the engine, in the precision of the case."""
        return lk.run(
            state, path or self.loading(), file=self.file(name), progress=False,
            engine=self.device, record_strain=record_strain,
        )  # fmt: skip

    def keep(self, name: str, exceeded: tuple[Exceeded, ...]) -> None:
        """Adds a run file to the case, with the exceeded limits that the run reported."""
        self.runs.append(self.file(name))
        self.exceeded += exceeded
        self.messages += map(str, exceeded)

    def loading(self) -> Loading:
        """The scene's path."""
        return self.scene.loading(self.extent)

    def half_step(self, state: State) -> xr.Dataset:
        """The scene's run on the `fused` engine with half the time step, as the converged reference."""
        file = self.shared / f"{self.scene.name}_n{state.number_of_grains}.run.nc"
        return lk.run(with_step(state, 0.5), self.loading(), file=file, progress=False).data

    def refused(self, attempt: Callable[[], object]) -> InputError | PhysicsError | None:
        """The error with which labkit refuses the attempt, or None if labkit accepts it."""
        try:
            attempt()
        except (InputError, PhysicsError) as error:
            self.messages.append(str(error))
            return error
        return None

    def refused_run(self, state: State, name: str, path: Loading | None = None) -> str:
        """The message with which labkit refuses or stops a run; empty if the run completes."""
        error = self.refused(lambda: self.started(state, name, path))
        return "" if error is None else str(error)

    def names_exceeded(self) -> set[str]:
        """Names of the limits that the runs report as exceeded."""
        return {limit.name for limit in self.exceeded}


def with_step(state: State, factor: float) -> State:
    """The state with its time step multiplied by `factor`."""
    scene = dataclasses.replace(state.scene, time_step_factor=factor * state.scene.time_step_factor)
    return state.replace(scene=scene)


def without_ledger(state: State) -> State:
    """The state of another run as a specimen, with its energy counters reset."""
    return state.replace(ledger=Ledger())
