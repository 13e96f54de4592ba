"""Speed of the engine cuda as a function of the size of specimens and their number in a batch."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import NamedTuple

import pandas

from benchmarks.kernel import copies
from labkit.engines.base import Progress
from labkit.engines.cuda.batch import Batch
from labkit.engines.cuda.device import SIMULATED, cuda
from labkit.engines.cuda.memory import memory_of, room
from labkit.grains.state import State
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import mean_stress
from labkit.paths.path import Path
from labkit.paths.rates import on_grains, rate_of
from labkit.paths.standard import ConstantMeanStress, ConstantVolume
from labkit.paths.step import Here
from labkit.servo.correction import STANDARD, cell_stiffness
from labkit.servo.plan import Corrections, correcting_of, corrections_of


def bandwidth() -> float:
    """Peak bandwidth of the device's memory, bytes per second; NaN if the driver does not report it."""
    if SIMULATED:
        return math.nan
    device = cuda.get_current_device()
    clock, width = (getattr(device, name, math.nan) for name in ("MEMORY_CLOCK_RATE", "GLOBAL_MEMORY_BUS_WIDTH"))
    return 2.0 * clock * 1e3 * width / 8.0  # kHz, two transfers per cycle, bits


class Case(NamedTuple):
    """A batch to measure: approximate grains per specimen, number of specimens, and whether stresses are held."""

    grains: int
    states: int
    servo: bool = False


CASES = (
    *(Case(1_000, states) for states in (1, 24, 400)),
    *(Case(14_000, states) for states in (1, 24, 96)),
    Case(14_000, 24, servo=True),
    Case(110_000, 1),
    Case(110_000, 8),
    Case(1_000_000, 1),
)
GRAIN_STEPS = 3e8  # per measurement
BYTES = {"double": 1_580.0, "mixed": 1_290.0}  # memory traffic per grain and step, an estimate (docs/gpu.md)
STRAIN = 0.2  # axial strain of the tests whose time is estimated


def gpu(state: State, progress: Progress, cases: Sequence[Case] = CASES, work: float = GRAIN_STEPS) -> pandas.DataFrame:
    """Measure batches of a specimen and its copies; one row per precision and batch that fits the GPU.

    The columns are grains (of one specimen), states, servo, precision, step (s per time step), rate (grain-steps per
    second), share (of the peak bandwidth, estimated), memory (GB, estimated) and test (minutes for the whole batch to
    an axial strain of 20 % at the default rate, without records). Raises InputError without a GPU.

    Args:
        state: The specimen.
        progress: Called with the progress.
        cases: Batches to measure.
        work: Grain-steps per measurement.
    """
    rows = []
    plan = [(case, precision) for case in cases for precision in BYTES]
    for number, (case, precision) in enumerate(plan):
        progress(number / len(plan), f"{case.states} x {case.grains} grains, {precision}")
        specimen = enlarge(state, case.grains)
        needed = case.states * memory_of(specimen.number_of_grains, precision)
        if needed < room():
            rows.append(_measure(specimen, case, precision, work, needed))
    progress(1.0, "done")
    return pandas.DataFrame(rows)


def enlarge(state: State, grains: int) -> State:
    """Place copies of a specimen side by side to reach about this number of grains; a larger one is returned as is."""
    ratio = max(1.0, (grains / state.number_of_grains) ** (1 / 3))
    return copies(state, [int(ratio) + (ratio % 1 > share) for share in (0.75, 0.5, 0.25)])


def _measure(specimen: State, case: Case, precision: str, work: float, memory: float) -> dict[str, float | str | bool]:
    """Measure one row of the table."""
    pressure = float(mean_stress(love_stress(specimen.snapshot())))
    path = ConstantMeanStress(pressure=pressure) if case.servo else ConstantVolume()
    path = on_grains(path, specimen.scene)
    batch, grains = Batch([specimen] * case.states, precision), case.states * specimen.number_of_grains
    steps = max(20, round(work / grains))
    _advance(batch, _corrections(specimen, path, max(10, steps // 10)))  # compiles the kernels
    plans = _corrections(specimen, path, steps)
    begin = time.perf_counter()
    _advance(batch, plans)
    step = (time.perf_counter() - begin) / steps
    whole = STRAIN / (rate_of(path) * specimen.time_step)
    return {
        "grains": specimen.number_of_grains,
        "states": case.states,
        "servo": case.servo,
        "precision": precision,
        "step": step,
        "rate": grains / step,
        "share": grains / step * BYTES[precision] / bandwidth(),
        "memory": memory / 1e9,
        "test": whole * step / 60.0,
    }


def _corrections(specimen: State, path: Path, steps: int) -> list[Corrections]:
    """Return the Corrections of a number of steps, divided as in a run."""
    step = next(iter(path.steps_from(Here())))
    stiffness = cell_stiffness(specimen.snapshot(), step.held.components) if step.held else None
    rate, dt, plans = rate_of(path), specimen.time_step, []
    for first in range(0, steps, STANDARD.interval * 100):
        servo = correcting_of(step, rate, stiffness, dt, STANDARD)
        begins = range(first, min(steps, first + STANDARD.interval * 100), STANDARD.interval)
        intervals = [min(STANDARD.interval, steps - done) for done in begins]
        plans.append(corrections_of(step, rate, dt, servo, intervals, [rate * dt * done for done in begins]))
    return plans


def _advance(batch: Batch, plans: Sequence[Corrections]) -> None:
    """Advance all states of a batch by the same plans."""
    for plan in plans:
        for i in range(len(batch)):
            batch.begin(i, plan)
        while batch.going.any():
            batch.run()


def table(speeds: pandas.DataFrame) -> str:
    """Format the table as text."""
    shown = speeds.assign(step=1e3 * speeds["step"], rate=speeds["rate"] / 1e9, share=100.0 * speeds["share"])
    names = {"step": "ms/step", "rate": "1e9 grain-steps/s", "share": "% of bandwidth", "memory": "GB", "test": "min"}
    return shown.rename(columns=names).to_string(index=False, float_format="%.4g")
