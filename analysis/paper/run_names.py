"""The report's section that explains the names of the runs, with a row for every run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pandas

from analysis.paper.model_summary import KINDS
from analysis.paper.pieces import box, join, missing, table

LAWS = {
    "paper": "spring-dashpot",  # names in files of labkit 0.1.0
    "spring_dashpot": "spring-dashpot",
    "yade": "rolling resistance",
    "rolling_resistance": "rolling resistance",
}
EXAMPLE = (
    "A run is named TEST-SPECIMEN, for example `cv_other-dense_high`: an undrained test on a dense specimen with a "
    "high initial pressure."
)
PARTS = r"""| part of the name | meaning |
|---|---|
| `cv` | triaxial compression at constant volume (undrained) |
| `cr_500kPa`, `cr_1MPa` | drained triaxial compression, radial stress held at 0.5 or 1 MPa |
| `cp_500kPa`, `cp_1MPa` | triaxial compression, mean stress held at 0.5 or 1 MPa |
| `isoc`, `isod` | isotropic compression, isotropic dilation |
| `cyclic` | cyclic triaxial test, mean stress held at 0.5 MPa; strain reversals at 1, -1, 2, -2, 3, -3, 4 % |
| `cp_start` | monotonic CP test from the same specimen as a cyclic test |
| `cv_other` | CV test from another initial pressure than the main one of that density |
| `dense`, `medium`, `loose` | initial void ratio 0.606, 0.670, 0.724 |
| `_high`, `_low` | higher or lower initial pressure at the same void ratio |
| `_more-s2`, `_more-s3` | the same recipe with another random seed (2 or 3) |
| `cyclic_dense`, `cyclic_loose` | specimens of the cyclic tests, void ratio 0.60 and 0.77 |
| `share_...` | tests of 2,000 grains that compare engines and contact laws |
| `full_...` | the same comparison with 14,331 grains |
| `-yade`, `-fused` | YADE or the fused engine, both with YADE's rolling-resistance law |
| `-paper` | the fused engine with the spring-dashpot law of the paper |"""


def run_names(folder: Path, command: str) -> str:
    """Section on the names of the runs. `command`: the command that writes the run files."""
    listed = run_list(folder)
    rows = missing("runs", command) if listed.empty else table(listed, "every run", fold=True)
    return join("## Names of the runs {#run-names}", EXAMPLE, box(PARTS, "parts of a run's name", "prose"), rows)


def run_list(folder: Path) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per reduced run file: test, specimen, initial state, engine and contact law."""
    return pandas.DataFrame([_row(file) for file in sorted((folder / "runs").glob("*.run.nc"))])


def _row(file: Path) -> dict[str, Any]:
    with netCDF4.Dataset(file) as run:
        path = json.loads(getattr(run, "path_parameters", "{}"))
        recipe = json.loads(getattr(run, "recipe", "{}"))
        held = path.get("pressure") if run.path in ("cr", "cp", "cyclic_cp") else None
        law = json.loads(run.scene)["law"]
        return {
            "run": file.name.removesuffix(".run.nc"),
            "test": KINDS.get(run.path, run.path),
            "e of the specimen": recipe.get("void_ratio"),
            "seed": recipe.get("seed"),
            "initial p, MPa": float(np.trace(run["stress"][0])) / 3e6,
            "held stress, MPa": held / 1e6 if held else None,
            "axial rate, 1/s": path.get("rate"),
            "grains": len(run["grains"].dimensions["grain"]),
            "engine": run.engine,
            "contact law": LAWS.get(law, law),
        }
