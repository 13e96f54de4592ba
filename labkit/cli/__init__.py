"""The command line: `labkit COMMAND`.

dispatch   reads a command line, runs its command, says what went wrong
registry   where the commands are; they register themselves there, with their options
parser     of command lines
arguments  options made of the table of parameters
simulate   specimen, consolidate, run, stratified; also inside YADE
look       verify, critical, figure, picture, paraview, watch, info
model      model, calibrate, model-speed
bench      bench, bench-statistics
campaign   campaign; job: one job of a campaign
demo       demo
"""

from __future__ import annotations


def main(argv: list[str] | None = None) -> int:
    """Runs a command line; returns its exit code, having said in one line what went wrong."""
    from labkit.cli.dispatch import main as run

    return run(argv)


def call(argv: list[str]) -> int:
    """Runs a command line; raises InputError, PhysicsError or Interrupted where it gives up."""
    from labkit.cli.dispatch import call as run

    return run(argv)
