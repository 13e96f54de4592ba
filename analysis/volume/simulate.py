"""The specimens and tests of the study, in the order of the plan; can be stopped and resumed.

Beside the rounds of the plan there are clumps of other size ratios, specimens that both engines shear, and repeated
tests of results/clumps in which `fourth` fails.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import labkit as lk
from analysis import campaigns
from labkit.process import reporter

DIAMETER = 0.17  # geometric mean of the smallest and the largest diameter, mm
PRESSURE = 200e3  # Pa
INERTIAL_NUMBER = 1e-3
SNAPSHOTS = 8
FRICTION, FRICTION_OF_STEP_1 = 0.4, 0.15
SPHERES = ("1.2 volume", "2 volume", "4 volume", "8 volume", "2 number", "4 number", "8 number")
CLUMPS = {
    "rods15": "rod aspect_ratio=1.5",
    "rods20": "rod aspect_ratio=2.0",
    "tetrapods": "tetrapod",
    "mixture": "rod aspect_ratio=1.5, tetrapod",
}
OF_CLUMPS, WIDEST = "4 volume", "8 volume"
OTHER_RATIOS = ("1.2 volume", "2 volume", WIDEST)  # of clumps
TESTS = {
    "compression": lk.paths.ConstantMeanStress(pressure=PRESSURE, strain=0.08),
    "extension": lk.paths.ConstantMeanStress(pressure=PRESSURE, strain=-0.08),
    "b": lk.paths.TrueTriaxial(pressure=PRESSURE, b=0.5, strain=0.08),
    "shear": lk.paths.SimpleShear(pressure=PRESSURE, strain=0.16),
    "cyclic": lk.paths.CyclicConstantMeanStress(pressure=PRESSURE, reversals=(0.01, -0.01, 0.02)),
}
SEEDS, OTHER_SEEDS, OF_SPHERES_FIRST = range(11, 21), range(11, 14), 2
FUSED = lk.Fused(precision="mixed")
ENGINES = {"fused": FUSED, "yade": lk.Yade()}
ON_BOTH = {
    "compression": lk.paths.ConstantMeanStress(pressure=PRESSURE, strain=0.02),
    "extension": lk.paths.ConstantMeanStress(pressure=PRESSURE, strain=-0.02),
}
FAILING = Path(__file__).with_name("failing.yaml")


@dataclasses.dataclass(frozen=True)
class Cell:
    """Grains of one shape and grading, by their names in the tables, and a seed."""

    shape: str
    grading: str
    seed: int
    law: str = "spring_dashpot"
    bodies: int = 500

    @property
    def name(self) -> str:
        """Name in file names."""
        return f"{self.shape}-{self.grading.replace(' ', '_')}-s{self.seed}"

    def specimen(self) -> lk.State:
        """The specimen at rest at PRESSURE."""
        ratio, measure = self.grading.split()
        width, by = float(ratio) ** 0.5, "mass" if measure == "volume" else "number"
        spheres = self.shape == "spheres"
        scene = lk.Scene(
            law=self.law,
            friction=FRICTION,
            rolling_friction=0.1 if spheres else 0.0,
            time_step_factor=0.3,
            grading=f"uniform smallest={DIAMETER / width}mm largest={DIAMETER * width}mm by={by}",
        )
        recipe = lk.Recipe(
            preparation="compression",
            pressure=PRESSURE,
            grains=self.bodies,
            step1_friction=FRICTION_OF_STEP_1,
            step1_rolling_friction=0.1 if spheres else 0.0,
            seed=self.seed,
            shape="sphere" if spheres else CLUMPS[self.shape],
        )
        return lk.make_specimen(recipe, scene, engine=FUSED, progress=False)

    def shear(self, folder: Path, tests: Mapping[str, lk.paths.Path], snapshots: int, engine: str = "") -> None:
        """Make the specimen and run its tests; what is already in the folder stays. `engine`: default FUSED."""
        folder.mkdir(exist_ok=True)
        file = folder / f"{self.name}.state.nc"
        log = folder / f"{self.name}.failed"
        started = time.monotonic()
        try:
            if not file.exists() and not log.exists():
                lk.write_state(file, self.specimen())
            for test, path in tests.items() if file.exists() else ():
                target = folder / f"{test}-{self.name}{engine and f'-{engine}'}.run.nc"
                if not (target.exists() and complete(target)):
                    lk.run(
                        lk.read_state(file),
                        path,
                        engine=ENGINES[engine] if engine else FUSED,
                        file=target,
                        progress=False,
                        snapshots=snapshots,
                        inertial_number=INERTIAL_NUMBER,
                    )
        except lk.PhysicsError as error:
            log.write_text(f"{error}\n", encoding="utf-8")
        print(f"{self.name} {engine}: {time.monotonic() - started:.1f} s", flush=True)


def rounds() -> Iterator[list[Cell]]:
    """The rounds of the plan in their order."""
    spheres = [[Cell("spheres", grading, seed, bodies=2000) for grading in SPHERES] for seed in SEEDS]
    clumps = [[Cell(shape, OF_CLUMPS, seed) for shape in CLUMPS] for seed in SEEDS]
    yield from spheres[:OF_SPHERES_FIRST]
    for k, of_clumps in enumerate(clumps):
        yield of_clumps
        yield from spheres[OF_SPHERES_FIRST + k : OF_SPHERES_FIRST + k + 1]


def rounds_of(grading: str) -> list[list[Cell]]:
    """The rounds of clumps of another grading."""
    bodies = 1000 if grading == WIDEST else 500
    return [[Cell(shape, grading, seed, bodies=bodies) for shape in CLUMPS] for seed in OTHER_SEEDS]


def of_both_engines() -> list[Cell]:
    """The specimens, of a law that both engines have, that both shear."""
    kinds = [*(("spheres", grading) for grading in SPHERES[:3]), ("rods15", OF_CLUMPS)]
    return [Cell(*kind, seed, law="rolling_resistance") for seed in OTHER_SEEDS for kind in kinds]


def simulate(folder: Path) -> None:
    """Make every specimen and run its tests; what is already in the folder stays. One thread, mixed precision."""
    shear(folder, rounds())
    campaigns.simulate(folder / "failing", 1, reporter("tests in which fourth fails"), FAILING)
    for grading in OTHER_RATIOS:
        if grading == WIDEST:
            for cell in of_both_engines():
                for engine in ENGINES:
                    cell.shear(folder / "engines", ON_BOTH, SNAPSHOTS // 2, engine)
        shear(folder, rounds_of(grading))


def shear(folder: Path, rounds: Iterable[list[Cell]]) -> None:
    """Make the specimens of some rounds and run their tests."""
    for of_round in rounds:
        for cell in of_round:
            cell.shear(folder, TESTS, SNAPSHOTS)


def complete(file: Path) -> bool:
    """True if the run of a file has reached the end of its path."""
    with lk.open_run(file) as run:
        return bool(run.attrs["complete"])


def finished(folder: Path) -> list[Path]:
    """Run files of the rounds that are complete; the others are left out, for a balanced set."""
    files: list[Path] = []
    for of_round in [*rounds(), *(of_round for grading in OTHER_RATIOS for of_round in rounds_of(grading))]:
        of_cells = [folder / f"{test}-{cell.name}.run.nc" for cell in of_round for test in TESTS]
        failed = [(folder / f"{cell.name}.failed").exists() for cell in of_round for _ in TESTS]
        if all(file.exists() or gone for file, gone in zip(of_cells, failed, strict=True)):
            files += [file for file in of_cells if file.exists() and complete(file)]
    return files


def finished_on_both(folder: Path) -> list[Path]:
    """Run files of the specimens that both engines have sheared."""
    files: list[Path] = []
    for cell in of_both_engines():
        pairs = [folder / "engines" / f"{test}-{cell.name}-{engine}.run.nc" for test in ON_BOTH for engine in ENGINES]
        if all(file.exists() and complete(file) for file in pairs):
            files += pairs
    return files


def finished_again(folder: Path) -> list[Path]:
    """Run files of the repeated tests that are complete."""
    return [file for file in sorted((folder / "failing" / "runs").glob("*.run.nc")) if complete(file)]
