"""The hard cases: named, repeatable scenarios in which a DEM simulation may go wrong, as data.

The functions in `cases` run and judge them. `should` states what the physics requires, and each statement is backed by
a check that can fail.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from labkit.paths import Path, make_path

GRAINS = 500
ENGINES = {  # name in tables -> engine and precision
    "yade": ("yade", "double"),
    "fused": ("fused", "double"),
    "mixed": ("fused", "mixed"),
}
CORRECT, CLEAR_ERROR, LIMIT_REPORTED, SILENT_WRONG = "correct", "clear error", "limit reported", "SILENT WRONG"


@dataclasses.dataclass(frozen=True, kw_only=True)
class HardScene:
    """A specimen and a loading path. Scenes that are not plain tests have no path; their case builds the run.

    Args:
        should: What the physics requires.
        verdict: Verdict if the run completes and all checks hold.
        void_ratio: Void ratio of the specimen.
        step1_friction: Friction of the specimen in step 1.
        path: Name of the loading path.
        strain: Axial strain, or the largest of the reversals.
        rate: Strain rate, 1/s.
        pressure: Pressure, for paths that need one, Pa.
        reversals: Reversals of cyclic_cp, as fractions of `strain`.
        cycles: Number of cycles between +-`strain`.
        judges_c0: True if C0 must be close to Love's stress.
    """

    name: str
    should: str
    verdict: str = CORRECT
    void_ratio: float = 0.67
    step1_friction: float = 0.15
    path: str = ""
    strain: float = 0.0
    rate: float | None = None
    pressure: float | None = None
    reversals: tuple[float, ...] | None = None
    cycles: int | None = None
    judges_c0: bool = True

    def loading(self, extent: float = 1.0) -> Path:
        """The loading path.

        `extent`: fraction of the strains, or of the number of cycles, 1 for the whole test. A path that ends at a
        pressure is not shortened.
        """
        values: dict[str, Any] = {
            "rate": self.rate,
            "pressure": None if self.pressure is None else f"{self.pressure:g} Pa",
        }
        if self.cycles:
            turns = (1.0, -1.0) * max(4, round(self.cycles * extent)) + (1.0,)
            values["reversals"] = tuple(_rounded(x * self.strain) for x in turns)
        elif self.reversals:
            values["reversals"] = tuple(_rounded(x * self.strain * extent) for x in self.reversals)
        else:
            values["strain"] = _rounded(self.strain * (1.0 if self.path in ("isoc", "isod") else extent))
        return make_path(self.path, values)


def _rounded(strain: float) -> float:
    return float(f"{strain:.6g}")


_ALL = (
    HardScene(
        name="loose_cv",
        should="p falls to less than 5 % of its initial value and stays positive; the volume is held, q/p equals "
        "that of a sliding assembly, and p drops at the same strain as with half the time step",
        verdict=LIMIT_REPORTED,
        void_ratio=0.77,
        step1_friction=0.4,
        path="cv",
        strain=0.25,
        rate=20.0,
    ),
    HardScene(
        name="isod_to_nothing",
        should="the last contact opens: stress exactly 0, Z = 0, A and F undefined (NaN); grains move in straight "
        "lines; sheared in that state, the cell carries no stress until grains touch again",
        verdict=LIMIT_REPORTED,
        path="isod",
        strain=-0.2,
        rate=5.0,
        pressure=1e-3,
    ),
    HardScene(
        name="isoc_beyond",
        should="p reaches 3 MPa with equal strains; the mean overlap then exceeds 2 %, and the run reports it; more "
        "than 3 MPa is refused",
        verdict=LIMIT_REPORTED,
        void_ratio=0.77,
        step1_friction=0.4,
        path="isoc",
        strain=0.1,
        rate=5.0,
    ),
    HardScene(
        name="growing_cycles",
        should="p is held, q changes sign with the direction of strain, each leg dissipates more energy than the "
        "shorter one before it; same results as with half the time step",
        path="cyclic_cp",
        strain=0.03,
        rate=20.0,
        pressure=0.5e6,
        reversals=(1 / 6, -1 / 6, 1 / 3, -1 / 3, 2 / 3, -2 / 3, 1.0),
    ),
    HardScene(
        name="many_cycles",
        should="100 cycles of 0.05 %: p does not drift; the drift of e per cycle decreases (decaying ratcheting), "
        "and e is the same as with half the time step",
        path="cyclic_cp",
        strain=5e-4,
        rate=20.0,
        pressure=0.5e6,
        cycles=100,
    ),
    HardScene(
        name="very_dense",
        should="e = 0.3 exceeds the limits (p > 3 MPa, overlap > 2 %), and the run reports it; the energy balance "
        "closes",
        verdict=LIMIT_REPORTED,
        void_ratio=0.3,
        step1_friction=0.1,
        path="cv",
        strain=0.1,
        rate=20.0,
    ),
    HardScene(
        name="very_loose",
        should="at e = 0.95 no load-bearing skeleton forms: no specimen is made, and the error says what to change",
        verdict=CLEAR_ERROR,
        void_ratio=0.95,
        step1_friction=0.4,
    ),
    HardScene(
        name="step_under",
        should="a time step of 0.97 of the stability limit gives the same results as half that step",
        path="cv",
        strain=0.1,
        rate=20.0,
    ),
    HardScene(
        name="step_over",
        should="a time step of 1.03 times the limit is refused; 3 times the limit, which cannot be detected at the "
        "start because there are no contacts yet, is stopped by the energy balance",
        verdict=CLEAR_ERROR,
        path="cv",
        strain=0.1,
        rate=20.0,
    ),
    HardScene(
        name="step_outgrown",
        should="a time step just below the limit of a specimen with few contacts exceeds the limit once there are "
        "many: the results match those with half that step, or the energy balance stops the run",
        verdict=LIMIT_REPORTED,
        path="isoc",
        strain=0.1,
        rate=5.0,
    ),
    HardScene(
        name="fast",
        should="20 times the quasi-static rate: the run reports that its inertial number exceeds the limit; the "
        "energy balance closes, and q/p is not below the quasi-static value",
        verdict=LIMIT_REPORTED,
        path="cv",
        strain=0.4,
        rate=200.0,
    ),
    HardScene(
        name="deep_overlaps",
        should="grains placed at random and not relaxed: the state is refused whether or not it lists their contacts",
        verdict=CLEAR_ERROR,
        path="cv",
        strain=0.02,
        rate=20.0,
    ),
    HardScene(
        name="size_ratio_5",
        should="grain sizes from 1 to 5: the time step of the mean grain is refused if it exceeds the limit of the"
        " small grains; with the usual time step the results match those with half that step; `labkit verify` "
        "reports that C0, which assumes equal stress in grains of all sizes, differs from Love's stress",
        verdict=LIMIT_REPORTED,
        void_ratio=0.6,
        path="cv",
        strain=0.1,
        rate=20.0,
        judges_c0=False,
    ),
    HardScene(
        name="few_grains",
        should="500 grains: the strength agrees with the paper's within the scatter expected for so few grains, C0 "
        "with Love's stress within 6 %",
        path="cv",
        strain=0.4,
        rate=20.0,
    ),
    HardScene(
        name="strain_100",
        should="the cell reaches ln(h0/h) = 1 with its volume held; the critical state is the same as with half the "
        "time step",
        path="cv",
        strain=1.0,
        rate=40.0,
    ),
    HardScene(
        name="thin_cell",
        should="120 grains, in a cell that becomes thinner than two grains: fused continues, and the stress it "
        "reports matches the stress recomputed from the contacts; YADE cannot continue, and says so",
        path="cv",
        strain=0.8,
        rate=80.0,
    ),
    HardScene(
        name="restart_in_reversal",
        should="killed at a reversal of a cyclic test and resumed: the same records to the last bit",
        path="cyclic_cp",
        strain=0.01,
        rate=20.0,
        pressure=0.5e6,
        reversals=(1.0, -1.0, 0.5),
    ),
    HardScene(
        name="gentle_servo",
        should="e = 0.77 and p = 10 kPa: the servo reaches p and holds it within 0.5 % RMS and 2 % at most",
        verdict=LIMIT_REPORTED,
        void_ratio=0.77,
        step1_friction=0.4,
        path="cp",
        strain=0.02,
        rate=5.0,
        pressure=10e3,
    ),
)

SCENES = {scene.name: scene for scene in _ALL}
