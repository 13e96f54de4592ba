"""Calibrate grains with a fabric on drained and undrained tests: `python -m analysis.sand.with_fabric [FOLDER]`.

FOLDER (default: results/sand) keeps samples, draws and synthetic sands; each run continues where the last one stopped.
The plan is analysis/plans/karlsruhe_with_fabric.md; analysis.sand.with_fabric_table writes the tables.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

import labkit as lk
from analysis.sand import karlsruhe, undrained
from analysis.sand.karlsruhe import LIMITS, OTHERS, RESULTS, SCATTER, USED, grain_tests
from labkit.errors import PhysicsError
from labkit.micro import void_ratio_nominal
from labkit.plugins.laboratory_data import Sample, read_samples

FREE = {
    "friction": (0.2, 0.8),
    "rolling ratio": (0.05, 2.0),  # rolling friction over friction
    "log10 of E": (8.0, 9.3),  # E in Pa
    "log2 of g": (-1.0, 1.5),  # g: exponent of the relative density
    "shear": (-0.01, 0.01),  # axial strain before the test
}
DRAINED = "drained"  # the tests of USED
TRAINED, LEFT = "200 kPa, e = 0.814", "200 kPa, e = 0.853, extension"  # undrained tests of the samples
SAMPLES, GRAINS, DRAWS, SANDS = 60, 300, 8, 10
FIRST_DRAW, FIRST_SAND, SANDS_SEED = 4001, 5000, 41  # seeds
LAW = lk.Scene().law
SHARES = (0.0, 0.1, 0.3, 1.0)  # of the friction during compression, from dense to loose
LEAST_Q = 0.02  # of p_0: below, q counts as this
DEVIATIONS = (0.03, 0.03, 0.05)  # of the features of an undrained test
UNUSED = 1e3  # factor of the deviations of tests that do not count
RATE = 20  # 1/s
Test = tuple[lk.paths.Path, float, float]  # path, pressure in Pa, void ratio of the sand
DEVICE = lk.Fused(threads=1, precision="mixed")


def scene_of(parameters: Mapping[str, float], law: str = LAW) -> lk.Scene:
    """Return the grains of a set of parameters."""
    friction = parameters["friction"]
    return lk.Scene(
        law=law,
        friction=friction,
        rolling_friction=friction * parameters["rolling ratio"],
        young_modulus=10.0 ** parameters["log10 of E"],
        time_step_factor=0.3,
    )


def compressed(scene: lk.Scene, share: float, pressure: float, seed: int) -> lk.State:
    """Return a deposited specimen at an isotropic stress, with a share of the friction during its compression."""
    recipe = lk.Recipe(
        preparation="compression",
        pressure=pressure,
        step1_friction=share * scene.friction,
        step1_rolling_friction=share * scene.rolling_friction,
        grains=GRAINS,
        fabric="deposited",
        seed=seed,
    )
    return lk.make_specimen(recipe, scene, engine=DEVICE, progress=False)


def sheared(state: lk.State, strain: float, pressure: float) -> lk.State:
    """Return the specimen at its isotropic stress after a shear to a strain, and back to q = 0."""
    path = lk.paths.ConstantMeanStress(pressure=pressure, strain=strain, rate=RATE)
    run = lk.run(state, path, engine=DEVICE, progress=False, snapshots=2)
    if run.data.lab.q()[-1] * strain > 0.0:  # stiff grains may start with as much q of the other sign
        back = dataclasses.replace(path, strain=-2.0 * strain)
        stop = "q < 0" if strain > 0.0 else "q > 0"
        often = abs(strain) / 50.0
        run = lk.run(run.state, back, engine=DEVICE, progress=False, snapshots=2, stop_when=stop, record_strain=often)
    return lk.consolidate(run.state.at_rest(), pressure, engine=DEVICE, progress=False)


def share_at(parameters: Mapping[str, float], void_ratio: float, limits: list[float]) -> float:
    """Return the share of the friction with the density of the sand at a void ratio; limits: those of SHARES."""
    density = np.clip((LIMITS[1] - void_ratio) / (LIMITS[1] - LIMITS[0]), 0.0, 1.0)
    wanted = limits[-1] - density ** (2.0 ** parameters["log2 of g"]) * (limits[-1] - limits[0])
    return float(np.interp(wanted, np.maximum.accumulate(limits), SHARES))


def limits_of(tests: Mapping[str, Test], scene: lk.Scene, seed: int) -> list[float]:
    """Return the void ratios of specimens made with SHARES, at the lowest pressure of the tests."""
    lowest = min(pressure for _, pressure, _ in tests.values())
    specimens = (compressed(scene, share, lowest, seed) for share in SHARES)
    return [void_ratio_nominal(state.snapshot()) for state in specimens]


def repeated(
    tests: Mapping[str, Test], parameters: Mapping[str, float], seed: int, limits: list[float], law: str = LAW
) -> Iterator[tuple[str, lk.Run]]:
    """Yield the name and the run of each test; limits: void ratios of SHARES. Raises PhysicsError."""
    scene = scene_of(parameters, law)
    for name, (path, pressure, void_ratio) in tests.items():
        specimen = compressed(scene, share_at(parameters, void_ratio, limits), pressure, seed)
        specimen = sheared(specimen, parameters["shear"], pressure)
        stop = "r_u > 0.95" if path.cyclic else None
        yield name, lk.run(specimen, path, engine=DEVICE, progress=False, snapshots=2, stop_when=stop)


def undrained_of(name: str) -> Test:
    """Return the path, the pressure (Pa) and the void ratio of an undrained test."""
    pressure = 1e3 * float(name.split()[0])
    if name in undrained.CYCLIC:
        path = lk.paths.UndrainedCycles(amplitude="25 kPa", cycles=undrained.LONGEST, rate=5)
        return path, pressure, undrained.CYCLIC[name][1]
    _, void_ratio, sign = undrained.MONOTONIC[name]
    return lk.paths.ConstantVolume(strain=sign * undrained.STRAIN, rate=RATE), pressure, void_ratio


def drained_of(pressures: Mapping[str, int]) -> dict[str, Test]:
    """Return path, pressure (Pa) and void ratio of drained tests, name -> pressure (kPa)."""
    measured = grain_tests(dict(pressures)).measured
    return {
        name: (run.path, 1e3 * pressures[name], float(run.data["void_ratio"][0]))
        for name, run in measured.items()
        if run.path is not None
    }


def undrained_points(features: Mapping[str, float], pressure: float) -> list[float]:
    """Return what is compared of an undrained test: least p/p_0, largest |q/p|, ln of |q|/p_0 at 3 %."""
    least, ratio, q = features.values()
    return [least, ratio, float(np.log(max(1e3 * q / pressure, LEAST_Q)))]


@dataclasses.dataclass(frozen=True)
class FabricTests(lk.GrainTests):
    """The drained tests of USED and two undrained ones, of which only features are measured.

    Args:
        trained: Tests that count, DRAINED or names of undrained ones; a sample repeats all.
        points_measured: Measured points, if not those of the sand: of a synthetic sand.
        law: Contact law of the grains.
    """

    trained: tuple[str, ...] = (DRAINED, TRAINED)
    points_measured: tuple[float, ...] = ()
    law: str = LAW

    def __post_init__(self) -> None:
        """Leave out the check that parameters are those of a scene."""

    @property
    def deviations(self) -> np.ndarray:
        drained = super().deviations * (1.0 if DRAINED in self.trained else UNUSED**2)
        scales = [1.0 if name in self.trained else UNUSED for name in (TRAINED, LEFT)]
        rest = np.square(np.outer(scales, DEVIATIONS).ravel())
        return np.block(
            [[drained, np.zeros((len(drained), len(rest)))], [np.zeros((len(rest), len(drained))), np.diag(rest)]]
        )

    def points(self, runs: Mapping[str, lk.Run]) -> np.ndarray:
        if runs is self.measured and self.points_measured:
            return np.array(self.points_measured)
        values = [super().points(runs)]
        stored = json.loads(undrained.MEASURED.read_text()) if runs is self.measured else {}
        for name in (TRAINED, LEFT):
            features = stored.get(name) or undrained.features(undrained.curves(runs[name]))
            values.append(np.array(undrained_points(features, undrained_of(name)[1])))
        return np.concatenate(values)

    def repeat(self, parameters: Mapping[str, float], grains: int, seed: int) -> dict[str, lk.Run]:
        tests = drained_of(USED) | {name: undrained_of(name) for name in (TRAINED, LEFT)}
        limits = limits_of(tests, scene_of(parameters, self.law), seed)
        return dict(repeated(tests, parameters, seed, limits, self.law))


def fabric_tests(trained: tuple[str, ...] = (DRAINED, TRAINED), points_measured: Sequence[float] = ()) -> FabricTests:
    """Return the tests of a sample."""
    measured = grain_tests(USED).measured
    return FabricTests(measured, FREE, SCATTER, trained=trained, points_measured=tuple(points_measured))


def features_of(name: str, run: lk.Run) -> dict[str, object]:
    """Return the features of a test."""
    if name in OTHERS:
        return {"features": karlsruhe.features(karlsruhe.curves(run))}
    return {"features": undrained.features(undrained.curves(run))}


def lines_of(file: Path) -> list[dict]:
    """Return the lines of a file of JSON."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def append(file: Path, row: Mapping[str, object]) -> None:
    """Append a line to a file of JSON."""
    with file.open("a") as stream:
        stream.write(json.dumps(row) + "\n")


