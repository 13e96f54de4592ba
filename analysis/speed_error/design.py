"""The cases of a study, from `design.yaml`. A case is a test, run once with each of its seeds.

All cases take specimens of the same kind (e = 0.64, step-1 friction 0.1, at 0.5 MPa) to 30 % strain, most along CP:
it has a peak, ends near the critical state, and needs the servo; some along CV, where the pressure is not controlled.
One factor at a time is varied from the baseline, which has the standard settings but fewer grains, then pairs of
factors that could interact.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from analysis.places import read_yaml
from labkit.grains import Scene, State
from labkit.paths import Path as Loading
from labkit.paths import make_path
from labkit.servo import STANDARD, Servo
from labkit.specimens import SETTINGS, mean_grain_volume

VOID_RATIO, STEP1_FRICTION, PRESSURE = 0.64, 0.1, 0.5e6
RATE = 10.0  # 1/s, the default of the shear tests for the grains of Table 1
INERTIAL_NUMBER = 1.6e-4  # the inertial number at this rate and pressure
BASELINE, PRESET, MIXED = "baseline", "settings", "mixed"

Fields = tuple[tuple[str, Any], ...]  # (name, value) of fields of a Scene


@dataclasses.dataclass(frozen=True)
class Case:
    """A test with one `level` of a `factor`.

    `scene` holds fields of the Scene that differ in the test, `material` those that already differ when the specimen is
    made; both are (name, value) pairs. `side` (m) takes precedence over `grains`.
    """

    factor: str
    level: object
    seeds: tuple[int, ...]
    grains: int
    path: str = "cp"
    side: float | None = None
    scene: Fields = ()
    material: Fields = ()
    rate: float = RATE
    strain: float = 0.3
    record_strain: float = 1e-3
    snapshots: int = 2
    engine: str = "fused"
    threads: int = 1
    precision: str = "double"
    inertial_number: float | None = None  # replaces the rate
    servo: Servo = STANDARD
    guarded: bool = True

    @property
    def name(self) -> str:
        """Path, factor and level."""
        return f"{self.path}_{self.factor}={self.level}".replace(" ", "_")

    def state(self, specimen: State) -> State:
        """The specimen with the scene of the test."""
        return specimen.replace(scene=dataclasses.replace(specimen.scene, **dict(self.scene)))

    def loading(self, strain: float | None = None) -> Loading:
        """The path, to the axial strain of the case or to another."""
        pressure = {"pressure": PRESSURE} if self.path == "cp" else {}
        rate = self.rate if self.inertial_number is None else None
        return make_path(self.path, {"rate": rate, "strain": strain or self.strain, **pressure})

    def steps(self, scene: Scene) -> int:
        """Number of time steps of a test for the scene of its specimen; approximate with an inertial number."""
        rate = self.rate if self.inertial_number is None else RATE * self.inertial_number / INERTIAL_NUMBER
        return round(self.strain / (rate * dataclasses.replace(scene, **dict(self.scene)).time_step))

    @property
    def cost(self) -> float:
        """Cost estimate: steps times grains, times 15 in YADE; the most expensive tests start first."""
        scene = Scene(**dict(self.material))
        grains = self.side**3 / (1.0 + VOID_RATIO) / mean_grain_volume(scene) if self.side else self.grains
        return self.steps(scene) * grains * (15.0 if self.engine == "yade" else 1.0)


@dataclasses.dataclass(frozen=True)
class Design:
    """All cases of a study, and the names of its additional measurements (analysis.speed_error.measures).

    timed_steps: time steps over which presets are timed. Each path has one case of the factor BASELINE and one of the
    factor PRESET with the level "reference".
    """

    cases: tuple[Case, ...]
    measures: tuple[str, ...]
    timed_steps: int = 5000

    @property
    def yardstick_steps(self) -> int:
        """Number of steps of the yardstick (analysis.speed_error.jobs): 0.3 of the timed steps."""
        return round(0.3 * self.timed_steps)

    def baseline(self, path: str = "cp") -> Case:
        """The case with which the others of a path are compared."""
        return next(case for case in self.cases if (case.path, case.factor) == (path, BASELINE))

    def of_settings(self, level: str, path: str = "cp") -> Case:
        """The case for one of the presets."""
        return next(case for case in self.cases if (case.path, case.factor, case.level) == (path, PRESET, level))


def preset(name: str, seeds: tuple[int, ...]) -> Case:
    """The case for one of the presets (quick, standard, reference)."""
    chosen = SETTINGS[name]
    scene, rate = (("time_step_factor", chosen.time_step_factor),), RATE * chosen.rate_factor
    return Case(PRESET, name, seeds, chosen.grains or 0, side=chosen.side, snapshots=20, rate=rate, scene=scene)


def case_of(base: Case, fields: Mapping[str, Any]) -> Case:
    """The case of a line of `design.yaml`: what it changes in the baseline, or in the preset that it names."""
    rest = dict(fields)
    if "settings" in rest:
        base = preset(rest.pop("settings"), base.seeds)
    own = {field.name: rest.pop(field.name) for field in dataclasses.fields(Case) if field.name in rest}
    servo = {field.name: rest.pop(field.name) for field in dataclasses.fields(Servo) if field.name in rest}
    own |= {"servo": Servo(**servo)} if servo else {}
    own |= {"seeds": tuple(own["seeds"])} if "seeds" in own else {}
    own |= {"material": tuple(own["material"].items())} if "material" in own else {}
    own |= {"scene": tuple(rest.items())} if rest else {}
    return dataclasses.replace(base, **own)


def read_design(name: str) -> Design:
    """A design of `design.yaml`."""
    given = DESIGNS[name]
    base = Case(**{"factor": BASELINE, **given["baseline"], "seeds": tuple(given["baseline"]["seeds"])})
    cases = [base, *(case_of(base, fields) for fields in given["cases"])]
    return Design(tuple(cases), tuple(given["measures"]), given.get("timed_steps", Design.timed_steps))


DESIGNS: dict[str, Any] = read_yaml(Path(__file__).with_suffix(".yaml"))
