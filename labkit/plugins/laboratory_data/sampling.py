"""Repeats measured tests on grains: turns parameters into points of curves, and stores each sample in a file."""

from __future__ import annotations

import dataclasses
import json
import os
import sys
import time
import warnings
from collections.abc import Mapping
from pathlib import Path as File

import numpy as np

from labkit.errors import InputError, LabkitWarning, PhysicsError, warn
from labkit.files.atomic import name_file_in_errors, require_no_link
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.micro.stress import mean_stress
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.parameters import options_of
from labkit.paths.path import Path
from labkit.plugins.laboratory_data.comparing import curve
from labkit.results.run import Run
from labkit.simulation.api import make_specimen
from labkit.simulation.batch import run_many
from labkit.specimens.bisection import compression_recipe

ALONG = (0.05, 0.1, 0.2, 0.4, 0.7, 1.0)  # points of a curve, as fractions of the strain of the test
SHARES = (0.0, 0.1, 0.3, 1.0)  # fractions of the friction to use during compression, from dense to loose specimens
TOLERANCE = 1e-3  # fraction of the strain of a test: a run may end within a time step of its target
REACH = 0.3  # correlation length of the deviations of a measured curve, as a fraction of the test


@dataclasses.dataclass(frozen=True)
class GrainTests:
    """Measured tests to be simulated with grains whose parameters are free. Raises InputError.

    Args:
        measured: Name -> measured test. Specimens start from the path's pressure or, by default, the first row's.
        free: Parameter of Scene -> lowest and highest value.
        scatter: Quantity of `comparing.CURVES` -> standard deviation between repeated tests, SI.
        scene: Parameters of the grains that are not free.
        limits: e_min and e_max of the sand. If given, specimens have the relative densities of the sand, between the
            densest and loosest specimens of the same grains, and not its void ratios, which spheres may not reach.
    """

    measured: Mapping[str, Run]
    free: Mapping[str, tuple[float, float]]
    scatter: Mapping[str, float]
    scene: Scene = dataclasses.field(default_factory=Scene)
    limits: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Check the names and the ranges."""
        for name, (low, high) in self.free.items():
            if name not in options_of(Scene):
                raise InputError("is not a parameter of the grains", field="free", value=name)
            if not low < high:
                raise InputError(field=name, value=(low, high), allowed="the lowest value before the highest")
            self.grains({name: low}), self.grains({name: high})
        for test in self.measured.values():
            _pressure(test)
        if not (self.measured and self.free and self.scatter):
            raise InputError("tests, free parameters and scatters are needed: give at least one of each")

    def grains(self, parameters: Mapping[str, float]) -> Scene:
        """Return the scene with these parameters replaced."""
        return Scene(**{**self.scene.values(), **parameters})

    @property
    def deviations(self) -> np.ndarray:
        """Covariance (n, n) of the laboratory's scatter: points within a curve are correlated, curves are not."""
        along = np.array(ALONG)
        alike = np.exp(-np.abs(along[:, None] - along) / REACH)
        variances = [deviation**2 for _ in self.measured for deviation in self.scatter.values()]
        return np.kron(np.diag(variances), alike)

    def points(self, runs: Mapping[str, Run]) -> np.ndarray:
        """Return the points of all curves, (n,); `runs`: name of a test -> its run. Raises PhysicsError."""
        points = []
        for name, measured in self.measured.items():
            at = measured.data.lab.abscissa().values[-1] * np.array(ALONG)
            total = measured.data.lab.total
            points += [curve(runs[name], quantity, at * (1.0 - TOLERANCE), total) for quantity in self.scatter]
        values = np.concatenate(points)
        if not np.isfinite(values).all():
            raise PhysicsError("a test ended before its measurement did")
        return values

    def repeat(self, parameters: Mapping[str, float], grains: int, seed: int) -> dict[str, Run]:
        """Repeat every test on grains with these parameters. Raises PhysicsError if a specimen or test fails."""
        tests = {n: (_path(t), float(t.data["void_ratio"][0]), _pressure(t)) for n, t in self.measured.items()}
        return self._test(parameters, tests, grains, seed)

    def test(self, parameters: Mapping[str, float], path: Path, void_ratio: float, grains: int, seed: int) -> Run:
        """Carry out a test that was not measured, at a void ratio of the sand. Raises InputError or PhysicsError."""
        pressure = getattr(path, "pressure", None)
        if pressure is None:
            raise InputError("is missing", field="pressure", allowed="that of the test")
        return self._test(parameters, {"test": (path, void_ratio, pressure)}, grains, seed)["test"]

    def _test(
        self, parameters: Mapping[str, float], tests: Mapping[str, tuple[Path, float, float]], grains: int, seed: int
    ) -> dict[str, Run]:
        """Carry out tests, name -> path, void ratio and pressure. Raises PhysicsError if one of them fails."""
        scene = self.grains(parameters)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LabkitWarning)  # the warning does not apply: small specimens are intended
            pressure = min(map(_pressure, self.measured.values()))
            limits = [void_ratio_nominal(_specimen(scene, s, pressure, grains, seed).snapshot()) for s in SHARES]
            pairs = [
                (_specimen(scene, self._share(e, limits), at, grains, seed), path) for path, e, at in tests.values()
            ]
            outcomes = run_many(pairs, progress=False, snapshots=2)
        runs = {}
        for name, outcome in zip(tests, outcomes, strict=True):
            if outcome.run is None or outcome.failure:
                raise PhysicsError(f"{name}: {outcome.failure}")
            runs[name] = outcome.run
        return runs

    def _share(self, wanted: float, limits: list[float]) -> float:
        """Return the fraction of the friction for a void ratio of the sand; `limits`: void ratios for SHARES."""
        if self.limits is not None:
            low, high = self.limits
            wanted = limits[0] + (wanted - low) / (high - low) * (limits[-1] - limits[0])
        if not limits[0] - 0.02 <= wanted <= limits[-1] + 0.02:
            raise PhysicsError(f"grains have void ratios of {limits[0]:.3f} to {limits[-1]:.3f}, not {wanted:.3f}")
        return float(np.interp(wanted, np.maximum.accumulate(limits), SHARES))


