"""The specimens and tests of the study, in the order of the plan; can be stopped and resumed."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from pathlib import Path

import labkit as lk

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
OF_CLUMPS = "4 volume"
TESTS = {
    "compression": lk.paths.ConstantMeanStress(pressure=PRESSURE, strain=0.08),
    "extension": lk.paths.ConstantMeanStress(pressure=PRESSURE, strain=-0.08),
    "b": lk.paths.TrueTriaxial(pressure=PRESSURE, b=0.5, strain=0.08),
    "shear": lk.paths.SimpleShear(pressure=PRESSURE, strain=0.16),
    "cyclic": lk.paths.CyclicConstantMeanStress(pressure=PRESSURE, reversals=(0.01, -0.01, 0.02)),
}
FIRST_SEED, ROUNDS, OF_SPHERES_FIRST = 11, 10, 2


@dataclasses.dataclass(frozen=True)
class Cell:
    """Grains of one shape and grading, by their names in the tables, and a seed."""

    shape: str
    grading: str
    seed: int

    @property
    def name(self) -> str:
        """Name in file names."""
        return f"{self.shape}-{self.grading.replace(' ', '_')}-s{self.seed}"

    def specimen(self, device: lk.Fused) -> lk.State:
        """The specimen at rest at PRESSURE."""
        ratio, measure = self.grading.split()
        width, by = float(ratio) ** 0.5, "mass" if measure == "volume" else "number"
        spheres = self.shape == "spheres"
        scene = lk.Scene(
            law="spring_dashpot",
            friction=FRICTION,
            rolling_friction=0.1 if spheres else 0.0,
            time_step_factor=0.3,
            grading=f"uniform smallest={DIAMETER / width}mm largest={DIAMETER * width}mm by={by}",
        )
        recipe = lk.Recipe(
            preparation="compression",
            pressure=PRESSURE,
            grains=2000 if spheres else 500,
            step1_friction=FRICTION_OF_STEP_1,
            step1_rolling_friction=0.1 if spheres else 0.0,
            seed=self.seed,
            shape="sphere" if spheres else CLUMPS[self.shape],
        )
        return lk.make_specimen(recipe, scene, engine=device, progress=False)


def rounds() -> Iterator[list[Cell]]:
    """The rounds of the plan in their order."""
    seeds = range(FIRST_SEED, FIRST_SEED + ROUNDS)
    spheres = [[Cell("spheres", grading, seed) for grading in SPHERES] for seed in seeds]
    clumps = [[Cell(shape, OF_CLUMPS, seed) for shape in CLUMPS] for seed in seeds]
    yield from spheres[:OF_SPHERES_FIRST]
    for k, of_clumps in enumerate(clumps):
        yield of_clumps
        yield from spheres[OF_SPHERES_FIRST + k : OF_SPHERES_FIRST + k + 1]


def simulate(folder: Path) -> None:
    """Make every specimen and run its tests; what is already in the folder is kept. One thread, mixed precision."""
    device = lk.Fused(precision="mixed")
    for cell in (cell for of_round in rounds() for cell in of_round):
        file = folder / f"{cell.name}.state.nc"
        log = folder / f"{cell.name}.failed"
        started = time.process_time()
        try:
            if not file.exists() and not log.exists():
                lk.write_state(file, cell.specimen(device))
            for test, path in TESTS.items() if file.exists() else ():
                target = folder / f"{test}-{cell.name}.run.nc"
                if not (target.exists() and complete(target)):
                    lk.run(
                        lk.read_state(file),
                        path,
                        engine=device,
                        file=target,
                        progress=False,
                        snapshots=SNAPSHOTS,
                        inertial_number=INERTIAL_NUMBER,
                    )
        except lk.PhysicsError as error:
            log.write_text(f"{error}\n", encoding="utf-8")
        print(f"{cell.name}: {time.process_time() - started:.1f} s", flush=True)


def complete(file: Path) -> bool:
    """True if the run of a file has reached the end of its path."""
    with lk.open_run(file) as run:
        return bool(run.attrs["complete"])


def finished(folder: Path) -> list[Path]:
    """Run files of the rounds that are complete; the others are left out, for a balanced set."""
    files: list[Path] = []
    for of_round in rounds():
        of_cells = [folder / f"{test}-{cell.name}.run.nc" for cell in of_round for test in TESTS]
        failed = [(folder / f"{cell.name}.failed").exists() for cell in of_round for _ in TESTS]
        if all(file.exists() or gone for file, gone in zip(of_cells, failed, strict=True)):
            files += [file for file in of_cells if file.exists() and complete(file)]
    return files
