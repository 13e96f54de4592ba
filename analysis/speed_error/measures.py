"""The measurements of a study in addition to its tests, each kept as a table in the folder of the study.

They are: the engines in turn on one scene, the Verlet skin, collisions of two grains, the family of
stress-force-fabric relationships, and the integrators of the model.
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
from analysis.pictures import save
from analysis.speed_error.collisions import collision_errors
from analysis.speed_error.design import BASELINE, MIXED, PRESET, Case, Design
from analysis.speed_error.jobs import make, run_case, run_file
from analysis.speed_error.lammps import shear_in_lammps
from analysis.speed_error.observables import strength
from benchmarks.engines import bench
from benchmarks.model import measure_all
from labkit.engines import Device, FusedEngine, Progress
from labkit.figures import sff_figures
from labkit.files import whole_file
from labkit.grains import State, read_state
from labkit.micro import deviatoric_stress, mean_stress
from labkit.model import Adaptive, Model, drive, isotropic_state, model_path
from labkit.paths import ConstantVolume
from labkit.servo import prescribed_gradient

SKINS = (None, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2)  # in mean diameters; None: chosen by the engine
SKIN_STEPS, SKIN_ROUNDS = 2000, 5
COLLISION_STEPS = (0.4, 0.2, 0.1, 0.05, 0.025)  # in sqrt(m/kn) of the mean grain
LAMMPS_RATE = 40.0  # 1/s
LAMMPS_COLUMNS = "program seed ratio_1 ratio_peak ratio_critical pressure_critical seconds steps".split()
MODEL_STRAIN, MODEL_ROUNDS = 0.6, 10
SETTINGS_ROUNDS = 3

Times = dict[float | None, list[float]]  # Verlet skin -> seconds of each round
Positions = dict[float | None, np.ndarray]  # Verlet skin -> positions at the end


def measure_others(design: Design, work: str | Path, progress: Progress) -> dict[str, pandas.DataFrame]:
    """Tables of the additional measurements of the design by name; those already in the folder are read."""
    folder = Path(work) / "measures"
    folder.mkdir(exist_ok=True)
    tables = {}
    for number, name in enumerate(design.measures):
        progress(number / len(design.measures), name)
        file = folder / f"{name}.csv"
        if not file.exists():
            table = MEASURES[name](design, work, folder)
            with whole_file(file) as temporary:
                table.to_csv(temporary, index=False, float_format="%.6g")
        tables[name] = pandas.read_csv(file)
    progress(1.0, "measured")
    return tables


def settings(design: Design, work: str | Path, folder: Path) -> pandas.DataFrame:
    """Time of a whole test with each preset, and its ratio to the standard settings.

    The presets, the baseline and the cases in mixed precision are timed in turn, servo and records included.
    """
    cases = [case for case in design.cases if case.factor in (PRESET, MIXED, BASELINE)]
    seconds: dict[Case, list[float]] = {case: [] for case in cases}
    for _turn in range(SETTINGS_ROUNDS + 1):  # the first turn compiles
        for case in cases:
            state = case.state(read_state(make(work, case, case.seeds[0])))
            path = case.loading(case.rate * state.scene.time_step * design.timed_steps)
            run = lk.run(
                state,
                path,
                progress=False,
                record_strain=case.record_strain,
                snapshots=0,
                servo=case.servo,
                engine=Device("fused", precision=case.precision),
            )
            seconds[case].append(run.wall_time / run.steps)
    rows = []
    for case in cases:
        steps = case.steps(read_state(make(work, case, case.seeds[0])).scene)
        standard = next(other for other in cases if (other.path, other.level) == (case.path, "standard"))
        each, over = seconds[case][1:], [a / b for a, b in zip(seconds[case][1:], seconds[standard][1:], strict=True)]
        ratio = steps / standard.steps(read_state(make(work, standard, standard.seeds[0])).scene)
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
    """Steps per second of each engine in turn, on the specimens of the baseline and of the standard settings."""
    rows = []
    for case in (design.baseline(), design.of_settings("standard")):
        file = make(work, case, case.seeds[0])
        grains = read_state(file).number_of_grains
        timings = bench(str(file), max(20, int(600_000 / grains)), 3, lambda fraction, text: None)
        base = [turn["steps_per_second"] for turn in next(iter(timings.values()))]
        for name, turns in timings.items():
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
    """Time per step, and largest difference of positions in mean diameters, for several Verlet skins."""
    rows = []
    for case in (design.baseline(), design.of_settings("standard")):
        state = read_state(make(work, case, case.seeds[0]))
        for rate in (10.0, 200.0):
            seconds, ends = _skins(state, prescribed_gradient(ConstantVolume(rate), state.time_step))
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


def _skins(state: State, gradient: np.ndarray) -> tuple[Times, Positions]:
    seconds: Times = {value: [] for value in SKINS}
    ends: Positions = {}
    for _ in range(SKIN_ROUNDS):
        for value in SKINS:
            engine = FusedEngine(state, skin=value)
            start = time.perf_counter()
            engine.advance(SKIN_STEPS, gradient)
            seconds[value].append(time.perf_counter() - start)
            ends[value] = engine.state().position
    return seconds, ends


def sff_family(design: Design, work: str | Path, folder: Path) -> pandas.DataFrame:
    """Error and cost of every stress-force-fabric relationship in a test with the standard settings."""
    case = design.of_settings("standard")
    if not run_file(work, case, case.seeds[0]).exists():  # the test comes from an earlier study
        yardstick = make(work, design.baseline(), design.baseline().seeds[0])
        run_case(work, case, case.seeds[0], yardstick, design.yardstick_steps)
    with lk.open_run(run_file(work, case, case.seeds[0])) as run:
        figure, table = sff_figures.family(run)
    save(figure, folder / "sff_family.png")
    return table


def model(design: Design, work: str | Path, folder: Path) -> pandas.DataFrame:
    """Time and stress error of one CV path of the model with the default tolerance.

    Writes model_speed.txt and model_speed.png, which compare all integrators, into `folder`.
    """
    measure_all(folder)
    material = Model()
    start = isotropic_state(material, 0.67, 0.5e6)
    path = model_path("cv", 0.5e6, strain=MODEL_STRAIN)
    exact = drive(material, path, start, integrator=Adaptive(1e-12)).require().stress
    seconds = []
    for _ in range(MODEL_ROUNDS):
        begin = time.thread_time()
        stress = drive(material, path, start).require().stress
        seconds.append(time.thread_time() - begin)
    error = np.linalg.norm(stress - exact, axis=(1, 2)).max() / np.linalg.norm(exact, axis=(1, 2)).max()
    row = {"strain": MODEL_STRAIN, "records": len(stress), "milliseconds": 1e3 * statistics.median(seconds)}
    return pandas.DataFrame([row | {"stress_error": error}])


def collisions(design: Design, work: str | Path, folder: Path) -> pandas.DataFrame:
    """Collisions of two grains compared with closed forms, for several time steps."""
    return collision_errors(COLLISION_STEPS)


def lammps(design: Design, work: str | Path, folder: Path) -> pandas.DataFrame:
    """Strength, pressure and time of the baseline's CV test in LAMMPS and on `fused` with the `spring_dashpot` law.

    One row per seed and program, no rows if LAMMPS is not installed. `seconds`: time of the loop only.
    """
    program, rows = shutil.which("lmp"), []
    base = design.baseline("cv")
    if program is None:
        return pandas.DataFrame(columns=LAMMPS_COLUMNS)
    for seed in base.seeds:
        state = read_state(make(work, base, seed))
        state = state.replace(scene=dataclasses.replace(state.scene, law="spring_dashpot"))
        state = state.replace(time_step=state.scene.time_step)
        test = shear_in_lammps(program, state, LAMMPS_RATE, base.strain, round(base.strain / base.record_strain))
        values = strength(test.axial_strain, mean_stress(test.stress), deviatoric_stress(test.stress))
        rows.append({"program": "LAMMPS", "seed": seed, **values, "seconds": test.seconds, "steps": test.steps})
        FusedEngine(state).advance(1, np.zeros((3, 3)))
        run = lk.run(state, ConstantVolume(LAMMPS_RATE, base.strain), progress=False, snapshots=0)
        p, q = run.data.lab.mean_stress().values, run.data.lab.deviatoric_stress().values
        values = strength(run.data["axial_strain"].values, p, q)
        rows.append({"program": "fused", "seed": seed, **values, "seconds": run.wall_time, "steps": run.steps})
    return pandas.DataFrame(rows, columns=LAMMPS_COLUMNS)


MEASURES = {
    "settings": settings,
    "engines": engines,
    "lammps": lammps,
    "skin": skin,
    "collisions": collisions,
    "sff_family": sff_family,
    "model": model,
}