def _path(measured: Run) -> Path:
    if measured.path is None:
        raise InputError(field="path", value=measured.data.attrs["path"], allowed="a path that labkit knows")
    return measured.path


def _pressure(measured: Run) -> float:
    """Return the pressure at which a test starts, Pa. Raises InputError if it is not above 0."""
    pressure = getattr(_path(measured), "pressure", None)
    if pressure is None:
        start = measured.data["stress"].values[0]
        pressure = float(np.nan_to_num(mean_stress(start), nan=start[2, 2]))  # an oedometer has no radial stress
    if not pressure > 0.0:
        raise InputError("is not above 0", field="pressure", value=pressure, allowed="a path with that of the test")
    return float(pressure)


def _specimen(scene: Scene, share: float, pressure: float, grains: int, seed: int) -> State:
    return make_specimen(compression_recipe(share, scene, pressure, grains, seed), scene, progress=False)


@dataclasses.dataclass(frozen=True)
class Sample:
    """One set of parameters and the results of its tests; `points` is None if a test failed.

    Args:
        parameters: Values of the free parameters.
        grains: Number of grains of each specimen.
        seed: Seed of the specimens.
        points: Points of the curves, GrainTests.points.
        failure: Reason why `points` is None.
        seconds: Duration of the simulations, s.
    """

    parameters: dict[str, float]
    grains: int
    seed: int
    points: list[float] | None
    failure: str
    seconds: float


def take_sample(tests: GrainTests, parameters: Mapping[str, float], grains: int, seed: int) -> Sample:
    """Repeat the tests on grains with these parameters; also returns a Sample if a test fails."""
    begin, points, failure = time.perf_counter(), None, ""
    try:
        points = tests.points(tests.repeat(parameters, grains, seed)).tolist()
    except PhysicsError as error:
        failure = str(error)
    return Sample(dict(parameters), grains, seed, points, failure, max(0.0, time.perf_counter() - begin))


def append_sample(sample: Sample, file: str | os.PathLike[str]) -> None:
    """Append a sample to a file with one line of JSON per sample, in place of a last line that was cut off.

    The caller holds the lock of the file (only_writer). Raises InputError if the file is a link.
    """
    require_no_link(file)
    line = json.dumps(dataclasses.asdict(sample)).encode() + b"\n"
    with name_file_in_errors(File(file)), open(file, "ab+") as handle:
        handle.seek(0)
        before = handle.read()
        end = before.rfind(b"\n") + 1
        handle.truncate(end)
        handle.write(_whole_lines(before)[end:] + line)
        handle.flush()
        os.fsync(handle.fileno())


def read_samples(tests: GrainTests, file: str | os.PathLike[str]) -> list[Sample]:
    """Read the samples in a file, if it exists; a last line that was cut off is left out, with a warning.

    Raises InputError for an invalid line, and for samples of different tests or parameters.
    """
    try:
        content = File(file).read_bytes()
    except FileNotFoundError:
        return []
    whole = _whole_lines(content)
    if len(whole) < len(content):
        warn(f"{file}: its last line was cut off, and its sample is computed again")
    lines = enumerate(whole.decode(errors="replace").split("\n"), start=1)
    samples = {number: _sample_of(line, f"{file} line {number}") for number, line in lines if line.strip()}
    size = len(tests.deviations)
    for number, sample in samples.items():
        if set(sample.parameters) != set(tests.free) or (sample.points is not None and len(sample.points) != size):
            raise InputError(f"{file} line {number} is a sample of other tests or parameters: give another file")
    return list(samples.values())


def _whole_lines(content: bytes) -> bytes:
    """Return the content of a file of samples without a last line that was cut off."""
    last = content[content.rfind(b"\n") + 1 :]
    try:
        json.loads(last)  # an editor may leave out the last newline
    except (ValueError, RecursionError):
        return content.removesuffix(last)
    return content + b"\n"


def _sample_of(line: str, where: str) -> Sample:
    """Return the sample in a line of JSON; `where` names the line in errors. Raises InputError."""
    try:
        sample = Sample(**json.loads(line))
        checks = {
            "parameters": all(map(_is_number, sample.parameters.values())),
            "grains": type(sample.grains) is int and sample.grains > 0,
            "seed": type(sample.seed) is int and sample.seed >= 0,
            "points": sample.points is None or all(map(_is_number, sample.points)),
            "failure": isinstance(sample.failure, str),
            "seconds": _is_number(sample.seconds),
        }
    except (ValueError, TypeError, AttributeError, RecursionError):
        raise InputError(f"{where} is not a sample: delete the line, or give another file") from None
    wrong = [name for name, right in checks.items() if not right]
    if wrong:
        raise InputError(f"{where}: {wrong[0]} is not valid: delete the line, whose sample is then computed again")
    return sample


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and type(value) is not bool and abs(value) <= sys.float_info.max
