"""The command line: `labkit COMMAND`.

dispatch      parses a command line, runs its command, reports errors
registry      list of the commands, which register themselves there with their options
descriptions  descriptions and examples for the help of each command
parser        parser of command lines and its help
arguments     options built from the parameter table
naming        default names of output files
simulate      specimen, consolidate, run, stratified; also inside YADE
look          verify, critical, figure, picture, paraview, watch, info
export        export
model         model, calibrate, model-speed
probe         probe
bench         bench, bench-statistics
umat          umat, umat-speed
campaign      campaign; job: one job of a campaign
demo          demo
"""

from __future__ import annotations


def main(argv: list[str] | None = None) -> int:
    """Runs a command line; returns its exit code and reports any error in one line."""
    from labkit.cli.dispatch import main as run

    return run(argv)


def call(argv: list[str]) -> int:
    """Runs a command line; raises InputError, PhysicsError or Interrupted on failure."""
    from labkit.cli.dispatch import call as run

    return run(argv)
