"""`labkit demo`: a CV test of a small specimen on fused and on YADE, and C0 against Love's stress."""

from __future__ import annotations

import os
import shlex
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from labkit.cli.arguments import Option
from labkit.cli.dispatch import main
from labkit.cli.registry import command
from labkit.engines.yade import find_yade
from labkit.errors import InputError
from labkit.files.atomic import require_no_link
from labkit.files.writable import make_folder

if TYPE_CHECKING:
    from labkit.results.run import Run

GRAINS = 4000  # C0 averages over grains: with 1,500 its sampling error reaches 3 %
VOID_RATIO = 0.67
STRAIN = 0.1
RECORD_STRAIN = 2e-3
RATE = 20.0  # 1/s, twice the paper's rate; at this pressure, the inertial number stays below 3e-4
YADE_STRAIN = 0.02  # smaller, because YADE is slower
COMPARED = (0.004, 0.01, 0.02)  # axial strains at which the engines are compared


@command("demo")
def demo_command(*, output: Annotated[str, Option("folder for the results", "FOLDER")] = "demo") -> int:
    """Makes a specimen of 4,000 grains, runs a CV test on the fused engine and compares C0 with Love's stress.

    This takes half a minute. Then runs the same test in YADE, in a few minutes, and compares the engines. Writes a
    state file, two run files, a figure and a table.

    Example:
        labkit demo -o demo
    """
    require_no_link(output)
    folder, started = make_folder(output, "-o"), time.monotonic()
    names = ("demo.state.nc", "demo.run.nc", "demo.verify.png", "demo.yade.run.nc", "demo.engines.csv")
    state, run, figure, other, table = (folder / name for name in names)
    for file in (state, run, figure, other, table):
        require_no_link(file)
    quoted = {file: shlex.quote(str(file)) for file in (state, run, figure, other)}
    path = f"run cv {quoted[state]} --rate {RATE:g} --record-strain {RECORD_STRAIN}"
    specimen = f"specimen --void-ratio {VOID_RATIO} --grains {GRAINS} --engine fused -o {quoted[state]}"
    steps = [] if state.exists() else [specimen]
    steps += [f"{path} --strain {STRAIN} --engine fused -o {quoted[run]}", f"verify {quoted[run]} -o {quoted[figure]}"]
    code = _run_steps(steps)
    if code:
        return code
    print(f"{figure}: C0 against Love's stress, after {time.monotonic() - started:.0f} s", flush=True)
    try:
        find_yade()
    except InputError as error:
        print(f"without YADE the engines are not compared: {error}")
        return 0
    print("the same on YADE, which takes a minute or two; Ctrl-C skips it", flush=True)
    code = _run_steps([f"{path} --strain {YADE_STRAIN} --engine yade --threads 2 -o {quoted[other]}"])
    if not code:
        print(_comparison(run, other, table))
        print(f"results: {state} (specimen), {run} and {other} (records and contacts), {figure}, {table}")
    return code


def _run_steps(steps: list[str]) -> int:
    """Run commands as if the user had typed them; returns the exit code of the first that fails, or 0."""
    for step in steps:
        print(f"$ {os.environ.get('LABKIT_COMMAND', 'labkit')} {step}", flush=True)
        code = main(shlex.split(step))
        if code:
            return code
    return 0


def _comparison(fused: Path, yade: Path, file: Path) -> str:
    """Compare both engines in a table, and write it to a CSV file; returns the table as text."""
    import pandas

    from labkit.files.provenance import write_with_provenance
    from labkit.results.run import Run

    runs = Run.open(fused), Run.open(yade)
    table = pandas.DataFrame({run.engine: _column(run) for run in runs})
    table["difference (%)"] = 100.0 * (table["fused"] / table["yade"] - 1.0)
    write_with_provenance(file, table.to_csv(index_label="quantity", float_format="%.5g"), [fused, yade])
    fast, slow = (run.steps / run.wall_time for run in runs)
    speeds = f"{fast:.0f} on fused with 1 thread, {slow:.0f} on yade with 2 threads"
    text = table.to_string(float_format="{:.4g}".format, formatters={"difference (%)": "{:.2f}".format})
    return f"{text}\ntime steps per second: {speeds}; {fast / slow:.0f} times as many"


def _column(run: Run) -> dict[str, float]:
    """Return quantities of a run, name -> value."""
    data = run.data
    p = data.lab.mean_stress()
    quantities = {
        "q/p": data.lab.deviatoric_stress() / p,
        "p (MPa)": p / 1e6,
        "Z": data["coordination_number"],
        "Lambda": data["mean_normalised_force"],
    }
    nearest = {at: int(abs(data["axial_strain"].values - at).argmin()) for at in COMPARED}
    return {f"{name} at {100 * at:g} %": float(x[k]) for name, x in quantities.items() for at, k in nearest.items()}
