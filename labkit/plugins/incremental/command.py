"""`labkit driver`: carries out a test of the Incremental Driver on grains or on the constitutive model."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path as File
from typing import TYPE_CHECKING, Annotated

from labkit.cli.arguments import History, Instance, Made, Option, Working, help_of, one_of, require
from labkit.cli.registry import command
from labkit.engines import Device
from labkit.errors import InputError, Interrupted, PhysicsError
from labkit.files.writable import require_writable, stem
from labkit.grains.state import State
from labkit.grains.state_file import read_state
from labkit.parameters import parameters_of
from labkit.paths.steps import Steps
from labkit.records.limits import exceeded_in
from labkit.records.schedule import Options
from labkit.simulation.reports import announcing
from labkit.simulation.tasks import RunTask, execute
from labkit.text.foreign import noted_files

if TYPE_CHECKING:
    from labkit.plugins.incremental.driver_file import DriverFile

MODEL = "model"
UNITS = ("Pa", "kPa", "MPa")
OF_GRAINS = {  # options that the model does not use -> their defaults
    "engine": Device.name,
    **{name: getattr(Device, name) for name in ("threads", "ranks", "precision")},
    **{name: getattr(Options, name) for name in ("snapshots", "save_every", "inertial_number")},
}
HEADER = b"time(1)"  # the first word of an output file of the Incremental Driver


@dataclasses.dataclass(frozen=True, kw_only=True)
class DriverOptions:
    """The material, and the files of the Incremental Driver."""

    on: Annotated[
        str | None, Option(f"state or run file of the grains to test, or `{MODEL}`", "SPECIMEN", group="files")
    ] = None
    block: Annotated[
        int, Option("number of the test to carry out, from 1, if the file has several", type=int, group="files")
    ] = 1
    initial: Annotated[
        str | None, Option("initialconditions.inp, the initial stress and state variables", "FILE", group="files")
    ] = None
    parameters: Annotated[
        str | None, Option("parameters.inp, constants of the model (default: Table 2)", "FILE", group="files")
    ] = None
    stress_unit: Annotated[
        str,
        Option(f"unit of the stresses in these files, one of {', '.join(UNITS)}", type=one_of(UNITS), group="files"),
    ] = "kPa"
    columns: Annotated[
        str | None, Option("output file of the driver (default: named in the test file)", "FILE", group="files")
    ] = None
    output: Annotated[
        str | None, Option("run file to write (default: a name built from the test)", "FILE", group="files")
    ] = None
    rate: Annotated[str | None, Option(help_of(parameters_of(Steps)["rate"]), "RATE", group="loading path")] = None


@command("driver")
def driver_command(
    test: Annotated[str | None, Option("test file of the Incremental Driver, e.g. test.inp")] = None,
    *,
    chosen: Annotated[DriverOptions, Made(DriverOptions)],
    recording: Annotated[Options, Instance(Options, "recording")],
    computation: Working,
    history: History,
) -> None:
    """Carries out a test of the Incremental Driver of A. Niemunis, on grains or on labkit's constitutive model.

    Writes a run file, and the driver's output file with time, strains, stresses and state variables.

    Examples:
        labkit driver test.inp --on s.state.nc --initial initialconditions.inp
        labkit driver test.inp --on model --initial initialconditions.inp --parameters parameters.inp
    """
    from labkit.plugins.incremental.driver_file import read_test

    wanted = read_test(require(test, "test", "a test file, e.g. test.inp"), chosen.stress_unit, chosen.block)
    on = require(chosen.on, "on", f"a state file, or {MODEL}")
    inputs = [file for file in (test, chosen.initial, chosen.parameters) if file] + ([on] if on != MODEL else [])
    test_name = wanted.file.stem + (f"_{chosen.block}" if chosen.block > 1 else "")
    output = chosen.output or str(wanted.file.parent / f"{test_name}_{MODEL if on == MODEL else stem(on)}.run.nc")
    columns = chosen.columns
    if not columns and File(wanted.output).name != wanted.output:  # an untrusted file may name any folder
        raise InputError(f"{test} names its output in another folder, {wanted.output}: say where with --columns")
    table = File(columns) if columns else wanted.file.parent / wanted.output
    _require_table(table, [*inputs, *noted_files(), output])
    for note in wanted.notes:
        print(note, file=sys.stderr)
    chosen = dataclasses.replace(chosen, on=on, output=output)
    if on == MODEL:
        carry_out = _on_model(wanted, chosen, recording, computation, history)
    elif chosen.parameters:
        problem = "is for the model, and grains have their own material: leave it out"
        raise InputError(problem, field="parameters")
    else:
        carry_out = _on_grains(wanted, chosen, recording, computation, history)
    try:
        carry_out()
    except (PhysicsError, Interrupted):
        if File(output).is_file():
            _write_columns(output, wanted, table, chosen.stress_unit, inputs)
        raise
    _write_columns(output, wanted, table, chosen.stress_unit, inputs)
    print(f"{output}: complete; the columns of the Incremental Driver are in {table}")
    if on != MODEL:
        for limit in exceeded_in(output):
            print(f"{output}: {limit}")


def _require_table(file: File, others: Sequence[str]) -> None:
    """Raise InputError unless the driver's output file can be written without destroying another file."""
    require_writable(file, inputs=others)
    if file.is_file() and file.stat().st_size:
        with open(file, "rb") as handle:
            if handle.read(200).split()[:1] != [HEADER]:
                raise InputError(f"{file} is not an output file of the driver, and would be overwritten: use --columns")


