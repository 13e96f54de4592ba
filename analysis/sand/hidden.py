"""Are hidden parameters recovered? `python -m analysis.sand.hidden`, after analysis.sand.karlsruhe.

Each stored sample that fills the ranges is taken as a sand with hidden parameters, tested on its own specimens; the
other samples calibrate it. With `--grainlearning PYTHON`, an interpreter that has GrainLearning, that library weights
the same samples (grainlearning_weights.py).
"""

from __future__ import annotations

import argparse
import dataclasses
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas
from scipy.stats import t as student

import labkit as lk
from analysis.sand.karlsruhe import FREE, RESULTS, USED, grain_tests
from labkit.plugins.laboratory_data import Sample, posterior_of, read_samples

LEVELS = (0.05, 0.5, 0.95)
FILLING = 20  # first samples, which fill the ranges
LOW, HIGH = np.array([*FREE.values()]).T

Method = Callable[[Sequence[Sample], np.ndarray], np.ndarray]  # samples, points -> quantiles (3, parameters), 0 to 1


@dataclasses.dataclass(frozen=True)
class HiddenSand(lk.GrainTests):
    """The tests on a sand with given measured points."""

    given: tuple[float, ...] = ()

    def points(self, runs: object) -> np.ndarray:
        return np.array(self.given)


def place(sample: Sample) -> np.ndarray:
    """Parameters of a sample as shares of their ranges."""
    return (np.array([sample.parameters[name] for name in FREE]) - LOW) / (HIGH - LOW)


def calibrated(samples: Sequence[Sample], points: np.ndarray) -> np.ndarray:
    """Quantiles of labkit.calibrate_grains."""
    tests = grain_tests(USED)
    fields = {one.name: getattr(tests, one.name) for one in dataclasses.fields(tests)}
    draws = posterior_of(HiddenSand(**fields, given=tuple(points)), samples).draws
    return np.quantile((draws[[*FREE]].to_numpy() - LOW) / (HIGH - LOW), LEVELS, axis=0)


def least_squares(samples: Sequence[Sample], points: np.ndarray) -> np.ndarray:
    """Plain least squares on curves that depend linearly on the parameters; intervals by Student's t of the fit."""
    scale = np.sqrt(np.diag(grain_tests(USED).deviations))
    x, y = np.array([place(one) for one in samples]), np.array([one.points for one in samples]) / scale
    slopes = np.linalg.lstsq(np.column_stack([np.ones(len(x)), x]), y, rcond=None)[0]
    difference = points / scale - slopes[0]
    best = np.linalg.lstsq(slopes[1:].T, difference, rcond=None)[0]
    freedom = len(difference) - len(best)
    variance = np.sum((difference - slopes[1:].T @ best) ** 2) / freedom
    half = student.ppf(0.95, freedom) * np.sqrt(variance * np.diag(np.linalg.inv(slopes[1:] @ slopes[1:].T)))
    return np.clip([best - half, best, best + half], 0.0, 1.0)


def weighted(python: str) -> Method:
    """Return GrainLearning's weights of the same samples as a method."""

    def method(samples: Sequence[Sample], points: np.ndarray) -> np.ndarray:
        scale = np.sqrt(np.diag(grain_tests(USED).deviations))
        x = np.array([place(one) for one in samples])
        with tempfile.TemporaryDirectory() as folder:
            np.savez(
                f"{folder}/in.npz", x=x, y=np.array([one.points for one in samples]) / scale, measured=points / scale
            )
            script = Path(__file__).with_name("grainlearning_weights.py")
            subprocess.run([python, script, folder], check=True, capture_output=True)
            weights = np.load(f"{folder}/weights.npy")
        order = np.argsort(x, axis=0)
        return np.array(
            [
                np.interp(LEVELS, np.cumsum(weights[o]) - 0.5 * weights[o], values[o])
                for o, values in zip(order.T, x.T, strict=True)
            ]
        ).T

    return method


def main() -> None:
    """Compare the methods, and write results/sand/hidden.csv."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--grainlearning", metavar="PYTHON")
    options = parser.parse_args()
    methods: dict[str, Method] = {"calibrate_grains": calibrated, "least squares": least_squares}
    if options.grainlearning:
        methods["GrainLearning"] = weighted(options.grainlearning)
    samples = [one for one in read_samples(grain_tests(USED), RESULTS / "samples.jsonl") if one.points][:FILLING]
    rows = []
    for number in (10, len(samples) - 1):
        for name, method in methods.items():
            begin = time.perf_counter()
            found, hidden = [], np.array([place(one) for one in samples])
            for k, one in enumerate(samples):
                others = [*samples[k + 1 :], *samples[:k]][:number]
                found.append(method(others, np.array(one.points)))
            low, middle, high = np.swapaxes(found, 0, 1)
            inside = (low <= hidden) & (hidden <= high)
            seconds = np.mean([one.seconds for one in samples]) * number
            row = {"method": name, "samples": number, "inside": inside.sum(), "of": inside.size}
            row |= {f"error of {p}": e for p, e in zip(FREE, np.abs(middle - hidden).mean(axis=0), strict=True)}
            row |= {f"width of {p}": w for p, w in zip(FREE, (high - low).mean(axis=0), strict=True)}
            inference = (time.perf_counter() - begin) / len(samples)
            rows.append({**row, "minutes of tests": seconds / 60.0, "seconds of inference": inference})
    table = pandas.DataFrame(rows)
    table.to_csv(RESULTS / "hidden.csv", index=False, float_format="%.3g")
    print(table.to_string(index=False, float_format="%.3g"))


if __name__ == "__main__":
    main()
