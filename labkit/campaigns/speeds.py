"""Speed of the engines on this computer: measured once and cached, or a typical value.

An engine takes a + b N seconds for a step of N grains; a and b are measured on two specimens of different size.
"""

from __future__ import annotations

import dataclasses
import json
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from labkit.engines import ENGINES
from labkit.engines.base import Progress
from labkit.engines.speed import speed
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.io.atomic import write_text
from labkit.io.caches import cache_folder
from labkit.io.provenance import machine
from labkit.runs.tasks import SpecimenTask, execute
from labkit.specimens.specimen import Recipe

SIZES = (150, 1000)  # grains of the two specimens
STEPS = {"fused": 3000}
OTHER_STEPS = 500  # steps of any other engine


@dataclasses.dataclass(frozen=True)
class Speed:
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

    def seconds(self, steps: float, grains: float) -> float:
        """Time, s, for the given number of steps and grains."""
        return steps * (self.step + self.grain_step * grains)


# Measured on two cores of a Xeon at 2.8 GHz; used if nothing was measured, for example on a cluster.
TYPICAL = {
    "fused": Speed(3.0, 1.2e-5, 4.3e-8, 45.0, 0.35),
    "yade": Speed(2.0, 0.0, 9.9e-7, 25.0, 0.4),
    "lammps": Speed(2.0, 1.0e-4, 1.1e-6, 10.0, 0.05),
}


def typical_speeds(engines: Iterable[str]) -> dict[str, Speed]:
    """Return typical speeds, engine -> Speed; an unknown engine is assumed to be as slow as the slowest known one."""
    return {engine: TYPICAL.get(engine, TYPICAL["yade"]) for engine in engines}


def known_speeds(engines: Iterable[str]) -> dict[str, Speed] | None:
    """Return speeds measured earlier on this computer, engine -> Speed, or None if any has not been measured."""
    try:
        file = cache_file()
        known = json.loads(file.read_text())[computer()] if file else {}
        return {engine: Speed(**known[engine]) for engine in engines}
    except (OSError, ValueError, KeyError, TypeError):
        return None


def likely_speed(engine: str) -> Speed:
    """Return the speed of an engine, measured earlier on this computer or typical."""
    return (known_speeds([engine]) or typical_speeds([engine]))[engine]


def cache_file() -> Path | None:
    """Return the file that stores the measured speeds, None if labkit has no folder for it."""
    folder = cache_folder("speeds")
    return folder and folder / "speed.json"


def computer() -> str:
    """Return a string that identifies this computer."""
    here = machine()
    return f"{here['name']}, {here['processor']}, {here['cores']} cores"


def measure_speeds(engines: Sequence[str], progress: Progress) -> dict[str, Speed]:
    """Measure and store speeds, engine -> Speed. Raises PhysicsError if an engine does not run."""
    with tempfile.TemporaryDirectory(prefix="labkit-") as folder:
        speeds = {}
        for number, engine in enumerate(engines):
            progress(number / len(engines), f"measuring {engine}")
            law = Scene().law if supports(engine, Scene()) else "spring_dashpot"
            files = [_specimen(grains, law, Path(folder)) for grains in SIZES]
            speeds[engine] = _speed_of(engine, files)
        progress(1.0, "speeds measured")
    _store(speeds)
    return speeds


def supports(engine: str, scene: Scene) -> bool:
    """True if an engine can simulate a scene."""
    try:
        ENGINES.require(engine).abilities.require_scene(scene, None)
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


def _speed_of(engine: str, files: Sequence[Path]) -> Speed:
    steps = STEPS.get(engine, OTHER_STEPS)
    runs = [_time_speed(engine, file, steps) for file in files]
    small, large = (1.0 / values["steps_per_second"] for _, values in runs)
    grain_step = max((large - small) / (SIZES[1] - SIZES[0]), 0.1 * large / SIZES[1])
    step = max(small - grain_step * SIZES[0], 0.0)
    start = max(runs[0][0] - 2.0 * steps * small, 0.5)  # a fifth warms up; the rest measures records and stresses
    last = runs[1][1]
    return Speed(start, step, grain_step, last["steps_per_record"], last["steps_per_stress"])


def _time_speed(engine: str, file: Path, steps: int) -> tuple[float, dict[str, float]]:
    """Measure in a separate process; returns (seconds, {quantity: value})."""
    begin = time.monotonic()
    values = speed(engine, file, steps)
    return time.monotonic() - begin, values


def _store(speeds: Mapping[str, Speed]) -> None:
    file = cache_file()
    if file is None:
        return
    try:
        known = json.loads(file.read_text()) if file.exists() else {}
        here = {**known.get(computer(), {}), **{name: dataclasses.asdict(one) for name, one in speeds.items()}}
        write_text(file, json.dumps({**known, computer(): here}, indent=1))
    except (OSError, ValueError):  # also a link
        return  # will be measured again next time
