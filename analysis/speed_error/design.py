"""The cases of a study. A case is a test, run once with each of its seeds.

All cases take specimens of the same kind (e = 0.64, step-1 friction 0.1, at 0.5 MPa) to 30 % strain, most along CP:
it has a peak, ends near the critical state, and needs the servo; some along CV, where the pressure is not controlled.
One factor at a time is varied from the baseline, which has the standard settings but fewer grains, then pairs of
factors that could interact.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

from labkit.grains import Scene, State
from labkit.paths import Path, make_path
from labkit.servo import STANDARD, Servo
from labkit.specimens import SETTINGS, mean_grain_volume

VOID_RATIO, STEP1_FRICTION, PRESSURE = 0.64, 0.1, 0.5e6
RATE = 10.0  # 1/s, the default of the shear tests for the grains of Table 1
INERTIAL_NUMBER = 1.6e-4  # at this rate and pressure
BASELINE, PRESET = "baseline", "settings"

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
    inertial_number: float | None = None  # in place of the rate
    servo: Servo = STANDARD
    guarded: bool = True

    @property
    def name(self) -> str:
        """Path, factor and level."""
        return f"{self.path}_{self.factor}={self.level}".replace(" ", "_")

    def state(self, specimen: State) -> State:
        """The specimen with the scene of the test."""
        return specimen.replace(scene=dataclasses.replace(specimen.scene, **dict(self.scene)))

    def loading(self, strain: float | None = None) -> Path:
        """The path, to the axial strain of the case or to another."""
        pressure = {"pressure": PRESSURE} if self.path == "cp" else {}
        rate = self.rate if self.inertial_number is None else None
        return make_path(self.path, {"rate": rate, "strain": strain or self.strain, **pressure})

    def steps(self, scene: Scene) -> int:
        """Number of time steps of the test, for the scene of its specimen; about, if it has an inertial number."""
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

    def baseline(self, path: str = "cp") -> Case:
        """The case with which the others of a path are compared."""
        return next(case for case in self.cases if (case.path, case.factor) == (path, BASELINE))

    def of_settings(self, level: str, path: str = "cp") -> Case:
        """The case for one of the presets."""
        return next(case for case in self.cases if (case.path, case.factor, case.level) == (path, PRESET, level))


def _with_scene(case: Case, factor: str, level: object, **fields: Any) -> Case:
    return dataclasses.replace(case, factor=factor, level=level, scene=tuple(fields.items()))


def _at(case: Case, number: float) -> Case:
    """The case at an inertial number."""
    return dataclasses.replace(case, factor="inertial number", level=number, inertial_number=number)


def _mixed(case: Case) -> Case:
    """The case in mixed precision."""
    return dataclasses.replace(case, factor="precision", level="mixed", precision="mixed")


def _at_mixed(case: Case, number: float) -> Case:
    return dataclasses.replace(
        _mixed(_at(case, number)), factor="inertial number x precision", level=f"{number:g}, mixed"
    )


def preset(name: str, seeds: tuple[int, ...], most_grains: int | None = None) -> Case:
    """The case for one of the presets (quick, standard, reference); `most_grains` caps its size."""
    chosen = SETTINGS[name]
    case = Case(
        PRESET,
        name,
        seeds,
        chosen.grains or 0,
        side=chosen.side,
        snapshots=20,
        rate=RATE * chosen.rate_factor,
        scene=(("time_step_factor", chosen.time_step_factor),),
    )
    return dataclasses.replace(case, side=None, grains=most_grains) if most_grains else case


def one_factor(base: Case) -> Iterator[Case]:
    """Varies one factor at a time."""
    yield from (_with_scene(base, "time step", factor, time_step_factor=factor) for factor in (0.05, 0.1, 0.3))
    for factor in (0.36, 0.5, 0.7, 0.9, 1.2):  # at the limit and above; the checks would refuse most of these
        yield dataclasses.replace(_with_scene(base, "time step", factor, time_step_factor=factor), guarded=False)
    # the inertial number is 1e-5 here
    yield dataclasses.replace(base, factor="rate", level=0.67, rate=0.67, seeds=base.seeds[:2])
    for rate in (2.5, 5.0, 20.0, 50.0, 100.0, 200.0, 670.0):
        yield dataclasses.replace(base, factor="rate", level=rate, rate=rate)
    yield from (_at(base, number) for number in (1e-4, 2.5e-4, 5e-4, 1e-3))
    yield _mixed(base)
    for interval in (1, 20, 100, 500):
        yield dataclasses.replace(base, factor="servo interval", level=interval, servo=Servo(interval=interval))
    for gain in (0.2, 0.7, 6.0, 20.0):
        yield dataclasses.replace(base, factor="servo gain", level=gain, servo=Servo(gain=gain))
    for strain in (1e-4, 1e-2):
        yield dataclasses.replace(base, factor="record interval", level=strain, record_strain=strain)
    for damping in (0.05, 0.1, 0.4, 0.7):
        yield _with_scene(base, "local damping", damping, local_damping=damping)
    yield _with_scene(base, "law", "paper", law="spring_dashpot")
    yield _with_scene(base, "law", "paper, no tangential dashpot", law="spring_dashpot", beta_t=0.0)
    yield _with_scene(base, "law", "paper, beta 0.05", law="spring_dashpot", beta_n=0.05, beta_t=0.05)
    yield _with_scene(base, "law", "yade, mean rolling limit right", rolling_limit_scale=1.064)
    yield _with_scene(base, "rolling", "off, law yade", rolling_friction=0.0)
    yield _with_scene(base, "rolling", "off, law paper", law="spring_dashpot", rolling_friction=0.0)
    for modulus in (0.03e9, 0.75e9):
        case = dataclasses.replace(base, factor="Young's modulus", level=modulus)
        yield dataclasses.replace(case, material=(("young_modulus", modulus),))


def pairs(base: Case) -> Iterator[Case]:
    """Pairs of factors that could interact: a high strain rate with factors whose effects decay slowly, etc."""
    yield from (_at_mixed(base, number) for number in (2.5e-4, 1e-3))
    for rate in (50.0, 200.0):
        fast = dataclasses.replace(base, rate=rate)
        yield _with_scene(fast, "rate x local damping", f"{rate:g}, 0.05", local_damping=0.05)
        yield _with_scene(fast, "rate x local damping", f"{rate:g}, 0.7", local_damping=0.7)
        yield _with_scene(fast, "rate x law", f"{rate:g}, paper", law="spring_dashpot")
        yield _with_scene(fast, "rate x time step", f"{rate:g}, 0.05", time_step_factor=0.05)
        yield _with_scene(fast, "rate x time step", f"{rate:g}, 0.36", time_step_factor=0.36)
        yield dataclasses.replace(fast, factor="rate x servo interval", level=f"{rate:g}, 50", servo=Servo(interval=50))
        soft = dataclasses.replace(fast, factor="rate x Young's modulus", level=f"{rate:g}, 3e7")
        yield dataclasses.replace(soft, material=(("young_modulus", 0.03e9),))
    for factor in (0.4, 0.6, 0.777):  # with this law, 0.777 gives 0.41 sqrt(m/kn)
        case = _with_scene(base, "time step x law", f"{factor:g}, paper", law="spring_dashpot", time_step_factor=factor)
        yield dataclasses.replace(case, guarded=False)
    for factor, damping in ((0.36, 0.7), (0.7, 0.7), (0.7, 0.0)):
        fields = {"time_step_factor": factor, "local_damping": damping}
        case = _with_scene(base, "time step x local damping", f"{factor:g}, {damping:g}", **fields)
        yield dataclasses.replace(case, guarded=False)


def sizes(base: Case, sizes_and_seeds: Sequence[tuple[int, tuple[int, ...]]]) -> Iterator[Case]:
    """Specimens of different numbers of grains."""
    for grains, seeds in sizes_and_seeds:
        yield dataclasses.replace(base, factor="grains", level=grains, grains=grains, seeds=seeds)


def engines(base: Case, grains: int, seeds: tuple[int, ...]) -> Iterator[Case]:
    """The same small test on both engines."""
    for engine in ("fused", "yade"):
        yield dataclasses.replace(base, factor="engine", level=engine, engine=engine, grains=grains, seeds=seeds)


def constant_volume(base: Case) -> Iterator[Case]:
    """CV tests: the baseline and the factors on which the pressure could depend."""
    base = dataclasses.replace(base, path="cv")
    yield base
    yield from (dataclasses.replace(base, factor="rate", level=rate, rate=rate) for rate in (2.5, 50.0, 200.0))
    yield from (_with_scene(base, "time step", factor, time_step_factor=factor) for factor in (0.1, 0.36))
    yield from (_at(base, number) for number in (2.5e-4, 1e-3))
    yield _mixed(base)
    yield _at_mixed(base, 2.5e-4)
    yield _with_scene(base, "local damping", 0.7, local_damping=0.7)
    yield _with_scene(base, "law", "paper", law="spring_dashpot")


def full() -> Design:
    """The study of results/speed_error: about five hours of computing."""
    seeds = (1, 2, 3)
    base = Case(BASELINE, "standard settings, 1000 grains", seeds, 1000)
    cases = [base, *one_factor(base), *pairs(base), *engines(dataclasses.replace(base, rate=40.0), 500, seeds)]
    cases += sizes(base, ((500, tuple(range(1, 9))), (2000, seeds), (4000, seeds)))
    cases += [preset("quick", seeds), preset("standard", seeds), preset("reference", seeds)]
    papers = preset("standard", seeds[:2])
    cases.append(dataclasses.replace(papers, level="the paper's", scene=(("law", "spring_dashpot"),)))
    cases += constant_volume(base)
    along_cv = preset("quick", seeds, 1000), preset("standard", seeds, 1000), preset("reference", seeds, 1000)
    cases += [dataclasses.replace(case, path="cv", snapshots=2) for case in along_cv]
    measures = "settings", "engines", "lammps", "skin", "collisions", "sff_family", "model"
    return Design(tuple(cases), measures)


def small() -> Design:
    """A study of one minute, to try the command: one or two levels of each factor, tests to 6 % strain."""
    seeds = (1, 2)
    base = Case(BASELINE, "standard settings, 150 grains", seeds, 150, rate=100.0, strain=0.06)
    chosen = {
        "time step=0.1",
        "time step=1.2",
        "local damping=0.7",
        "law=paper",
        "servo interval=20",
        "Young's modulus=750000000.0",
    }
    cases = [base, *(case for case in one_factor(base) if f"{case.factor}={case.level}" in chosen)]
    cases.append(dataclasses.replace(base, path="cv"))
    cases.append(dataclasses.replace(base, factor="rate", level=400.0, rate=400.0))
    cases.append(_at(dataclasses.replace(base, seeds=(1,)), 2e-3))
    cases += sizes(base, ((300, seeds),))
    cases += engines(base, 150, (1,))
    for name in SETTINGS:
        case = preset(name, seeds, 150 if name == "quick" else 300)
        case = dataclasses.replace(case, rate=10.0 * case.rate, strain=0.06)
        cases += [case, dataclasses.replace(case, path="cv")]
    return Design(tuple(cases), ("settings", "collisions", "sff_family"), timed_steps=500)


DESIGNS = {"full": full, "small": small}
