"""Predict the cyclic tests with the draws of analysis.sand.with_fabric: `python -m analysis.sand.cyclic [FOLDER]`.

FOLDER (default: results/sand) keeps a line per draw and test, and the command continues where it stopped.
With --tests, a copy of the measured tests of analysis.sand.undrained, the measured numbers of cycles are read again.
The plan is the last part of analysis/plans/karlsruhe_with_fabric.md.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas
from scipy.stats import t as student

import labkit as lk
from analysis.sand import undrained
from analysis.sand.karlsruhe import OTHERS, RESULTS
from analysis.sand.with_fabric import FIRST_DRAW, Test, append, drained_of, limits_of, lines_of, repeated, scene_of
from labkit.errors import PhysicsError

STRESS, STRAIN = "TCU - cyclic triaxial test karlsuhe/TCUI", "TCUE - strain cycles large amplitudes/TCUE"
# name: pressure, amplitude of q (kPa), void ratio
STRESS_CYCLES = {
    "TCUI4": (100, 25, 0.961),
    "TCUI10": (100, 30, 0.825),
    "TCUI20": (100, 50, 0.755),
    "TCUI19": (100, 40, 0.761),
    "TCUI18": (100, 30, 0.759),
    "TCUI1": (200, 30, 0.952),
    "TCUI9": (100, 25, 0.798),
    "TCUI8": (100, 20, 0.821),
}
# name: pressure (kPa), amplitude of the axial strain, void ratio
STRAIN_CYCLES = {
    "TCUE1": (200, 0.01, 0.944),
    "TCUE2": (200, 0.01, 0.804),
    "TCUE4": (100, 0.01, 0.812),
    "TCUE6": (200, 0.005, 0.816),
}
# number of cycles to failure, of csrs.m in the folder of the tests
TO_FAILURE = {"TCUI8": 249, "TCUI9": 100, "TCUI10": 15, "TCUI18": 54, "TCUI19": 15, "TCUI20": 6}
LEAST_CYCLES = {"q": 10, "strain": 3}  # of a run, for each kind of amplitude
SHORT = 20  # measured number of cycles of the tests that are repeated first
LONGER, GOAL = 1.5, 1.5  # cycles of a run over the measured number; factor
MEASURED, TABLE = RESULTS / "with_fabric_cycles_measured.json", RESULTS / "with_fabric_cyclic.csv"


def test_of(name: str, cycles: int) -> Test:
    """Return the path, the pressure (Pa) and the void ratio of a test with a number of cycles."""
    path: lk.paths.Path
    if name in STRESS_CYCLES:
        pressure, amplitude, void_ratio = STRESS_CYCLES[name]
        path = lk.paths.UndrainedCycles(amplitude=1e3 * amplitude, cycles=cycles, rate=5)
    else:
        pressure, strain, void_ratio = STRAIN_CYCLES[name]
        path = lk.paths.StrainCycles(strain_amplitude=strain, cycles=cycles, drained=False, rate=5)
    return path, 1e3 * pressure, void_ratio


def measure(folder: Path) -> dict[str, float]:
    """Read the numbers of cycles to r_u = 0.95 of the tests whose curves are in the folder."""
    files = {name: f"{STRESS}{name.removeprefix('TCUI')}.dat" for name in STRESS_CYCLES if name not in TO_FAILURE}
    files |= {name: f"{STRAIN}{name.removeprefix('TCUE')}.dat" for name in STRAIN_CYCLES}
    counts = {}
    for name, file in files.items():
        path, _, void_ratio = test_of(name, 100)
        counts[name] = undrained.measured(folder / file, path, void_ratio).data.lab.liquefaction().cycles_to_ratio
    return counts


def lines_of_draws(draws: Sequence[dict]) -> list[dict]:
    """Return the lines of the test that analysis.sand.with_fabric repeats."""
    ((name, longest),) = ((name, undrained.LONGEST) for name in undrained.CYCLIC)
    counts = [draw["tests"].get(name, {}).get("features", {}).get("cycles to r_u = 0.95") for draw in draws]
    return [
        {"draw": number, "test": "TCUI4", "of": longest, "cycles": count if count < longest else float("nan")}
        for number, count in enumerate(counts)
        if count is not None
    ]


def predict(draws: Sequence[dict], measured: dict[str, float], file: Path) -> None:
    """Repeat each test with each draw, unless the file has it; first the short tests of every draw."""
    done = {(line["draw"], line["test"]) for line in [*lines_of(file), *lines_of_draws(draws)]}
    limits: dict[int, list[float]] = {}
    everything = itertools.product(measured.items(), enumerate(draw["parameters"] for draw in draws))
    for (name, count), (number, parameters) in sorted(
        everything, key=lambda job: (job[0][1] > SHORT, job[1][0], job[0][1])
    ):
        if (number, name) in done:
            continue
        begin, seed = time.process_time(), FIRST_DRAW + number
        longest = max(LEAST_CYCLES["q" if name in STRESS_CYCLES else "strain"], round(LONGER * count))
        row: dict[str, object] = {"draw": number, "test": name, "of": longest}
        try:
            if number not in limits:  # those of the other predictions
                limits[number] = limits_of(drained_of(OTHERS), scene_of(parameters), seed)
            tests = {name: test_of(name, longest)}
            (run,) = dict(repeated(tests, parameters, seed, limits[number])).values()
            liquefaction = run.data.lab.liquefaction()
            row |= {"cycles": liquefaction.cycles_to_ratio, "largest r_u": round(liquefaction.largest_ratio, 3)}
        except PhysicsError as error:
            row["failed"] = str(error)
        append(file, row | {"seconds": round(time.process_time() - begin, 1)})
        print(name, number, row.get("failed", row.get("cycles")), flush=True)


def interval_of(x: np.ndarray) -> tuple[float, float, float]:
    """Return the 90 % interval of a further draw and the geometric mean, (low, mean, high), of logarithms, (n,)."""
    half = student.ppf(0.95, len(x) - 1) * x.std(ddof=1) * np.sqrt(1.0 + 1.0 / len(x))
    return tuple(np.exp([x.mean() - half, x.mean(), x.mean() + half]).tolist())


def table_of(lines: Sequence[dict], measured: dict[str, float]) -> pandas.DataFrame:
    """Tabulate predicted and measured numbers of cycles; a run without liquefaction counts with its length."""
    rows = []
    for name, count in measured.items():
        own = [line for line in lines if line["test"] == name and "failed" not in line]
        if len(own) < 2:
            continue
        reached = [np.isfinite(line["cycles"]) for line in own]
        x = np.log([line["cycles"] if there else line["of"] for line, there in zip(own, reached, strict=True)])
        low, middle, high = interval_of(x)
        pressure, size, void_ratio = (STRESS_CYCLES | STRAIN_CYCLES)[name]
        row: dict[str, object] = {"test": name, "p_0": pressure, "e": void_ratio, "measured": count}
        row["amplitude"] = f"q = {size} kPa" if name in STRESS_CYCLES else f"{100.0 * size:g} %"
        row["criterion"] = "N_f" if name in TO_FAILURE else "r_u = 0.95"
        row |= {"predicted": middle, "low": low, "high": high, "inside": low <= count <= high, "draws": len(x)}
        factor = middle / count
        row |= {"not reached": len(x) - sum(reached), "factor": factor}
        rows.append(row | {"within": 1.0 / GOAL <= factor <= GOAL})
    return pandas.DataFrame(rows)


def summary(table: pandas.DataFrame) -> pandas.DataFrame:
    """Tabulate, for each criterion, the tests near and inside, and the geometric mean factor with its 95 % interval."""
    rows = []
    for criterion, own in table.groupby("criterion", sort=False):
        x = np.log(own["factor"].to_numpy())
        half = student.ppf(0.975, len(x) - 1) * x.std(ddof=1) / np.sqrt(len(x)) if len(x) > 1 else np.nan
        mean, low, high = np.exp([x.mean(), x.mean() - half, x.mean() + half])
        row = {"criterion": criterion, "tests": len(own), "within": int(own["within"].sum())}
        rows.append(row | {"inside": int(own["inside"].sum()), "mean": mean, "low": low, "high": high})
    return pandas.DataFrame(rows)


def main() -> None:
    """Measure, predict, tabulate."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=RESULTS)
    parser.add_argument("--tests", type=Path, help="copy of the measured tests")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.tests is not None:
        MEASURED.write_text(json.dumps(measure(options.tests), indent=1) + "\n")
    measured = json.loads(MEASURED.read_text()) | TO_FAILURE
    file, draws = options.folder / "with_fabric_cycles.jsonl", lines_of(RESULTS / "with_fabric_draws.jsonl")
    predict(draws, measured, file)
    table = table_of([*lines_of_draws(draws), *lines_of(file)], measured)
    table.to_csv(TABLE, index=False, float_format="%.4g")
    print(table.to_string(float_format="%.3g"))


if __name__ == "__main__":
    main()