def predict(posterior: lk.Posterior, file: Path) -> None:
    """Repeat all tests with the draws that the file lacks; a test that fails is stored with its reason."""
    names = [*undrained.MONOTONIC, *undrained.CYCLIC]
    tests = drained_of(OTHERS) | {name: undrained_of(name) for name in names}
    for number, parameters in list(enumerate(posterior.some(DRAWS)))[len(lines_of(file)) :]:
        begin, results = time.process_time(), dict[str, dict[str, object]]()
        limits = limits_of(tests, scene_of(parameters), FIRST_DRAW + number)
        for name, test in tests.items():
            try:
                (run,) = dict(repeated({name: test}, parameters, FIRST_DRAW + number, limits)).values()
                results[name] = features_of(name, run)
            except PhysicsError as error:
                results[name] = {"failed": str(error)}
        append(file, {"parameters": parameters, "tests": results, "seconds": time.process_time() - begin})
        print(f"draw {number + 1} of {DRAWS}", flush=True)


def make_sands(file: Path) -> None:
    """Test the synthetic sands that the file lacks: parameters drawn from the prior, each on its own specimens."""
    tests, (low, high) = fabric_tests(), np.array([*FREE.values()]).T
    drawn = np.random.default_rng(SANDS_SEED).uniform(low, high, (SANDS, len(FREE)))
    for number in range(len(read_samples(tests, file)), SANDS):
        parameters, seed = dict(zip(FREE, drawn[number].tolist(), strict=True)), FIRST_SAND + number
        begin, points, failure = time.process_time(), None, ""
        try:
            points = tests.points(tests.repeat(parameters, GRAINS, seed)).tolist()
        except PhysicsError as error:
            failure = str(error)
        sand = Sample(parameters, GRAINS, seed, points, failure, time.process_time() - begin)
        append(file, dataclasses.asdict(sand))
        print(f"sand {number + 1} of {SANDS}", flush=True)


def main() -> None:
    """Calibrate, predict, test the synthetic sands."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=RESULTS)
    parser.add_argument("--samples", type=int, default=SAMPLES)
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # small specimens are intended
    options.folder.mkdir(parents=True, exist_ok=True)
    posterior = lk.calibrate_grains(
        fabric_tests(),
        options.samples,
        file=options.folder / "with_fabric_samples.jsonl",
        progress=lambda done, text: print(text, flush=True),
        grains=GRAINS,
        largest=GRAINS,
    )
    print(posterior.table().to_string(float_format="%.4g"), flush=True)
    predict(posterior, options.folder / "with_fabric_draws.jsonl")
    make_sands(options.folder / "with_fabric_sands.jsonl")


if __name__ == "__main__":
    main()
