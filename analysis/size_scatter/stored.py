"""Tests of the same density that other studies have stored: 4,000 and 14,000 grains, sheared more slowly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

import labkit as lk
from analysis.critical_state.ends import quantities_of
from analysis.curves import POINTS, curves_of

PREFIX = "stored"
STRAIN = 0.4  # the tests are used up to this strain
OF_THE_PAPER = ("cv-medium", "cv-medium_more-s2", "cv-medium_more-s3")  # results/paper: cubes, 10 1/s
TO_FULL_STRAIN = {  # results/critical_state: tall cells, I = 2.5e-4; run -> (size, number of grains)
    **{f"cv-medium-s{seed}": ("n4000", 4000) for seed in range(1, 6)},
    "cv_full-full_medium": ("n14000", 14331),
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
    file = results / "critical_state/statistics.nc"
    if file.exists():
        with xr.open_dataset(file) as data:
            for name, (size, grains) in TO_FULL_STRAIN.items():
                if name in data["run"].values:
                    curves[f"{PREFIX}-{size}-{name}"] = _up_to(data.sel(run=name), grains)
        files.append(file)
    return curves, files


def _up_to(run: xr.Dataset, grains: int) -> xr.Dataset:
    """Curves at POINTS strains up to STRAIN, interpolated between the stored records."""
    strain = run["accumulated_strain"].values.astype(float)
    at = np.linspace(0.0, STRAIN, POINTS)
    known = {name: np.interp(at, strain, values) for name, values in quantities_of(run).items()}
    data = xr.Dataset({name: ("point", values) for name, values in {"strain": at, **known}.items()})
    data["grains"] = grains
    return data
