"""The hard cases: named, repeatable scenarios in which a DEM simulation may go wrong, read from `scenes.yaml`.

The functions in `cases` run and judge them. `should` states what the physics requires, and each statement is backed by
a check that can fail.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from analysis.places import read_yaml
from labkit.paths import Path as Loading
from labkit.paths import make_path

GRAINS = 500
# name in tables -> engine and precision
ENGINES = {"yade": ("yade", "double"), "fused": ("fused", "double"), "mixed": ("fused", "mixed")}
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
        reversals: Axial strains at the reversals of cyclic_cp.
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
    reversals: list[float] | None = None
    cycles: int | None = None
    judges_c0: bool = True

    def loading(self, extent: float = 1.0) -> Loading:
        """The loading path.

        `extent`: fraction of the strains, or of the number of cycles, 1 for the whole test. A path that ends at a
        pressure is not shortened.
        """
        pressure = None if self.pressure is None else f"{self.pressure:g} Pa"
        values: dict[str, Any] = {"rate": self.rate, "pressure": pressure}
        if self.cycles:
            turns = (1.0, -1.0) * max(4, round(self.cycles * extent)) + (1.0,)
            values["reversals"] = tuple(_rounded(x * self.strain) for x in turns)
        elif self.reversals:
            values["reversals"] = tuple(_rounded(x * extent) for x in self.reversals)
        else:
            values["strain"] = _rounded(self.strain * (1.0 if self.path in ("isoc", "isod") else extent))
        return make_path(self.path, values)


def _rounded(strain: float) -> float:
    return float(f"{strain:.6g}")


GIVEN: dict[str, Any] = read_yaml(Path(__file__).with_suffix(".yaml"))
SCENES = {name: HardScene(name=name, **fields) for name, fields in GIVEN.items()}
