"""What a study measures beside its runs: engines in turn on one scene, the Verlet skin, two grains, the family of
stress-force-fabric relationships, the integrators of the model. Each is kept as a table in the study's folder.
"""

from __future__ import annotations

import dataclasses
import shutil
import statistics
import time
from pathlib import Path

import numpy as np
import pandas

import labkit as lk
from analysis.speed_error.collisions import collision_errors
from analysis.speed_error.design import BASELINE, PRESET, Design
from analysis.speed_error.jobs import run_case, run_file, specimen_file
from analysis.speed_error.lammps import shear_in_lammps
from analysis.speed_error.observables import strength
from labkit.bench import bench, measure_all
from labkit.dem import ConstantVolume, Progress, read_state, velocity_gradient
from labkit.engines import FusedEngine
from labkit.io import whole_file
from labkit.micro import deviatoric_stress, mean_stress
from labkit.visuals import micro_figures, plots

SKINS = (None, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2)  # of the mean diameter; None: what the engine chooses
SKIN_STEPS, SKIN_ROUNDS = 2000, 5
COLLISION_STEPS = (0.4, 0.2, 0.1, 0.05, 0.025)  # of sqrt(m/kn) of the mean grain
LAMMPS_RATE = 40.0  # 1/s
SETTINGS_STEPS, SETTINGS_ROUNDS = 5000, 3


def measure_others(design: Design, work: str | Path, progress: Progress) -> dict[str, pandas.DataFrame]:
    """name -> table of the design's measures; those that are in the folder already are read."""
    folder = Path(work) / "measures"
    folder.mkdir(exist_ok=True)
    found = {}
    for number, name in enumerate(design.measures):
        progress(number / len(design.measures), name)
        file = folder / f"{name}.csv"
        if not file.exists():
            table = MEASURES[name](design, work, folder)
            with whole_file(file) as temporary:
                table.to_csv(temporary, index=False, float_format="%.6g")
        found[name] = pandas.read_csv(file)
    progress(1.0, "measured")
    return found


def settings(design: Design, work: str | Path, folder: Path) -> pandas.DataFrame:
    """Time per step of every set of settings and of the baseline, in turn, servo and records included: what a whole
    test takes, and that over what one with the standard settings takes.
    """
    cases = [case for case in design.cases if case.factor in (PRESET, BASELINE)]
    seconds = {case: [] for case in cases}
    for _turn in range(SETTINGS_ROUNDS + 1):  # the first one compiles
        for case in cases:
            state = case.state(read_state(specimen_file(work, case, case.seeds[0])))
            path = case.loading(case.rate * state.scene.time_step * SETTINGS_STEPS)
            run = lk.run(state, path, progress=False, record_strain=case.record_strain, snapshots=0, servo=case.servo)
            seconds[case].append(run.wall_time / run.steps)
    rows = []
    for case in cases:
        steps = case.steps(read_state(specimen_file(work, case, case.seeds[0])).scene)
        standard = next(other for other in cases if (other.path, other.level) == (case.path, "standard"))
        each, over = seconds[case][1:], [a / b for a, b in zip(seconds[case][1:], seconds[standard][1:], strict=True)]
        ratio = steps / standard.steps(read_state(specimen_file(work, standard, standard.seeds[0])).scene)
        rows.append(
            {
                "case": case.name,
                "steps": steps,
                "microseconds_per_step": 1e6 * statistics.median(each),
                "minutes": statistics.median(each) * steps / 60.0,
                "over_standard": ratio * statistics.median(over),
            }
        )
    return pandas.DataFrame(rows)


def engines(design: Design, work: str | Path, folder: Path) -> pandas.DataFrame:
    """Steps per second of every engine in turn, on the specimens of the baseline and of the standard settings."""
    rows = []
    for case in (design.baseline(), design.of_settings("standard")):
        file = specimen_file(work, case, case.seeds[0])
        grains = read_state(file).number_of_grains
        found = bench(str(file), max(20, int(600_000 / grains)), 3, lambda fraction, text: None)
        base = [turn["steps_per_second"] for turn in next(iter(found.values()))]
        for name, turns in found.items():
            speed = [turn["steps_per_second"] for turn in turns]
            ratio = [a / b for a, b in zip(speed, base, strict=True)]
            rows.append(
                {
                    "grains": grains,
                    "engine": name,
                    "steps_per_second": statistics.median(speed),
                    "grain_steps_per_second": statistics.median(speed) * grains,
                    "over_stock": statistics.median(ratio),
                    "over_stock_least": min(ratio),
                    "over_stock_most": max(ratio),
                }
            )
    return pandas.DataFrame(rows)


