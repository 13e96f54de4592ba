"""`labkit driver`: carries out a test of the Incremental Driver on grains or on the constitutive model."""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Sequence
from pathlib import Path as File
from typing import TYPE_CHECKING

from labkit.cli.announce import announcing
from labkit.cli.arguments import add_engine_options, add_parameters, computation, given, one_of, require
from labkit.cli.naming import stem
from labkit.cli.registry import command
from labkit.cli.simulate import history_of
from labkit.dem.checkpoint import read_checkpoint
from labkit.dem.limits import exceeded_in, require_pressure
from labkit.dem.schedule import Options, Schedule
from labkit.dem.state import read_state
from labkit.dem.steps import Steps
from labkit.engines import require_engine
from labkit.engines.tasks import RunTask, execute
from labkit.errors import InputError, Interrupted, PhysicsError
from labkit.io.files import require_writable
from labkit.micro.stress import love_stress, mean_stress
from labkit.parameters import help_of, parameters_of

if TYPE_CHECKING:
    from labkit.incremental.driver_file import DriverFile

MODEL = "model"
UNITS = ("Pa", "kPa", "MPa")
HEADER = b"time(1)"  # the first word of an output file of the Incremental Driver


def driver_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit driver`."""
    files = parser.add_argument_group("files")
    parser.add_argument("test", metavar="TEST", nargs="?", help="test file of the Incremental Driver, e.g. test.inp")
    files.add_argument("--on", metavar="SPECIMEN", help=f"state file of the grains to test, or `{MODEL}`")
    files.add_argument(
        "--initial", metavar="FILE", help="initialconditions.inp, the initial stress and state variables"
    )
    files.add_argument("--parameters", metavar="FILE", help="parameters.inp, constants of the model (default: Table 2)")
    unit = f"unit of the stresses in these files, one of {', '.join(UNITS)} (default: kPa)"
    files.add_argument("--stress-unit", type=one_of(UNITS), default="kPa", help=unit)
    files.add_argument("--columns", metavar="FILE", help="output file of the driver (default: named in the test file)")
    files.add_argument("-o", "--output", metavar="FILE", help="run file to write (default: a name built from the test)")
    rate = parameters_of(Steps)["rate"]
    parser.add_argument_group("loading path").add_argument("--rate", metavar="RATE", help=help_of(rate))
    add_parameters(parser.add_argument_group("recording"), Options)
    add_engine_options(parser.add_argument_group("computation"))


@command("driver", driver_options)
def do_driver(options: argparse.Namespace, argv: list[str]) -> None:
    """Carries out the test and writes the run file and the driver's output file. Raises InputError, PhysicsError."""
    from labkit.incremental.driver_file import read_test

    test = read_test(require(options.test, "test", "a test file, e.g. test.inp"), options.stress_unit)
    on = require(options.on, "on", f"a state file, or {MODEL}")
    given_files = [file for file in (options.test, options.initial, options.parameters) if file]
    given_files += [on] if on != MODEL else []
    name = f"{test.file.stem}_{MODEL if on == MODEL else stem(on)}.run.nc"
    options.output = options.output or str(test.file.parent / name)
    table = File(options.columns) if options.columns else test.file.parent / test.output
    _require_table(table, [*given_files, options.output])
    for note in test.notes:
        print(note, file=sys.stderr)
    try:
        (_on_model if on == MODEL else _on_grains)(options, test, argv)
    except (PhysicsError, Interrupted):
        if File(options.output).is_file():
            _write_table(options, test, table, given_files)
        raise
    _write_table(options, test, table, given_files)
    print(f"{options.output}: complete; the columns of the Incremental Driver are in {table}")
    if on != MODEL:
        for limit in exceeded_in(options.output):
            print(f"{options.output}: {limit}")


def _require_table(file: File, others: Sequence[str]) -> None:
    """Raises InputError unless the driver's output file can be written without destroying another file."""
    require_writable(file)
    if any(file.resolve() == File(other).resolve() for other in others):
        raise InputError(f"{file} is also the name of another file of this test: choose another with --columns")
    if file.is_file() and file.stat().st_size:
        with open(file, "rb") as handle:
            if handle.read(200).split()[:1] != [HEADER]:
                raise InputError(f"{file} is not an output file of the driver, and would be overwritten: use --columns")


def _write_table(options: argparse.Namespace, test: DriverFile, table: File, files: Sequence[str]) -> None:
    """Writes the records of the run file as the driver's output file."""
    from labkit.incremental.columns import columns, text_of
    from labkit.io.provenance import write_with_provenance
    from labkit.runs.run import Run

    run = Run.open(options.output)
    with run.data as data:
        if isinstance(run.path, Steps):
            text = text_of(columns(data, run.path, options.stress_unit), test.heading)
            write_with_provenance(table, text, [*files, options.output])


def _on_grains(options: argparse.Namespace, test: DriverFile, argv: list[str]) -> None:
    """Loads a specimen along the path of the test, after it was brought to the initial stress."""
    from labkit.incremental.initial import read_initial
    from labkit.incremental.start import way_to

    if options.parameters:
        raise InputError("is for the model, and grains have their own material: leave it out", field="parameters")
    state = read_state(options.on)
    require_engine(options.engine, state.scene, options.precision)
    initial = read_initial(options.initial, options.stress_unit) if options.initial else None
    path = test.path(options.rate, initial.pressure if initial is not None and initial.isotropic else None)
    task = RunTask(
        state=state,
        source=options.on,
        path=path,
        options=Options(**given(options, Options)),
        output=options.output,
        history=history_of(argv),
        **computation(options),
    )
    if initial is not None and not initial.isotropic:
        before = options.output.removesuffix(".run.nc") + ".initial.run.nc"
        _run(dataclasses.replace(task, path=way_to(initial.stress), options=Options(snapshots=0), output=before))
        task = dataclasses.replace(task, state=read_checkpoint(before))
    _run(task)


def _run(task: RunTask) -> None:
    """Carries out a run, unless its file already holds it. Raises InputError before it starts."""
    output = str(task.output)
    path = task.path.starting_at(float(mean_stress(love_stress(task.state.snapshot()))))
    task = dataclasses.replace(task, path=path)
    require_writable(output, "run")
    require_pressure(path, task.scene)
    Schedule.of(path.for_scene(task.scene), task.scene.time_step, task.state.number_of_grains, task.options)
    execute(task, announcing(task, File(output).name))


def _on_model(options: argparse.Namespace, test: DriverFile, argv: list[str]) -> None:
    """Integrates the model along the path of the test, from its initial stress."""
    from labkit.cli.model import require_output
    from labkit.incremental.columns import VARIABLES
    from labkit.incremental.initial import read_initial, read_material
    from labkit.incremental.start import model_of, model_state, way_to
    from labkit.model.driver import drive
    from labkit.model.parameters import Model
    from labkit.model.run_file import write_result

    initial = read_initial(require(options.initial, "initial", "initialconditions.inp"), options.stress_unit)
    model = model_of(read_material(options.parameters), options.stress_unit) if options.parameters else Model()
    state = model_state(initial, model)
    recording = Options(**given(options, Options))
    require_output(options.output)
    begin = time.perf_counter()
    if not initial.isotropic and len(initial.state) != VARIABLES:
        state = drive(model, way_to(initial.stress), state).require().state()
    result = drive(model, test.path(options.rate), state, recording.record_strain, stop_when=recording.stop_when)
    settings = {} if recording.stop_when is None else {"stop_when": recording.stop_when}
    write_result(options.output, result, history_of(argv), time.perf_counter() - begin, settings)
    result.require()
