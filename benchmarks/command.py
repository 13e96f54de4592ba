"""The commands bench, bench-statistics, model-speed and umat-speed."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, NamedTuple

import pandas

from labkit.cli.arguments import Option, one_of
from labkit.cli.outputs import write_table
from labkit.cli.registry import command
from labkit.engines.base import Progress
from labkit.files.provenance import write_with_provenance
from labkit.files.writable import require_writable
from labkit.grains.state import State
from labkit.grains.state_file import read_state
from labkit.process.progress import reporter


class Asked(NamedTuple):
    """The measurement requested: a state file, steps per measurement, rounds, and axial strain of whole commands."""

    specimen: str
    steps: int
    rounds: int
    strain: float


def fraction(text: str) -> float:
    """Convert text to a number above 0 and at most 1."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0 and at most 1")
    return value


Result = tuple[str, pandas.DataFrame | None]  # the text to print, and the table for --csv


def _engines(asked: Asked, state: State, progress: Progress) -> Result:
    from benchmarks.engines import bench, table
    from labkit.paths.rates import default_rate
    from labkit.paths.standard import ConstantVolume

    results = bench(asked.specimen, asked.steps, asked.rounds, progress)
    rate = default_rate(ConstantVolume, state.scene)
    return table(results, state.number_of_grains, state.time_step, rate), None


def _commands(asked: Asked, state: State, progress: Progress) -> Result:
    from benchmarks.commands import commands, summary

    speeds = commands(asked.specimen, asked.strain, asked.steps, asked.rounds, progress)
    return summary(speeds, state.number_of_grains), speeds


def _features(asked: Asked, state: State, progress: Progress) -> Result:
    from benchmarks.kernel import features

    return features(state, asked.steps, asked.rounds, progress), None


def _laws(asked: Asked, state: State, progress: Progress) -> Result:
    from benchmarks.laws import laws

    return laws(state, asked.steps, asked.rounds, progress), None


def _sizes(asked: Asked, state: State, progress: Progress) -> Result:
    from benchmarks.sizes import sizes

    speeds = sizes(state, asked.steps, progress)
    return speeds.to_string(index=False, float_format="%.1f"), speeds


def _threads(asked: Asked, state: State, progress: Progress) -> Result:
    from benchmarks.threads import threads

    return threads(asked.specimen, 10 * asked.steps, asked.rounds, progress), None


BENCHMARKS: dict[str, Callable[[Asked, State, Progress], Result]] = {
    "engines": _engines,
    "commands": _commands,
    "features": _features,
    "laws": _laws,
    "sizes": _sizes,
    "threads": _threads,
}


@command("bench", "compare the speed of YADE, labkit's engines and LAMMPS")
def bench_command(
    specimen: Annotated[str, Option("state file")],
    *,
    what: Annotated[
        str,
        Option(
            "compare engines (default), whole commands `labkit run cv` with LAMMPS, features of the fused engine by "
            "their cost, contact laws, specimens of several sizes, or threads of the fused engine on free and busy "
            "cores",
            f"{{{','.join(BENCHMARKS)}}}",
            type=one_of(BENCHMARKS),
        ),
    ] = "engines",
    steps: Annotated[int, Option("steps per measurement")] = 500,
    rounds: Annotated[int, Option("number of rounds; each round measures every variant once")] = 5,
    strain: Annotated[float, Option("axial strain of whole commands", "E", type=fraction)] = 0.1,
    csv: Annotated[str | None, Option("also write the table of `commands` or `sizes` as CSV", "FILE")] = None,
) -> None:
    """Measures the speed of a CV test with a stock YADE script, labkit's engines and LAMMPS, if installed.

    Prints a table.

    Examples:
        ./lab bench s.state.nc --steps 500
        ./lab bench s.state.nc --what sizes --csv sizes.csv  # specimens of several sizes
    """
    text, table = BENCHMARKS[what](Asked(specimen, steps, rounds, strain), read_state(specimen), reporter("bench"))
    print(text)
    if table is not None:
        write_table(table, csv, [specimen], digits=6 if what == "commands" else 4)


@command("bench-statistics", "measure the speed and memory of the statistics of a run")
def bench_statistics_command(run: Annotated[str, Option("run file")]) -> None:
    """Measures the time and memory of each statistic of a run.

    Prints a table.

    Example:
        ./lab bench-statistics r.run.nc
    """
    from benchmarks.statistics import bench_statistics

    print(bench_statistics(run).to_string(index=False, float_format="%.2f", na_rep=""))


@command("model-speed", "measure time and error of the model's integrators")
def model_speed_command(*, output: Annotated[str, Option("existing folder", "FOLDER")] = "results") -> None:
    """Measures time and error of the integrators of the constitutive model.

    Prints a table, and writes it to model_speed.txt and a figure to model_speed.png.

    Example:
        ./lab model-speed -o measured
    """
    from benchmarks.model import measure_all

    require_writable(Path(output) / "labkit")
    print(measure_all(Path(output)))


@command("umat-speed", "measure the speed of the compiled material law")
def umat_speed_command(
    *, output: Annotated[str | None, Option("also write the table to this text file", "FILE")] = None
) -> None:
    """Compiles the material law and measures its updates per second on one core.

    It does so with and without the consistent tangent, and compares the law with its Python version.

    Example:
        ./lab umat-speed -o umat_speed.txt
    """
    from benchmarks.points import measure, text_of
    from labkit.model.parameters import Model

    if output:
        require_writable(output)
    text = text_of(measure(Model()))
    print(text)
    if output:
        write_with_provenance(output, text + "\n")