def _write_columns(output: str, test: DriverFile, table: File, stress_unit: str, files: Sequence[str]) -> None:
    """Write the records of the run file in the format of the driver's output file."""
    from labkit.files.provenance import write_with_provenance
    from labkit.plugins.incremental.columns import columns, output_text
    from labkit.results.run import Run

    run = Run.open(output)
    with run.data as data:
        if isinstance(run.path, Steps):
            text = output_text(columns(data, run.path, stress_unit), test.heading)
            write_with_provenance(table, text, [*files, output])


def _on_grains(
    test: DriverFile, chosen: DriverOptions, recording: Options, computation: Device, history: str
) -> Callable[[], None]:
    """Bring a specimen to the initial stress; return what loads it along the path of the test."""
    from labkit.plugins.incremental.start import read_initial, way_to

    specimen, output = str(chosen.on), str(chosen.output)

    def carry_out(state: State, path: Steps, options: Options, output: str) -> None:
        task = RunTask(
            state=state, path=path, options=options, source=specimen, output=output, history=history, device=computation
        )
        execute(task, announcing(task, File(output).name))

    state = read_state(specimen)
    computation.require_scene(state.scene)
    initial = read_initial(chosen.initial, chosen.stress_unit) if chosen.initial else None
    path = test.path(chosen.rate, initial.pressure if initial is not None and initial.isotropic else None)
    if initial is not None and not initial.isotropic:
        before = output.removesuffix(".run.nc") + ".initial.run.nc"
        carry_out(state, way_to(initial.stress, chosen.rate), Options(snapshots=0), before)
        state = read_state(before).at_rest()
    return lambda: carry_out(state, path, recording, output)


def _on_model(
    test: DriverFile, chosen: DriverOptions, recording: Options, computation: Device, history: str
) -> Callable[[], object]:
    """Integrate the model along the path of the test, and write it; return what raises PhysicsError if it failed."""
    from labkit.cli.model import require_output
    from labkit.model.driver import drive
    from labkit.model.parameters import Model
    from labkit.model.run_file import write_result
    from labkit.plugins.incremental.columns import VARIABLES
    from labkit.plugins.incremental.start import model_from_constants, model_state, read_initial, way_to

    parameters, unit, output = chosen.parameters, chosen.stress_unit, str(chosen.output)
    given = {**vars(computation), **vars(recording), "engine": computation.name}
    for field, standard in OF_GRAINS.items():
        if given[field] != standard:
            raise InputError("is for grains: leave it out", field=field, value=given[field])
    initial = read_initial(require(chosen.initial, "initial", "initialconditions.inp"), unit)
    model = model_from_constants(parameters, unit) if parameters else Model()
    state = model_state(initial, model)
    require_output(output)
    begin = time.perf_counter()
    if not initial.isotropic and len(initial.state) != VARIABLES:
        state = drive(model, way_to(initial.stress), state).require().state()
    result = drive(model, test.path(chosen.rate), state, recording.record_strain, stop_when=recording.stop_when)
    settings = {} if recording.stop_when is None else {"stop_when": recording.stop_when}
    write_result(output, result, history, time.perf_counter() - begin, settings)
    return result.require