def skin(design: Design, work: str | Path, folder: Path) -> pandas.DataFrame:
    """Time per step and the largest difference of positions, over the mean diameter, with different Verlet skins."""
    rows = []
    for case in (design.baseline(), design.of_settings("standard")):
        state = read_state(specimen_file(work, case, case.seeds[0]))
        for rate in (10.0, 200.0):
            seconds, ends = _skins(state, velocity_gradient(ConstantVolume(rate), 1.0, state.time_step))
            for value in SKINS:
                moved = np.abs(ends[value] - ends[None]).max() / (2.0 * state.radius.mean())
                rows.append(
                    {
                        "grains": state.number_of_grains,
                        "rate": rate,
                        "skin": "auto" if value is None else value,
                        "microseconds_per_step": 1e6 * statistics.median(seconds[value]) / SKIN_STEPS,
                        "over_auto": statistics.median(
                            a / b for a, b in zip(seconds[value], seconds[None], strict=True)
                        ),
                        "position_difference": moved,
                    }
                )
    return pandas.DataFrame(rows)


def _skins(state, gradient):
    seconds, ends = {value: [] for value in SKINS}, {}
    for _ in range(SKIN_ROUNDS):
        for value in SKINS:
            engine = FusedEngine(state, skin=value)
            begin = time.perf_counter()
            engine.advance(SKIN_STEPS, gradient)
            seconds[value].append(time.perf_counter() - begin)
            ends[value] = engine.state().position
    return seconds, ends


def sff_family(design: Design, work: str | Path, folder: Path) -> pandas.DataFrame:
    """Error and cost of every stress-force-fabric relationship in a test with the standard settings."""
    case = design.of_settings("standard")
    if not run_file(work, case, case.seeds[0]).exists():  # its result came from an earlier study
        run_case(work, case, case.seeds[0], specimen_file(work, design.baseline(), design.baseline().seeds[0]))
    with lk.open_run(run_file(work, case, case.seeds[0])) as found:
        figure, table = micro_figures.family(found)
    plots.save(figure, folder / "sff_family.png")
    return table


def model(design: Design, work: str | Path, folder: Path) -> pandas.DataFrame:
    """Time and error of the integrators of the model; text and figure lie beside the table."""
    text = measure_all(folder)
    return pandas.DataFrame({"line": text.splitlines()})


def collisions(design: Design, work: str | Path, folder: Path) -> pandas.DataFrame:
    """Two grains against closed forms, over the time step."""
    return collision_errors(COLLISION_STEPS)


def lammps(design: Design, work: str | Path, folder: Path) -> pandas.DataFrame:
    """The CV test of the baseline in LAMMPS and on the engine fused, law spring_dashpot: q/p, p and what they take.

    One row per seed and program; none where LAMMPS is not installed. `seconds`: of the loop alone, in turn.
    """
    program, rows = shutil.which("lmp"), []
    base = design.baseline("cv")
    for seed in base.seeds if program else ():
        state = read_state(specimen_file(work, base, seed))
        state = state.replace(scene=dataclasses.replace(state.scene, law="spring_dashpot"))
        state = state.replace(time_step=state.scene.time_step)
        found = shear_in_lammps(program, state, LAMMPS_RATE, base.strain, round(base.strain / base.record_strain))
        told = strength(found.axial_strain, mean_stress(found.stress), deviatoric_stress(found.stress))
        rows.append({"program": "LAMMPS", "seed": seed, **told, "seconds": found.seconds, "steps": found.steps})
        FusedEngine(state).advance(1, np.zeros((3, 3)))
        run = lk.run(state, ConstantVolume(LAMMPS_RATE, base.strain), progress=False, snapshots=0)
        p, q = run.data.lab.mean_stress().values, run.data.lab.deviatoric_stress().values
        took = {"seconds": run.wall_time, "steps": run.steps}
        rows.append({"program": "fused", "seed": seed, **strength(run.data["axial_strain"].values, p, q), **took})
    return pandas.DataFrame(
        rows,
        columns=["program", "seed", "ratio_1", "ratio_peak", "ratio_critical", "pressure_critical", "seconds", "steps"],
    )


MEASURES = {
    "settings": settings,
    "engines": engines,
    "lammps": lammps,
    "skin": skin,
    "collisions": collisions,
    "sff_family": sff_family,
    "model": model,
}
