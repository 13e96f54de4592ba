"""`labkit model`, `calibrate` and `model-speed`: the constitutive model from the command line."""

from __future__ import annotations

import argparse
import dataclasses
import math
import time
from pathlib import Path

from labkit.cli.arguments import add_parameters, add_path_parameters, given, require
from labkit.cli.naming import model_name
from labkit.cli.parser import Options as OptionGroup
from labkit.cli.parser import Parser, listed, summary_of
from labkit.cli.registry import command
from labkit.cli.simulate import history_of, named_path
from labkit.dem.paths import PATHS
from labkit.dem.paths import Path as PathKind
from labkit.errors import InputError, PhysicsError
from labkit.io.files import require_writable
from labkit.io.netcdf import labkit_kind, open_netcdf
from labkit.parameters import check_parameters, parameter, parameters_of

BEYOND = ("error", "flat")  # choices of labkit.model.parameters; importing it here would slow down the help


@dataclasses.dataclass(frozen=True)
class Start:
    """Initial isotropic state of a test of the model, and the accuracy of its integration."""

    void_ratio: float = parameter(None, above=0.0, help="initial void ratio, e.g. 0.67")
    pressure: float = parameter(
        None, unit="Pa", above=0.0, help="initial isotropic stress, which stress-controlled paths hold,"
    )
    coordination_number: float | None = parameter(
        None, above=0.0, help="initial coordination number Z (default: Z^com, the compression line at this void ratio)"
    )
    mean_normalised_force: float | None = parameter(
        None, above=0.0, help="initial mean normalised contact force Lambda (default: from the pressure and Z)"
    )
    inherent_anisotropy: float = parameter(
        0.0, above=-1.0, high=2.0, help="initial contact anisotropy a1, under an isotropic stress"
    )
    angle: float = parameter(
        0.0, low=-360.0, high=360.0, help="angle between the axis of the initial anisotropy and z, degrees"
    )
    stop_pressure: float | None = parameter(
        None,
        unit="Pa",
        above=0.0,
        help="final mean stress of isoc and isod (default: 3e6 for isoc, 20e3 for isod)",
    )
    record_strain: float | None = parameter(
        None, above=0.0, high=1.0, help="axial strain between two records (default: the path's)"
    )
    stop_when: str | None = parameter(None, kind=str, help="condition that ends the test at a record, e.g. 'q/p > 0.9'")
    tolerance: float = parameter(1e-6, above=0.0, high=1.0, help="relative error allowed in one integration step")

    def __post_init__(self) -> None:
        """Checks every parameter. Raises InputError."""
        check_parameters(self)


