"""Tests of the same density that other studies have stored: 4,000 and 14,000 grains, sheared more slowly."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

import labkit as lk
from analysis.curves import AT_FULL_STRAIN, curves_at_full_strain, curves_of

PREFIX = "stored"
STRAIN = 0.4  # the tests are used up to this strain
OF_THE_PAPER = ("cv-medium", "cv-medium_more-s2", "cv-medium_more-s3")  # results/paper: cubes, 10 1/s
TO_FULL_STRAIN = {  # results/critical_state: tall cells, I = 2.5e-4; run -> number of grains
    **{f"cv-medium-s{seed}": 4000 for seed in range(1, 6)},
    "cv_full-full_medium": 14331,
}


def stored_curves(results: Path) -> tuple[dict[str, xr.Dataset], list[Path]]:
    """Curves of the stored tests that are present in the folder of results, by name, and the files they are from.

    The names are `stored-SIZE-ORIGIN`, so that no two specimens of a size have the same name.
    """
    curves: dict[str, xr.Dataset] = {}
    files = []
    for name in OF_THE_PAPER:
        file = results / "paper/runs" / f"{name}.run.nc"
        if file.exists():
            with lk.open_run(file) as run:
                curves[f"{PREFIX}-n14000-paper_{name}"] = curves_of(run)
            files.append(file)
    at_full_strain = curves_at_full_strain(results, TO_FULL_STRAIN, STRAIN)
    for name, known in at_full_strain.items():
        curves[f"{PREFIX}-n{1000 * (TO_FULL_STRAIN[name] // 1000)}-{name}"] = known
    return curves, files + [results / AT_FULL_STRAIN] * bool(at_full_strain)
