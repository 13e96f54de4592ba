"""The specimens and tests of analysis/plans/hidden_state.md and hidden_fabric.md, which `./lab hidden-state` runs.

Each test is written as one file; finished tests are not run again. The FIRST tests of all specimens come first, and
within them the seeds in turn, so that what is finished is balanced over densities, training and held-out seeds.
"""

from __future__ import annotations

import dataclasses
import functools
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import labkit as lk
from analysis.hidden_state.records import Records, records_of
from labkit.errors import PhysicsError
from labkit.paths import StressRotation

PRESSURE, RATE = 500e3, 20.0  # Pa, 1/s
# friction of step 1, amplitude of q/p in `undrained`, accumulated strain of `turn`, which loose grains need more of
DENSITIES = {"dense": (0.03, 0.3, 0.25), "medium": (0.12, 0.25, 0.35), "loose": (0.4, 0.15, 0.76)}
SEEDS, HELD_OUT = (1, 3, 2, 4), (3, 4)
FABRIC_SEEDS = (5, 6)  # only for the tests of hidden_fabric.md
GRAINS = 1000
TURNS = (0.2, 0.4, 0.6)
LARGE = (0.01, -0.01, 0.02, -0.02, 0.03)
LOOPS = (0.01, 0.008, 0.03, 0.028, 0.05, 0.048, 0.06)
FINE, COARSE = 2.5e-4, 1e-3  # accumulated strain between records
TURNED = 1.0 / 150.0  # the same for `turn`, as a share of the test
FINELY = ("small", "loops", "undrained", "turn")
FIRST = ("small", "large", "compression", "extension", "turn 0.4", "again 90")
DEVICE = lk.Fused(threads=1, precision="mixed")
SCENE = lk.Scene(time_step_factor=0.3)


@dataclasses.dataclass(frozen=True)
class TurnAndReturn(StressRotation):
    """As StressRotation, but sigma_1 turns back in the second half of the strain that follows the ramp."""

    name = "turn_and_return"

    def stress_at(self, accumulated: float) -> np.ndarray:
        strain = float(self.strain)
        ramp = 0.05 * strain
        half = 0.5 * (strain - ramp)
        done = max(accumulated - ramp, 0.0) / half
        p, size = self.held_pressure, min(accumulated / ramp, 1.0)
        radius = float(self.stress_ratio) * self.held_pressure * size / np.sqrt(3.0)
        twice = 2.0 * np.radians(float(self.rotation)) * (done if done < 1.0 else 2.0 - done)
        normal, shear = radius * np.cos(twice), radius * np.sin(twice)
        return p * np.eye(3) + np.array([[-normal, 0.0, shear], [0.0, 0.0, 0.0], [shear, 0.0, normal]])


def specimen(density: str, seed: int, grains: int = GRAINS) -> lk.State:
    """A specimen at isotropic stress."""
    friction = DENSITIES[density][0]
    recipe = lk.Recipe(preparation="compression", pressure=PRESSURE, grains=grains, step1_friction=friction, seed=seed)
    return lk.make_specimen(recipe, SCENE, engine=DEVICE, progress=False)


def axial(*strains: float) -> lk.Path:
    """Mean stress held; the axial strain reverses at `strains` and ends at the last."""
    return lk.paths.CyclicConstantMeanStress(pressure=PRESSURE, rate=RATE, reversals=strains)


def held_mean_stress(flow: np.ndarray, strain: float, pressure: float) -> lk.Path:
    """A deviatoric strain rate `flow` (3, 3) in units of RATE, to an accumulated `strain`; the mean stress is held."""
    unit = np.eye(3)[None]
    return lk.paths.Mixed(flow, free=unit, measured=unit / 3.0, target=[pressure], strain=strain, rate=RATE)


def turned(angle: float, strain: float) -> lk.Path:
    """Compression by `strain` along an axis turned about y from z by `angle` degrees; the mean stress is held."""
    axis = np.array([np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])
    flow = 1.5 * np.outer(axis, axis) - 0.5 * np.eye(3)
    return held_mean_stress(flow, strain * np.sqrt(1.5), PRESSURE)


