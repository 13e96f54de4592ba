"""`labkit model`, `calibrate` and `model-speed`: the constitutive model from the command line."""

from __future__ import annotations

import argparse
import dataclasses
import math
import time
from pathlib import Path

from labkit.cli.arguments import add_parameters, add_path_parameters, given, require
from labkit.cli.registry import command
from labkit.cli.simulate import history_of
from labkit.dem.paths import PATHS
from labkit.errors import InputError, PhysicsError
from labkit.io.files import labkit_kind, open_netcdf, require_writable
from labkit.parameters import check_parameters, parameter, parameters_of

BEYOND = ("error", "flat")  # readings of labkit.model.parameters, which needs no import here


@dataclasses.dataclass(frozen=True)
class Start:
    """The isotropic state that a test of the model begins with, and how it is integrated."""

    void_ratio: float = parameter(None, above=0.0, help="at the start, e.g. 0.67")
    pressure: float = parameter(
        None, unit="Pa", above=0.0, help="isotropic stress at the start; paths that hold a stress hold it"
    )
    coordination_number: float | None = parameter(
        None, above=0.0, help="Z at the start (default: the compression line Z^com of the void ratio)"
    )
    mean_normalised_force: float | None = parameter(
        None, above=0.0, help="Lambda at the start (default: from the pressure and Z)"
    )
    inherent_anisotropy: float = parameter(
        0.0, above=-1.0, high=2.0, help="a1 of the contacts at the start, under an isotropic stress"
    )
    angle: float = parameter(0.0, low=-360.0, high=360.0, help="of its axis from z in degrees")
    stop_pressure: float | None = parameter(
        None, unit="Pa", above=0.0, help="mean stress where isoc (3e6) and isod (20e3) stop"
    )
    record_strain: float | None = parameter(
        None, above=0.0, high=1.0, help="strain between records (default: the path's)"
    )
    tolerance: float = parameter(1e-6, above=0.0, high=1.0, help="error of an integration step")

    def __post_init__(self) -> None:
        """Checks every parameter. Raises InputError."""
        check_parameters(self)