def model_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit model`. If the command line names a path, the help is limited to that path."""
    words = parser.command_line if isinstance(parser, Parser) else ()
    named = [PATHS[word] for word in words if word in PATHS][:1] if {"-h", "--help"} & set(words) else []
    kinds = named or list(PATHS.values())
    parser.add_argument(
        "path", metavar="PATH", nargs="?", help=f"loading path, one of {', '.join(PATHS)}, or a path file, FILE.yaml"
    )
    add_parameters(parser.add_argument_group("initial state and integration"), Start)
    group = parser.add_argument_group("loading path")
    add_path_parameters(group, PATHS.values(), leave_out=("pressure",), shown=kinds)
    add_model_options(parser)
    parser.add_argument(
        "-o", "--output", metavar="FILE", help="run file to write (default: a name built from the parameters)"
    )
    texts = {kind.name: summary_of(kind) for kind in kinds}
    if not named:
        texts["oedometer"] = "Axial compression without radial strain"
    parser.epilog = listed("loading path", texts)


def add_model_options(parser: OptionGroup) -> None:
    """Adds --beyond-e-cmax and --parameters, which choose the model."""
    parser.add_argument(
        "--beyond-e-cmax",
        choices=BEYOND,
        default="error",
        help="for void ratios above e_cmax: stop with an error (default), or use flat lines, Z^c = 4 and Lambda^c = 0",
    )
    parser.add_argument(
        "--parameters", metavar="FILE", help="parameters of the model, from labkit calibrate -o (default: Table 2)"
    )


@command("model", model_options)
def do_model(options: argparse.Namespace, argv: list[str]) -> None:
    """Integrates the model and writes its run file; if the integration fails, the file contains the records up to then.

    Raises InputError, PhysicsError.
    """
    from labkit.dem.limits import exceeded
    from labkit.dem.scene import Scene
    from labkit.model.controls import model_path
    from labkit.model.driver import drive
    from labkit.model.integrators import Adaptive
    from labkit.model.run_file import as_run, read_model, records, write_result
    from labkit.model.state import isotropic_state, with_inherent_anisotropy

    name = require(options.path, "path", f"one of {', '.join(PATHS)}, or a path file")
    kind, written = named_path(name)
    for field, example in (("void_ratio", "one, e.g. 0.67"), ("pressure", "one, e.g. 500kPa")):
        require(getattr(options, field), field, example)
    at = Start(**given(options, Start))
    model = read_model(options.parameters).reading(beyond_e_cmax=options.beyond_e_cmax)
    known = {field for kind in PATHS.values() for field in parameters_of(kind)} - {"pressure"}
    values = {field: value for field in known if (value := getattr(options, field)) is not None}
    file_pressure = written.pop("pressure", None)
    stop = at.stop_pressure or (file_pressure if kind.stops is not PathKind.stops else None)
    path = model_path(kind.name, at.pressure, stop, **{**written, **values})
    state = isotropic_state(model, at.void_ratio, at.pressure, at.coordination_number, at.mean_normalised_force)
    state = with_inherent_anisotropy(model, state, at.inherent_anisotropy, math.radians(at.angle))
    output = options.output or model_name(options, Start, Path(name).stem, [kind])
    require_output(output)
    begin = time.perf_counter()
    result = drive(model, path, state, at.record_strain, Adaptive(at.tolerance), at.stop_when)
    settings = {"tolerance": at.tolerance, **({} if at.stop_when is None else {"stop_when": at.stop_when})}
    write_result(output, result, history_of(argv), time.perf_counter() - begin, settings)
    if result.failure:
        raise PhysicsError(
            f"{result.failure}; the {len(result)} records up to that point are in {output} (complete = 0)"
        )
    if result.ended_because:
        print(f"{output}: {result.ended_because}")
    for limit in exceeded(records(result), Scene(young_modulus=model.young_modulus)):
        print(f"{output}: {limit}")
    strain = as_run(result).lab.strain()
    e, Z, Lam, p = result.e[-1], result.Z[-1], result.Lam[-1], result.p[-1]
    print(
        f"{output}: {path.name} complete, {len(result)} records, "
        f"{strain.attrs['long_name']} {float(strain[-1]):.2%}, "
        f"e {e:.4f}, Z {Z:.3f}, Lambda {Lam:.5f}, p {p / 1e6:.4f} MPa, q/p {result.q[-1] / p:.3f}"
    )


def calibrate_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit calibrate`."""
    parser.add_argument(
        "run", metavar="RUN", nargs="+", help="run file of a simulation: shear tests, preferably also isoc and isod"
    )
    parser.add_argument(
        "-o", "--output", metavar="FILE", help="write the fitted parameters as JSON, for labkit model --parameters"
    )
    parser.add_argument("--csv", metavar="FILE", help="also write the table as CSV, to this file")
    parser.add_argument("--figure", metavar="FILE", help="draw the runs and the fitted model, to this file")


@command("calibrate", calibrate_options)
def do_calibrate(options: argparse.Namespace, argv: list[str]) -> None:
    """Fits the parameters to runs, prints the report and writes the requested files. Raises InputError."""
    from labkit.cli.look import open_runs
    from labkit.io.provenance import write_with_provenance
    from labkit.model.calibration import fit
    from labkit.model.observation import observe, require_usable
    from labkit.visuals import model_figures, plots

    opened = open_runs(options.run)
    runs, left_out = require_usable(opened)
    files = [file for file, name in zip(options.run, opened, strict=True) if name in runs]
    outputs = [file for file in (options.output, options.csv, options.figure) if file]
    if len({Path(file).resolve() for file in outputs}) < len(outputs):
        raise InputError("two outputs have the same name: give each file its own")
    if options.figure:
        plots.require_format(options.figure)
    for file in outputs:
        require_writable(file)
    observations = [observe(name, run) for name, run in runs.items()]
    result = fit(observations)
    print(*(f"left out: {name}: {reason}\n" for name, reason in left_out.items()), sep="", end="")
    print(result.report())
    if options.output:
        write_with_provenance(options.output, result.model.reading(beyond_e_cmax="error").to_json() + "\n", files)
    if options.csv:
        write_with_provenance(options.csv, result.table.to_csv(index=False, float_format="%.6g"), files)
    if options.figure:
        plots.save(model_figures.calibration(observations, result.predicted), options.figure)
    for file in outputs:
        print(f"written: {file}")


def require_output(file: str) -> None:
    """Raises InputError if the file cannot be written or holds a simulation, which is never overwritten."""
    require_writable(file, "run")
    if Path(file).exists() and labkit_kind(file) == "run":
        with open_netcdf(file, "run") as dataset:
            if getattr(dataset, "engine", None) != "model":
                raise InputError(f"{file} holds a simulation, which would be overwritten: choose another -o")


def speed_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit model-speed`."""
    parser.add_argument(
        "-o", "--output", metavar="FOLDER", default="results", help="existing folder (default: results)"
    )


@command("model-speed", speed_options)
def do_model_speed(options: argparse.Namespace, argv: list[str]) -> None:
    """Measures the integrators and prints the table."""
    from labkit.bench.model import measure_all

    require_writable(Path(options.output) / "labkit")
    print(measure_all(Path(options.output)))
