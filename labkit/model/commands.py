"""What `labkit model` and `labkit calibrate` do: options to values, values to files."""

from __future__ import annotations

import dataclasses
import math
import time
from pathlib import Path

import numpy as np

from labkit.cli.arguments import require
from labkit.errors import InputError, PhysicsError
from labkit.io.files import labkit_kind, open_netcdf, require_writable
from labkit.dem.limits import exceeded
from labkit.model.controls import model_path
from labkit.model.driver import drive
from labkit.model.integrators import Adaptive
from labkit.model.parameters import Model
from labkit.model.run_file import ENGINE, records, write_result
from labkit.model.state import contact_anisotropy, isotropic_force_anisotropy, isotropic_state
from labkit.io.provenance import write_told


def model_command(options, history):
    """Runs the model and writes its run file, up to the failure if it fails. Raises InputError, PhysicsError."""
    name = require(options.path, "the path")
    void_ratio = require(options.void_ratio, "--void-ratio")
    pressure = require(options.pressure, "--pressure")
    output = require(options.output, "--output")
    model = read_model(options.parameters).reading(beyond_e_cmax=options.beyond_e_cmax)
    path = model_path(
        name, pressure, options.stop_pressure, strain=options.strain, rate=options.rate, reversals=options.reversals
    )
    state = isotropic_state(model, void_ratio, pressure, options.coordination_number, options.mean_normalised_force)
    state = with_inherent_anisotropy(model, state, options.inherent_anisotropy, options.angle)
    integrator = Adaptive(options.tolerance)
    require_output(output)
    begin = time.perf_counter()
    result = drive(model, path, state, options.record_strain, integrator)
    write_result(output, result, history, time.perf_counter() - begin, {"tolerance": options.tolerance})
    if result.failure:
        raise PhysicsError(f"{result.failure}; the {len(result)} records until there are in {output} (complete = 0)")
    if path.stops_early and not path.stops(result.p[-1]):
        print(f"{output}: the strain of {path.strain:g} ended {path.name} before --stop-pressure {path.pressure:g} Pa")
    for sentence in exceeded(records(result)):
        print(f"{output}: {sentence}")
    e, Z, Lam, p = result.e[-1], result.Z[-1], result.Lam[-1], result.p[-1]
    print(f"{output}: {path.name} complete, {len(result)} records, axial strain {result.axial_strain[-1]:.2%}, "
          f"e {e:.4f}, Z {Z:.3f}, Lambda {Lam:.5f}, p {p / 1e6:.4f} MPa, q/p {result.q[-1] / p:.3f}")  # fmt: skip


def calibrate_command(options, runs):
    """Fits the parameters to runs (name -> run), prints the report and writes what was asked for. Raises InputError."""
    from labkit.visuals import plots  # not for labkit model, which starts faster without them
    from labkit.model.calibration import fit, observe

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
        write_told(options.output, found.model.reading(beyond_e_cmax="error").to_json() + "\n", options.run)
    if options.csv:
        write_told(options.csv, found.table.to_csv(index=False, float_format="%.6g"), options.run)
    if options.figure:
        plots.save(plots.calibration(observations, found.predicted), options.figure)
    for file in outputs:
        print(f"written: {file}")


def with_inherent_anisotropy(model, state, a1, angle):
    """The state with A0 of size `a1` at `angle` (degrees from z), the F0 that keeps the stress isotropic, and Lambda
    changed so that the mean stress stays. Raises InputError."""
    if not (math.isfinite(a1) and math.isfinite(angle)):
        raise InputError("--inherent-anisotropy and --angle must be finite numbers, e.g. 0.3 and 45")
    if a1 == 0.0:
        return state
    if not -1.0 < a1 < 2.0:
        raise InputError(f"--inherent-anisotropy {a1:g} makes the density of contact normals negative: give a number "
                         "from -1 to 2, e.g. 0.3")  # fmt: skip
    pressure = np.trace(state.stress(model)) / 3
    A = contact_anisotropy(a1, math.radians(angle))
    state = dataclasses.replace(state, A=A, F=isotropic_force_anisotropy(A))
    return dataclasses.replace(state, Lam=state.Lam * pressure / (np.trace(state.stress(model)) / 3))


def read_model(file):
    """The Model of a JSON file, Table 2 without a file. Raises InputError."""
    if file is None:
        return Model()
    try:
        return Model.from_json(Path(file).read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file} cannot be read ({getattr(error, 'strerror', error)}): give a JSON file of "
                         "labkit calibrate") from None  # fmt: skip
    except InputError as error:
        raise InputError(f"{file}: {error}") from None


def require_output(file):
    """Raises InputError unless a run file of the model can be written: a simulation is not written over."""
    require_writable(file, "run")
    if Path(file).exists() and labkit_kind(file) == "run":
        with open_netcdf(file, "run") as dataset:
            if getattr(dataset, "engine", None) != ENGINE:
                raise InputError(f"{file} holds a simulation: it would be lost, give another -o")