def model_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit model`."""
    parser.add_argument("path", nargs="?", help=f"loading path: {', '.join((*PATHS, 'oedometer'))}")
    add_parameters(parser, Start)
    add_path_parameters(parser, PATHS.values(), leave_out=("pressure",))
    parser.add_argument(
        "--beyond-e-cmax",
        choices=BEYOND,
        default="error",
        help="what holds for void ratios above e_cmax: error (default), or flat: Z^c = 4, Lambda^c = 0",
    )
    parser.add_argument("--parameters", help="JSON file of labkit calibrate (default: Table 2)")
    parser.add_argument("-o", "--output", help="run file to write")


@command("model", model_options)
def do_model(options: argparse.Namespace, argv: list[str]) -> None:
    """Runs the model and writes its run file, up to the failure if it fails. Raises InputError, PhysicsError."""
    from labkit.dem.limits import exceeded
    from labkit.dem.scene import Scene
    from labkit.model.controls import model_path
    from labkit.model.driver import drive
    from labkit.model.integrators import Adaptive
    from labkit.model.run_file import read_model, records, write_result
    from labkit.model.state import isotropic_state, with_inherent_anisotropy

    name = require(options.path, "path")
    for field in ("void_ratio", "pressure", "output"):
        require(getattr(options, field), field)
    output = options.output
    at = Start(**given(options, Start))  # type: ignore[arg-type]
    model = read_model(options.parameters).reading(beyond_e_cmax=options.beyond_e_cmax)
    known = {field for kind in PATHS.values() for field in parameters_of(kind)} - {"pressure"}
    path = model_path(name, at.pressure, at.stop_pressure, **{field: getattr(options, field) for field in known})
    state = isotropic_state(model, at.void_ratio, at.pressure, at.coordination_number, at.mean_normalised_force)
    state = with_inherent_anisotropy(model, state, at.inherent_anisotropy, math.radians(at.angle))
    require_output(output)
    begin = time.perf_counter()
    result = drive(model, path, state, at.record_strain, Adaptive(at.tolerance))
    write_result(output, result, history_of(argv), time.perf_counter() - begin, {"tolerance": at.tolerance})
    if result.failure:
        raise PhysicsError(f"{result.failure}; the {len(result)} records until there are in {output} (complete = 0)")
    if path.stops_early and not path.stops(result.p[-1]):
        stop = path.parameters().get("pressure")
        where = "it would stop by itself" if stop is None else f"--stop-pressure {stop:g} Pa"
        print(f"{output}: the strain of {path.strain:g} ended {path.name} before {where}")
    for limit in exceeded(records(result), Scene(young_modulus=model.young_modulus)):
        print(f"{output}: {limit}")
    e, Z, Lam, p = result.e[-1], result.Z[-1], result.Lam[-1], result.p[-1]
    print(
        f"{output}: {path.name} complete, {len(result)} records, axial strain {result.axial_strain[-1]:.2%}, "
        f"e {e:.4f}, Z {Z:.3f}, Lambda {Lam:.5f}, p {p / 1e6:.4f} MPa, q/p {result.q[-1] / p:.3f}"
    )


def calibrate_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit calibrate`."""
    parser.add_argument("run", nargs="+", help="run files: shear tests, better isoc and isod too")
    parser.add_argument("-o", "--output", help="JSON file for the fitted parameters, for labkit model --parameters")
    parser.add_argument("--csv", help="file for the table as CSV")
    parser.add_argument("--figure", help="figure of the runs and of the fitted model")


@command("calibrate", calibrate_options)
def do_calibrate(options: argparse.Namespace, argv: list[str]) -> None:
    """Fits the parameters to runs, prints the report and writes what was asked for. Raises InputError."""
    from labkit.cli.look import open_runs
    from labkit.io.provenance import write_with_provenance
    from labkit.model.calibration import fit, observe
    from labkit.visuals import plots

    runs = open_runs(options.run)
    outputs = [file for file in (options.output, options.csv, options.figure) if file]
    if len({Path(file).resolve() for file in outputs}) < len(outputs):
        raise InputError("two outputs have one name: give each file its own")
    if options.figure and Path(options.figure).suffix.lower() not in plots.FORMATS:
        raise InputError(f"{options.figure} has no ending of a figure: use one of {', '.join(plots.FORMATS)}")
    for file in outputs:
        require_writable(file)
    observations = [observe(name, run) for name, run in runs.items()]
    found = fit(observations)
    print(found.report())
    if options.output:
        write_with_provenance(options.output, found.model.reading(beyond_e_cmax="error").to_json() + "\n", options.run)
    if options.csv:
        write_with_provenance(options.csv, found.table.to_csv(index=False, float_format="%.6g"), options.run)
    if options.figure:
        plots.save(plots.calibration(observations, found.predicted), options.figure)
    for file in outputs:
        print(f"written: {file}")


def require_output(file: str) -> None:
    """Raises InputError unless a run file of the model can be written: a simulation is not written over."""
    require_writable(file, "run")
    if Path(file).exists() and labkit_kind(file) == "run":
        with open_netcdf(file, "run") as dataset:
            if getattr(dataset, "engine", None) != "model":
                raise InputError(f"{file} holds a simulation, which would be overwritten: choose another -o")


def speed_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit model-speed`."""
    parser.add_argument("-o", "--output", default="results", help="folder that is there (default: results)")


@command("model-speed", speed_options)
def do_model_speed(options: argparse.Namespace, argv: list[str]) -> None:
    """Measures the integrators and prints the table."""
    from labkit.bench.model import measure_all

    require_writable(Path(options.output) / "labkit")
    print(measure_all(Path(options.output)))
