"""The hard cases: named, repeatable scenes at which a laboratory of grains may go wrong, as data.

The cases beside this file run and judge them. A verdict is earned: `should` says what the physics asks for, and every
word of it is a check there that can fail.
"""

from __future__ import annotations

import dataclasses

from labkit.dem import Path, make_path

GRAINS = 500
CORRECT, CLEAR_ERROR, LIMIT_SAID, SILENT_WRONG = "correct", "clear error", "limit said", "SILENT WRONG"


@dataclasses.dataclass(frozen=True)
class HardScene:
    """A specimen and a loading path. What is not a plain test has no path here and is made in its case.

    should: what the physics asks for; verdict: what that makes of a run that ends well; void_ratio, step1_friction: of
    the specimen; path: name of the loading path; strain: axial strain, or the largest of the reversals; rate: 1/s;
    pressure: Pa, for paths that take one; reversals: of cyclic_cp, over `strain`; cycles: their number, between
    +-`strain`.
    """

    name: str
    should: str
    verdict: str = CORRECT
    void_ratio: float = 0.67
    step1_friction: float = 0.15
    path: str | None = None
    strain: float | None = None
    rate: float | None = None
    pressure: float | None = None
    reversals: tuple[float, ...] | None = None
    cycles: int | None = None
    judges_c0: bool = True  # whether C0 must be near Love's stress

    def loading(self, extent: float = 1.0) -> Path:
        """The path.

        `extent` shortens a test, 1 being the whole: its strains, or the number of its cycles. A path that ends at a
        pressure goes all the way.
        """
        given = {"rate": self.rate, "pressure": None if self.pressure is None else f"{self.pressure:g} Pa"}
        if self.cycles:
            turns = (1.0, -1.0) * max(4, round(self.cycles * extent)) + (1.0,)
            given["reversals"] = tuple(_rounded(x * self.strain) for x in turns)
        elif self.reversals:
            given["reversals"] = tuple(_rounded(x * self.strain * extent) for x in self.reversals)
        else:
            given["strain"] = _rounded(self.strain * (1.0 if self.path in ("isoc", "isod") else extent))
        return make_path(self.path, given)


def _rounded(strain):
    return float(f"{strain:.6g}")


_ALL = (
    HardScene(
        "loose_cv",
        "p falls to less than 5 % of its start and stays positive; the volume is held, q/p is that of "
        "grains that slide, p falls where it falls with half the step",
        LIMIT_SAID,
        0.77,
        0.4,
        "cv",
        0.25,
        20.0,
    ),
    HardScene(
        "isod_to_nothing",
        "the last contact opens: stress exactly 0, Z = 0, A and F no numbers; grains fly straight "
        "on; sheared there, the cell carries nothing until grains meet again",
        LIMIT_SAID,
        path="isod",
        strain=-0.2,
        rate=5.0,
        pressure=1e-3,
    ),
    HardScene(
        "isoc_beyond",
        "p reaches 3 MPa with equal strains; the mean overlap is then beyond 2 %, and the run says so; "
        "more than 3 MPa is refused",
        LIMIT_SAID,
        0.77,
        0.4,
        "isoc",
        0.1,
        5.0,
    ),
    HardScene(
        "growing_cycles",
        "p is held, q turns its sign with the strain, every leg loses more energy than the shorter "
        "one before; as with half the step",
        path="cyclic_cp",
        strain=0.03,
        rate=20.0,
        pressure=0.5e6,
        reversals=(1 / 6, -1 / 6, 1 / 3, -1 / 3, 2 / 3, -2 / 3, 1.0),
    ),
    HardScene(
        "many_cycles",
        "100 cycles of 0.05 %: p does not drift; e drifts less and less from cycle to cycle (ratcheting "
        "that abates), to the same e as with half the step",
        path="cyclic_cp",
        strain=5e-4,
        rate=20.0,
        pressure=0.5e6,
        cycles=100,
    ),
    HardScene(
        "very_dense",
        "e = 0.3 is beyond the limits (p > 3 MPa, overlap > 2 %), and the run says so; its energy closes",
        LIMIT_SAID,
        0.3,
        0.1,
        "cv",
        0.1,
        20.0,
    ),
    HardScene(
        "very_loose",
        "e = 0.95 holds no skeleton: no specimen is made, and the error says what to change",
        CLEAR_ERROR,
        0.95,
        0.4,
    ),
    HardScene(
        "step_under",
        "a step of 0.97 of the stability limit gives what half of it gives",
        path="cv",
        strain=0.1,
        rate=20.0,
    ),
    HardScene(
        "step_over",
        "a step of 1.03 of the limit is refused; 3 times the limit, where no contact tells at the start, "
        "is stopped by the energy balance",
        CLEAR_ERROR,
        path="cv",
        strain=0.1,
        rate=20.0,
    ),
    HardScene(
        "step_outgrown",
        "a step just under the limit of a specimen with few contacts, which is over it once they are "
        "many: as with half of it, or stopped by the energy balance",
        LIMIT_SAID,
        path="isoc",
        strain=0.1,
        rate=5.0,
    ),
    HardScene(
        "fast",
        "20 times the quasi-static rate: the run says that its inertial number is beyond the limit; energy "
        "closes, and q/p is not below the quasi-static one",
        LIMIT_SAID,
        path="cv",
        strain=0.4,
        rate=200.0,
    ),
    HardScene(
        "deep_overlaps",
        "grains put at random, never relaxed: refused, with or without their contacts listed",
        CLEAR_ERROR,
        path="cv",
        strain=0.02,
        rate=20.0,
    ),
    HardScene(
        "size_ratio_5",
        "grains from 1 to 5: the usual step is refused where it is beyond the limit of the small ones; "
        "with a step below it the test is that of half that step; labkit verify says that C0, which takes equal stress "
        "in grains of all sizes, is not Love's stress",
        LIMIT_SAID,
        void_ratio=0.6,
        path="cv",
        strain=0.1,
        rate=20.0,
        judges_c0=False,
    ),
    HardScene(
        "few_grains",
        "500 grains: strength as the paper's within the scatter of so few, C0 within 6 % of Love",
        path="cv",
        strain=0.4,
        rate=20.0,
    ),
    HardScene(
        "strain_100",
        "the cell reaches ln(h0/h) = 1 with its volume held; the critical state is that of half the step",
        path="cv",
        strain=1.0,
        rate=40.0,
    ),
    HardScene(
        "thin_cell",
        "120 grains, whose cell gets thinner than two grains: fused goes on and its stress is that of its "
        "contacts; YADE cannot, and says so",
        path="cv",
        strain=0.8,
        rate=80.0,
    ),
    HardScene(
        "restart_in_reversal",
        "killed at the turn of a cyclic test and continued: the same records to the last bit",
        path="cyclic_cp",
        strain=0.01,
        rate=20.0,
        pressure=0.5e6,
        reversals=(1.0, -1.0, 0.5),
    ),
    HardScene(
        "gentle_servo",
        "e = 0.77 and p = 10 kPa: the servo reaches and holds p within 0.5 % RMS and 2 % at worst",
        LIMIT_SAID,
        0.77,
        0.4,
        "cp",
        0.02,
        5.0,
        10e3,
    ),
)

SCENES = {scene.name: scene for scene in _ALL}
