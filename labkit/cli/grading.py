"""`labkit grading`: the size distribution that was asked for, and that of the grains."""

from __future__ import annotations

import argparse

from labkit.cli.look import figure_name, require_outputs
from labkit.cli.registry import command
from labkit.io.netcdf import labkit_kind
from labkit.io.provenance import write_with_provenance


def grading_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit grading`."""
    parser.add_argument("file", metavar="FILE", help="state or run file")
    parser.add_argument("-o", "--output", metavar="FILE", help="figure to write (default: next to the file)")
    parser.add_argument("--csv", metavar="FILE", help="also write the table as CSV, to this file")


@command("grading", grading_options)
def do_grading(options: argparse.Namespace, argv: list[str]) -> None:
    """Prints diameters of the grading and of the grains, and draws both."""
    from labkit.dem.checkpoint import read_checkpoint
    from labkit.dem.state import read_state
    from labkit.visuals import grading_figure, plots

    state = (read_checkpoint if labkit_kind(options.file) == "run" else read_state)(options.file)
    output = options.output or figure_name(options.file, "grading")
    require_outputs(output, options.csv)
    table = grading_figure.grading_table(state)
    print(table.to_string(index=False, float_format="%.4g"))
    plots.save(grading_figure.grading(state), output, [options.file])
    print(f"figure: {output}")
    if options.csv:
        write_with_provenance(options.csv, table.to_csv(index=False, float_format="%.5g"), [options.file])
