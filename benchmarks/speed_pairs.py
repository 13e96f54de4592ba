"""Speed of whole commands in two checkouts of labkit, measured alternately.

    python benchmarks/speed_pairs.py BEFORE AFTER
    python benchmarks/speed_pairs.py BEFORE AFTER --grains 1000 --rounds 3 --strain 0.005 --only cv help

BEFORE and AFTER are folders that contain labkit/. Each command starts a new Python. In each round it runs once in each
checkout, in alternating order; the first run of each, which compiles, is not counted. Modules are compiled once, as in
an installation, even if PYTHONDONTWRITEBYTECODE is set. Ratios are AFTER to BEFORE in the same round: below 1, AFTER
is faster.
"""

from __future__ import annotations

import argparse
import itertools
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

Times = tuple[float, float]  # wall and CPU time of a command, s
ENGINES = ("fused", "fused --precision mixed", "yade")
COLD = "first run, no compiled code"


def time_command(checkout: Path, words: str, folder: Path, environment: Mapping[str, str] | None = None) -> Times:
    """Measure wall and CPU time of a labkit command in a checkout, s. Raises RuntimeError if it fails."""
    own = {"PYTHONPATH": str(checkout), "NUMBA_CACHE_DIR": str(folder / "compiled"), **(environment or {})}
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "labkit.cli", *words.split()],
        cwd=folder,
        env={**kept, **own},
        stdout=subprocess.DEVNULL,
        stderr=(folder / "stderr").open("w"),
    )
    _, status, used = os.wait4(process.pid, 0)
    times = time.perf_counter() - start, used.ru_utime + used.ru_stime
    if status:
        raise RuntimeError(f"{checkout}: labkit {words}: {(folder / 'stderr').read_text()}")
    return times


def loading(folder: Path, path: str, grains: int, strain: float, engine: str) -> Callable[[Path], Times]:
    """Return a test of a specimen as a function of the checkout; `engine` is its name and options."""
    output = folder / "r.run.nc"
    words = f"run {path} {grains}.state.nc --strain {strain} -o {output} --engine {engine}"

    def measure(checkout: Path) -> Times:
        output.unlink(missing_ok=True)
        return time_command(checkout, words, folder)

    return measure


def first_run(folder: Path, grains: int) -> Callable[[Path], Times]:
    """Return a short test that compiles everything it needs."""
    output = folder / "r.run.nc"
    words = f"run cv {grains}.state.nc --engine fused --strain 0.001 -o {output}"

    def measure(checkout: Path) -> Times:
        output.unlink(missing_ok=True)
        with tempfile.TemporaryDirectory() as empty:
            return time_command(checkout, words, folder, {"NUMBA_CACHE_DIR": empty})

    return measure


def variants(folder: Path, options: argparse.Namespace) -> dict[str, Callable[[Path], Times]]:
    """Return the measurements by name."""
    found: dict[str, Callable[[Path], Times]] = {"help": lambda checkout: time_command(checkout, "--help", folder)}
    for grains in options.grains:
        for path, engine in itertools.product(("cv", "cp"), ENGINES):
            strain = options.yade_strain if engine == "yade" else options.strain
            found[f"{path}, {grains} grains, {engine}"] = loading(folder, path, grains, strain, engine)
    return found | {COLD: first_run(folder, options.grains[0])}


def report(name: str, before: list[Times], after: list[Times]) -> str:
    """Return one line with medians, and the median and range of the ratios of the rounds."""
    line = f"{name:42}"
    for kind, label in enumerate(("wall", "cpu")):
        one, other = ([times[kind] for times in measured] for measured in (before, after))
        ratios = sorted(b / a for a, b in zip(one, other, strict=True))
        line += f" {label} {np.median(one):7.3f} -> {np.median(other):7.3f} s, "
        line += f"ratio {np.median(ratios):.3f} ({ratios[0]:.3f}-{ratios[-1]:.3f})"
    return line


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkouts", nargs=2, type=Path, metavar=("BEFORE", "AFTER"))
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--strain", type=float, default=0.02, help="axial strain of each test")
    parser.add_argument("--yade-strain", type=float, default=0.002, help="the same on YADE, which is slower")
    parser.add_argument("--grains", type=int, nargs="+", default=[1000, 14331])
    parser.add_argument("--only", nargs="+", default=[""], metavar="NAME", help="start of the names of what to measure")
    options = parser.parse_args()
    before, after = map(Path.resolve, options.checkouts)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for grains in options.grains:
            time_command(
                before, f"specimen --void-ratio 0.67 --grains {grains} --engine fused -o {grains}.state.nc", folder
            )
        for name, measure in variants(folder, options).items():
            if not name.startswith(tuple(options.only)):
                continue
            if name != COLD:
                measure(before), measure(after)
            times: dict[Path, list[Times]] = {before: [], after: []}
            for turn in range(options.rounds):
                for checkout in (before, after) if turn % 2 else (after, before):
                    times[checkout].append(measure(checkout))
            print(report(name, times[before], times[after]), flush=True)


if __name__ == "__main__":
    main()
