"""Many small tests at once: tests per hour of labkit.run_many, and the share of processor time in the kernel.

    python benchmarks/many.py                          # CP tests of 1,000 grains to 10 % strain on all cores
    python benchmarks/many.py --tests 20 --workers 1 --precision mixed --path cv

Each round runs the same tests, after a first round that compiles. The kernel is the compiled loop over time steps; the
rest is neighbour searches, records, files and Python. The inertial number is the largest of all tests' records.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

import numpy as np

import labkit as lk
from labkit.engines.fused import FusedEngine


def timed(function: Callable[..., object], seconds: list[float]) -> Callable[..., object]:
    """Return the function; each call adds its processor time, s, to `seconds`."""

    def call(*arguments: object, **options: object) -> object:
        begin = time.thread_time()
        try:
            return function(*arguments, **options)
        finally:
            seconds.append(time.thread_time() - begin)

    return call


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grains", type=int, default=1000)
    parser.add_argument("--tests", type=int, default=10, help="tests in each round")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--strain", type=float, default=0.1)
    parser.add_argument("--path", default="cp", choices=("cp", "cv", "cr"))
    parser.add_argument("--inertial-number", type=float, default=8e-4)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--precision", default="double", choices=("double", "mixed"))
    options = parser.parse_args()

    kinds = {"cp": lk.paths.ConstantMeanStress, "cr": lk.paths.ConstantRadialStress, "cv": lk.paths.ConstantVolume}
    held = {} if options.path == "cv" else {"pressure": "300 kPa"}
    path = kinds[options.path](strain=options.strain, **held)
    states = [
        lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=options.grains, seed=seed), progress=False)
        for seed in range(1, 5)
    ]
    recording = {"precision": options.precision, "inertial_number": options.inertial_number, "snapshots": 1}
    lk.run(states[0], kinds[options.path](strain=0.01, **held), progress=False, **recording)

    kernel: list[float] = []
    FusedEngine._run = timed(FusedEngine._run, kernel)  # type: ignore[method-assign, assignment]
    tests = [(states[number % len(states)], path) for number in range(options.tests)]
    rates, shares = [], []
    for number in range(options.rounds):
        kernel.clear()
        wall, used = time.perf_counter(), time.process_time()
        outcomes = lk.run_many(tests, workers=options.workers, progress=False, **recording)
        wall, used = time.perf_counter() - wall, time.process_time() - used
        rates.append(3600.0 * options.tests / wall)
        shares.append(sum(kernel) / used)
        largest = max(float(outcome.run.data["inertial_number"].max()) for outcome in outcomes if outcome.run)
        print(
            f"round {number}: {wall:6.2f} s, {used:6.2f} s of processors, {rates[-1]:7.0f} tests per hour, "
            f"{3600.0 * options.tests / used:7.0f} per hour of a processor, {shares[-1]:.1%} in the kernel, "
            f"inertial number {largest:.2g}",
            flush=True,
        )
    for name, values in (("tests per hour", rates), ("share in the kernel", shares)):
        print(f"{name}: {np.median(values):.3g} ({min(values):.3g} to {max(values):.3g})")


if __name__ == "__main__":
    main()