def from_specimen(density: str) -> dict[str, lk.Path]:
    """The tests that begin with the specimen itself, by name."""
    _, amplitude, strain = DENSITIES[density]
    undrained = lk.paths.UndrainedCycles(pressure=PRESSURE, amplitude=amplitude * PRESSURE, cycles=15, rate=RATE)
    shear = lk.paths.ShearCycles(pressure=PRESSURE, strain_amplitude=0.02, cycles=2, rate=RATE)
    common = {"pressure": PRESSURE, "rate": RATE, "strain": strain}
    turns = {f"turn {ratio:g}": TurnAndReturn(stress_ratio=ratio, **common) for ratio in TURNS}
    return {
        "small": axial(*(0.005, -0.005) * 3),
        "large": axial(*LARGE),
        "compression": axial(0.15),
        "extension": axial(-0.15),
        **turns,
        "loops": axial(*LOOPS),
        "shear": shear,
        "undrained": undrained,
    }


def load(state: lk.State, path: lk.Path, interval: float, stop_when: str | None = None) -> tuple[Records, lk.State]:
    """Run a test; returns its records at an interval of the accumulated strain, and the state at its end."""
    ended = ""
    try:
        run = lk.run(
            state, path, engine=DEVICE, progress=False, record_strain=interval, snapshots=10_000, stop_when=stop_when
        )
    except PhysicsError as error:
        run, ended = error.run, str(error)
    return records_of(run, ended), run.state


class Writer:
    """Runs the tests of one specimen that its folder lacks."""

    def __init__(self, folder: Path, density: str, seed: int) -> None:
        """`folder` holds the files of all specimens."""
        self.folder, self.density, self.seed = folder, density, seed

    @functools.cached_property
    def state(self) -> lk.State:
        """The specimen."""
        return specimen(self.density, self.seed)

    def file(self, test: str) -> Path:
        """The file of a test."""
        return self.folder / f"{test.replace(' ', '_')}-{self.density}-s{self.seed}.npz"

    def write(self, test: str, state: Callable[[], lk.State], path: lk.Path, stop_when: str | None = None) -> None:
        """Run a test and write its file, if it is missing."""
        if not self.file(test).exists():
            turning = TURNED * float(path.strain) if isinstance(path, TurnAndReturn) else FINE
            interval = turning if test.startswith(FINELY) else COARSE
            records, _ = load(state(), path, interval, stop_when)
            records.save(self.file(test))
            spent, found = f"{time.process_time():7.1f} s", f"{len(records)} records, I {records.inertial:.2g}"
            print(spent, self.file(test).stem, found, records.ended, flush=True)

    def sheared(self, sign: int) -> lk.State:
        """The specimen after a shear of 5 % and the return to isotropic stress."""
        return self._sheared[sign]

    @functools.cached_property
    def _sheared(self) -> dict[int, lk.State]:
        found = {}
        for sign, label in ((1, "pre+"), (-1, "pre-")):
            records, state = load(self.state, axial(0.05 * sign), COARSE)
            records.save(self.file(label))
            back, stop = axial(-0.02 * sign), "q < 0" if sign > 0 else "q > 0"
            records, state = load(state, back, FINE, stop)
            records.save(self.file(f"back{label[-1]}"))
            found[sign] = lk.consolidate(state.at_rest(), PRESSURE, engine=DEVICE, progress=False, cell="free")
        return found

    def of_fabric(self) -> None:
        """The tests of hidden_fabric.md."""
        for direction, strain in (("compression", 0.03), ("extension", -0.03)):
            path = lk.paths.ConstantVolume(strain=strain, rate=RATE)
            for sign, label in ((1, "pre+"), (-1, "pre-")):
                self.write(f"{label} {direction}", functools.partial(self.sheared, sign), path)
            self.write(f"control {direction}", lambda: self.state, path)

    def of_state(self, first: bool) -> None:
        """The tests of hidden_state.md that are in FIRST, or the others."""
        for test, path in from_specimen(self.density).items():
            if (test in FIRST) == first:
                self.write(test, lambda: self.state, path, "r_u > 0.95" if test == "undrained" else None)
        for angle in (0.0, 45.0, 90.0):
            if (f"again {angle:g}" in FIRST) == first:
                self.write(f"again {angle:g}", functools.partial(self.sheared, 1), turned(angle, 0.05))


def work(folder: Path) -> Iterator[str]:
    """Run everything that the folder lacks, yielding after each specimen."""
    writers = {(density, seed): Writer(folder, density, seed) for seed in SEEDS for density in DENSITIES}
    for (density, seed), writer in writers.items():
        writer.of_state(first=True)
        writer.of_fabric()
        yield f"first {density} s{seed}"
    for seed in FABRIC_SEEDS:
        for density in DENSITIES:
            Writer(folder, density, seed).of_fabric()
            yield f"fabric {density} s{seed}"
    for density, seed in sorted(writers, key=lambda key: key[1] not in HELD_OUT):
        writers[density, seed].of_state(first=False)
        yield f"others {density} s{seed}"
