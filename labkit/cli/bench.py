"""`labkit bench` and `bench-statistics`: speed of engines and of statistics on one scene."""

from __future__ import annotations

import argparse

from labkit.cli.arguments import fraction, positive_int
from labkit.cli.registry import command
from labkit.io.progress import reporter
from labkit.io.provenance import write_with_provenance


def bench_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit bench`."""
    parser.add_argument("specimen", metavar="SPECIMEN", help="state file")
    parser.add_argument(
        "--what",
        choices=("engines", "commands", "features", "gpu", "laws", "sizes", "threads"),
        default="engines",
        help="compare engines (default), whole commands `labkit run cv` with LAMMPS, features of the fused engine by "
        "their cost, batches of specimens on a GPU, contact laws, specimens of several sizes, or threads of the fused "
        "engine on free and busy cores",
    )
    parser.add_argument(
        "--steps", type=positive_int, default=500, metavar="N", help="steps per measurement (default: 500)"
    )
    parser.add_argument(
        "--rounds",
        type=positive_int,
        default=5,
        metavar="N",
        help="number of rounds; each round measures every variant once (default: 5)",
    )
    parser.add_argument(
        "--strain", type=fraction, default=0.1, metavar="E", help="axial strain of whole commands (default: 0.1)"
    )
    parser.add_argument("--csv", metavar="FILE", help="also write the table of `commands`, `gpu` or `sizes` as CSV")


@command("bench", bench_options)
def do_bench(options: argparse.Namespace, argv: list[str]) -> None:
    """Prints the table of speeds."""
    from labkit.dem.state import read_state

    state = read_state(options.specimen)
    progress = reporter("bench")
    if options.what == "engines":
        from labkit.bench.engines import bench, table
        from labkit.dem.paths import ConstantVolume

        results = bench(options.specimen, options.steps, options.rounds, progress)
        print(table(results, state.number_of_grains, state.time_step, ConstantVolume.default_rate(state.scene)))
        return
    if options.what == "commands":
        from labkit.bench import commands

        speeds = commands.commands(options.specimen, options.strain, options.steps, options.rounds, progress)
        print(commands.summary(speeds, state.number_of_grains))
        if options.csv:
            write_with_provenance(options.csv, speeds.to_csv(index=False, float_format="%.6g"), [options.specimen])
        return
    if options.what == "threads":
        from labkit.bench.threads import threads

        print(threads(options.specimen, 10 * options.steps, options.rounds, progress))
        return
    if options.what == "gpu":
        from labkit.bench.gpu import gpu
        from labkit.bench.gpu import table as text_of
        from labkit.engines.cuda.device import require_device

        require_device()
        measured = gpu(state, progress)
        print(text_of(measured))
        if options.csv:
            write_with_provenance(options.csv, measured.to_csv(index=False, float_format="%.4g"), [options.specimen])
        return
    if options.what == "laws":
        from labkit.bench.laws import laws

        print(laws(state, options.steps, options.rounds, progress))
        return
    if options.what == "sizes":
        from labkit.bench.sizes import sizes

        found = sizes(state, options.steps, progress)
        print(found.to_string(index=False, float_format="%.1f"))
        if options.csv:
            write_with_provenance(options.csv, found.to_csv(index=False, float_format="%.4g"), [options.specimen])
        return
    from labkit.bench.kernel import features

    print(features(state, options.steps, options.rounds, progress))


def statistics_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit bench-statistics`."""
    parser.add_argument("run", metavar="RUN", help="run file")


@command("bench-statistics", statistics_options)
def do_bench_statistics(options: argparse.Namespace, argv: list[str]) -> None:
    """Prints the speed and memory of each statistic."""
    from labkit.bench.statistics import bench_statistics

    print(bench_statistics(options.run).to_string(index=False, float_format="%.2f", na_rep=""))
