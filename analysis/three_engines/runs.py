"""The tests of the study: CV, CR and CP on specimens of equal grains, on every engine that has the contact law.

No contact law is on all three engines. The spring-dashpot law is on fused and LAMMPS, the rolling-resistance law on
fused and YADE; fused therefore connects the two others. All specimens have sixteen grain sizes, as LAMMPS requires,
and are made and consolidated on fused, so that both engines of a law start from the same state. The tests on 1,000
grains are in the folder `n1000`.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import labkit as lk
from analysis.campaigns import ended
from labkit.engines import Progress

CLASSES, VOID_RATIO = 16, 0.67
PRESSURE, STRAIN, RATE = 1e6, 0.10, 25.0  # Pa, axial strain, 1/s
RECORD = 0.0025  # axial strain between two records
PATHS = {
    "cv": lk.paths.ConstantVolume(strain=STRAIN, rate=RATE),
    "cr": lk.paths.ConstantRadialStress(pressure=PRESSURE, strain=STRAIN, rate=RATE),
    "cp": lk.paths.ConstantMeanStress(pressure=PRESSURE, strain=STRAIN, rate=RATE),
}
OTHER = {"spring_dashpot": "lammps", "rolling_resistance": "yade"}  # law -> engine compared with fused


@dataclasses.dataclass(frozen=True)
class Test:
    """One run of the study."""

    grains: int
    path: str
    seed: int
    engine: str
    law: str

    def file(self, folder: Path) -> Path:
        """Its run file."""
        return folder / f"n{self.grains}" / f"{self.path}-s{self.seed}-{self.engine}-{self.law}.run.nc"


def tests(grains: int, seeds: int, on_fused: int) -> Iterator[Test]:
    """All tests on specimens 1 to `seeds` with this number of grains, and on fused also those up to `on_fused`."""
    for seed in range(1, max(seeds, on_fused) + 1):
        for law, other in OTHER.items():
            for engine in ("fused", other) if seed <= seeds else ("fused",):
                for path in PATHS:
                    yield Test(grains, path, seed, engine, law)


def finished(folder: Path) -> list[Test]:
    """All tests in the folder that are complete, by number of grains, seed, engine and path."""
    found = []
    for file in folder.glob("n*/*.run.nc"):
        name = re.fullmatch(r"(\w+)-s(\d+)-(\w+)-(\w+)\.run\.nc", file.name)
        if name and file.parent.name[1:].isdigit() and ended(file):
            found.append(Test(int(file.parent.name[1:]), name[1], int(name[2]), name[3], name[4]))
    return sorted(found, key=lambda test: (test.grains, test.seed, test.law, test.engine, list(PATHS).index(test.path)))


def specimen(folder: Path, grains: int, seed: int, law: str) -> lk.State:
    """The specimen at 1 MPa, from its file if it exists."""
    file = folder / f"n{grains}" / f"s{seed}-{law}-1MPa.state.nc"
    if not file.exists():
        recipe = lk.Recipe(void_ratio=VOID_RATIO, grains=grains, size_classes=CLASSES, seed=seed)
        made = lk.make_specimen(recipe, lk.Scene(law=law), progress=False)
        file.parent.mkdir(exist_ok=True)
        lk.consolidate(made, PRESSURE, file=file, progress=False)
    return lk.read_state(file)


def simulate(folder: Path, sizes: Sequence[int], seeds: int, on_fused: int, progress: Progress) -> None:
    """Run all tests that are not finished. Raises InputError if an engine is missing, PhysicsError if a test fails."""
    planned = [test for grains in sizes for test in tests(grains, seeds, on_fused)]
    for number, test in enumerate(planned):
        file = test.file(folder)
        progress(number / len(planned), f"{file.parent.name}/{file.name}")
        lk.run(
            specimen(folder, test.grains, test.seed, test.law),
            PATHS[test.path],
            engine=test.engine,
            file=file,
            progress=False,
            record_strain=RECORD,
            snapshots=4,
        )
    progress(1.0, f"{len(planned)} tests finished")
