"""M of spheres against their rolling friction, and the rolling friction at which it is that of the rods.

python -m analysis.shape.matching CAMPAIGN_FOLDER writes results/shape/matching/strengths.csv and prints the rolling
friction.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas

import labkit as lk
from analysis.campaigns import finished
from analysis.manifest import collect
from analysis.places import results_folder
from analysis.shape.study import WINDOW
from labkit.io import write_with_provenance


def strengths(files: Sequence[Path]) -> pandas.DataFrame:
    """Mean q/p over the window of each run: group, rolling_friction, seed, M."""
    rows = []
    for file in files:
        with lk.open_run(file) as run:
            late = run.sel(time=np.abs(run["axial_strain"].values) >= WINDOW[0])
            M = float((late.lab.deviatoric_stress() / late.lab.mean_stress()).mean())
            friction = run.lab.scene.rolling_friction
        group = "rods" if "rods" in file.name else "spheres"
        seed = file.name.removesuffix(".run.nc").rpartition("-s")[2]
        rows.append({"group": group, "rolling_friction": friction, "seed": int(seed), "M": M})
    return pandas.DataFrame(rows).sort_values(["group", "rolling_friction", "seed"])


def matched(table: pandas.DataFrame) -> float:
    """Rolling friction at which the spheres have the mean M of the rods; the largest if that is not enough."""
    means = table.groupby(["group", "rolling_friction"])["M"].mean()
    spheres, rods = means["spheres"], float(means["rods"].iloc[0])
    return float(np.interp(rods, spheres.to_numpy(), spheres.index.to_numpy()))


def main(folder: str) -> None:
    """Write the table and print the result."""
    files = finished(folder)
    table = strengths(files)
    command = f"python -m analysis.shape.matching {folder}"
    Path(results_folder("shape"), "matching").mkdir(parents=True, exist_ok=True)
    text = table.to_csv(index=False, float_format="%.5g")
    write_with_provenance(Path(results_folder("shape")) / "matching" / "strengths.csv", text, files, command)
    collect(Path(results_folder("shape"), "matching"))
    print(table.to_string(index=False), f"\nrolling friction: {matched(table):.3f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
