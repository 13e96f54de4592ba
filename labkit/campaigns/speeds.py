"""Speed of the engines: a table of typical values, which `labkit campaign --measure` replaces by measured ones.

An engine takes a + b N seconds for a step of N grains; a and b are measured on two specimens of different size.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from labkit.engines import ENGINES
from labkit.engines.base import Progress
from labkit.engines.speed import speed
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.runs.run.tasks import SpecimenTask, execute
from labkit.specimens.specimen import Recipe

SIZES = (150, 1000)  # grains of the two specimens


class Speed(NamedTuple):
    """Speed of one engine on one thread.

    Args:
        start: Time to start, s.
        step: Time per step, s.
        grain_step: Time per grain and step, s.
        record_steps: Cost of a record, in equivalent steps.
        stress_steps: Cost of the stress sum for the servo, in equivalent steps.
    """

    start: float
    step: float
    grain_step: float
    record_steps: float
    stress_steps: float


# Measured by `labkit campaign quick --dry-run --measure` on two cores of a Xeon at 2.8 GHz.
TYPICAL = {
    "fused": Speed(3.0, 1.2e-5, 4.3e-8, 45.0, 0.35),
    "yade": Speed(2.0, 0.0, 9.9e-7, 25.0, 0.4),
    "lammps": Speed(2.0, 1.0e-4, 1.1e-6, 10.0, 0.05),
}


def speed_of(engine: str, speeds: Mapping[str, Speed] = TYPICAL) -> Speed:
    """Return the speed of an engine; an unknown one is assumed to be as slow as the slowest known one."""
    return speeds.get(engine, TYPICAL["yade"])


def measure_speeds(engines: Sequence[str], progress: Progress) -> dict[str, Speed]:
    """Measure speeds, engine -> Speed. Raises PhysicsError if an engine does not run."""
    speeds = {}
    with tempfile.TemporaryDirectory(prefix="labkit-") as folder:
        for number, engine in enumerate(engines):
            progress(number / len(engines), f"measuring {engine}")
            law = Scene().law if supports(engine, Scene()) else "spring_dashpot"
            speeds[engine] = _measure_speed(engine, [_specimen(grains, law, Path(folder)) for grains in SIZES])
    progress(1.0, "speeds measured")
    return speeds


def supports(engine: str, scene: Scene) -> bool:
    """True if an engine can simulate a scene."""
    try:
        ENGINES.require(engine).abilities.require_scene(scene)
    except InputError:
        return False
    return True


def _specimen(grains: int, law: str, folder: Path) -> Path:
    """Return the state file of a specimen, which is made if it is missing."""
    file = folder / f"n{grains}-{law}.state.nc"
    if not file.exists():
        recipe = Recipe(void_ratio=0.67, grains=grains, size_classes=16)
        execute(SpecimenTask(recipe=recipe, material=Scene(law=law), output=str(file)))
    return file


def _measure_speed(engine: str, files: Sequence[Path]) -> Speed:
    """Measure an engine in separate processes, on specimens of SIZES."""
    steps, begin = 3000 if engine == "fused" else 500, time.monotonic()
    first = speed(engine, files[0], steps)
    seconds, last = time.monotonic() - begin, speed(engine, files[1], steps)
    small, large = (1.0 / values["steps_per_second"] for values in (first, last))
    grain_step = max((large - small) / (SIZES[1] - SIZES[0]), 0.1 * large / SIZES[1])
    start = max(seconds - 2.0 * steps * small, 0.5)  # a fifth warms up; the rest measures records and stresses
    record_steps, stress_steps = last["steps_per_record"], last["steps_per_stress"]
    return Speed(start, max(small - grain_step * SIZES[0], 0.0), grain_step, record_steps, stress_steps)
