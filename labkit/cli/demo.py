"""`labkit demo`: a small specimen, a CV test in YADE, and C0 against Love's stress."""

from __future__ import annotations

import argparse
import shlex

from labkit.cli import main
from labkit.cli.registry import command
from labkit.engines.yade_process import find_yade
from labkit.io.files import make_folder

GRAINS = 4000  # C0 averages over grains: with 1,500 its sampling error reaches 3 %
VOID_RATIO = 0.67
STRAIN = 0.1
RECORD_STRAIN = 2e-3
RATE = 20.0  # 1/s: twice the paper's; at this pressure the inertial number stays below 3e-4


def demo_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit demo`."""
    parser.add_argument(
        "-o", "--output", metavar="FOLDER", default="demo", help="folder for the results (default: demo)"
    )


@command("demo", demo_options)
def do_demo(options: argparse.Namespace, argv: list[str]) -> int:
    """Makes a specimen, runs it and verifies the run in a folder, using the commands that a user would type."""
    find_yade()
    folder = make_folder(options.output, "-o")
    state, run, figure = (folder / name for name in ("demo.state.nc", "demo.run.nc", "demo.verify.png"))
    name = {file: shlex.quote(str(file)) for file in (state, run, figure)}
    path = f"cv {name[state]} --strain {STRAIN} --rate {RATE:g} --record-strain {RECORD_STRAIN}"
    steps = [f"run {path} --threads 2 -o {name[run]}", f"verify {name[run]} -o {name[figure]}"]
    if not state.exists():
        steps.insert(0, f"specimen --void-ratio {VOID_RATIO} --grains {GRAINS} --threads 2 -o {name[state]}")
    for step in steps:
        print(f"$ labkit {step}", flush=True)
        code = main(shlex.split(step))
        if code:
            return code
    print(f"results: {state} (specimen), {run} (records and contacts), {figure}")
    return 0
