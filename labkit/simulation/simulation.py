"""Combines specimen, path, engine and recorder into a run, and resumes it if it was interrupted.

A State whose `step` is not zero comes from an earlier run (`run.state`, `labkit.read_state` of a run file). A path
continues from it: the grains keep their motion, and the specimen keeps its stress. `state.at_rest()` makes it an
ordinary specimen.
"""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path as File

import numpy as np

from labkit.engines.base import Progress, Request
from labkit.engines.device import Device
from labkit.engines.kernel.sources import code_of_law
from labkit.errors import ProgramError
from labkit.grains.state import State
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import equivalent_stress, mean_stress
from labkit.micro.tensors import symmetric, to_six
from labkit.paths.cycles import ISOTROPIC
from labkit.paths.facts import facts_of, require_meaning
from labkit.paths.path import Path
from labkit.paths.standard import Consolidation
from labkit.paths.step import Here
from labkit.process.interruption import stop_on_signals
from labkit.quantities.conditions import condition
from labkit.records.checkpoint import CODE_OF_LAW
from labkit.records.energy import open_ledger
from labkit.records.memory import RunInMemory
from labkit.records.recorder import Recorder
from labkit.records.schedule import Options
from labkit.results.endings import unfinished_error
from labkit.servo.reach import ERROR, errors, require_way
from labkit.simulation.clock import ACCUMULATED
from labkit.simulation.grains import Grains
from labkit.simulation.stopping import contents
from labkit.specimens.consolidation import approach, interim_of, stress_error
from labkit.specimens.ready import ready
from labkit.specimens.recipe import Recipe


def goes_on(path: Path, state: State) -> bool:
    """Return True if a path continues from the state of a run without consolidation.

    Its stresses must be within 2 % of the stresses that the path holds. Any other specimen is first consolidated if the
    path has a start pressure.
    """
    if state.step == 0:
        return False
    stress = love_stress(state.snapshot())
    control = next(iter(path.steps_from(Here(stress)))).held
    if path.start_pressure() is None:
        return True
    if control is None or control.water is not None or path.has_programmes:
        return False
    return float(errors(control, stress, 0.0).max()) <= ERROR


def default_pressure(path: Path, state: State) -> float:
    """Return the pressure of a path without a given pressure, Pa: the mean stress of the specimen.

    For the state of a run it is the pressure at which the path holds, on average, the current stresses.
    """
    stress = love_stress(state.snapshot())
    mean = float(mean_stress(stress))
    if state.step == 0 or mean <= 0.0 or path.has_programmes:
        return mean
    control = next(iter(path.starting_at(mean).steps_from(Here(stress)))).held
    if control is None or not (loaded := control.at(0.0) != 0.0).any():
        return mean
    shares = (control.measure @ to_six(symmetric(stress)))[loaded] / control.at(0.0)[loaded]
    return mean * float(np.mean(shares))


def lost_deviator(path: Path, state: State) -> str:
    """Say that the anisotropic stress at the end of a run is lost, because the path consolidates first; empty if not.

    Args:
        path: The path, with its pressure.
        state: The state from which it starts.
    """
    pressure = path.start_pressure()
    if pressure is None or state.step == 0 or goes_on(path, state):
        return ""
    stress = love_stress(state.snapshot())
    p, q = float(mean_stress(stress)), float(equivalent_stress(stress))
    if q <= ISOTROPIC * p:
        return ""
    return (
        f"the earlier run ends with q = {q / 1e3:.4g} kPa at p = {p / 1e3:.4g} kPa, and {path.name} first consolidates "
        f"isotropically to {pressure / 1e3:.4g} kPa: to go on from this stress, give a path of steps without a pressure"
    )


IF_GIVEN = ("stop_when", "inertial_number")  # options that a run file contains only if they were given
CONSOLIDATED = 2e-3  # relative deviation from the pressure below which a specimen is not consolidated again


def simulation(
    specimen: State,
    path: Path,
    output: File | RunInMemory,
    device: Device,
    options: Options,
    progress: Progress,
) -> Generator[Request, object, bool]:
    """Yield the requests of a run to an engine (labkit.engines.base), whose name and precision `device` gives.

    The rate of the path is resolved (labkit.paths.rates.on_grains). `output` is the file, or keeps the run in memory.
    """
    require_meaning(path, facts_of(path), condition(options.stop_when) if options.stop_when else None)
    settings = {
        "record_strain": options.record_strain or path.record_strain,
        "snapshots": options.snapshots,
        "engine": device.name,
        **{f"servo_{name}": value for name, value in vars(options.servo).items()},
        "guarded": options.guarded,
        **{name: value for name in IF_GIVEN if (value := getattr(options, name)) is not None},
        **({"precision": device.precision} if device.precision != "double" else {}),
        **({CODE_OF_LAW: code} if (code := code_of_law(specimen.scene)) else {}),
    }
    extra = ACCUMULATED if options.inertial_number is not None else {}
    recorder = Recorder(output, path, settings, specimen, extra, all_saved=options.save_every is not None)
    try:
        with stop_on_signals() as signals, recorder:
            stored = recorder.resume()
            if stored and stored.point.complete:
                return False
            if stored and stored.point.endings.reason:
                raise unfinished_error(stored.point.endings.reason, output)
            if not stored:
                interim = None if isinstance(output, RunInMemory) else interim_of(output)
                if goes_on(path, specimen):  # its state stays in motion
                    specimen = yield from ready(specimen, options.guarded)
                else:
                    specimen = yield from ready(specimen.at_rest(), options.guarded)
                    pressure, cell = path.start_pressure(), Recipe.cell_of(specimen)
                    target = None if pressure is None else Consolidation(pressure=pressure, cell=cell)
                    if target is not None and stress_error(specimen.snapshot(), target.control()) > CONSOLIDATED:
                        guarded, report = options.guarded, lambda done, text: progress(0.0, text)
                        specimen = yield from approach(
                            specimen, target, device, report, interim, signals, guarded=guarded
                        )
                specimen = open_ledger(specimen)
                require_way(path, love_stress(specimen.snapshot()))
            grains = Grains(path, recorder, specimen, stored, options, progress, signals, device)
            yield from grains.run()
            return True
    except ProgramError as error:
        if isinstance(output, RunInMemory):
            raise
        content = f"holds {contents(output, path)}" if output.exists() else "does not exist yet"
        raise ProgramError(f"{error}; {output} {content}") from None
