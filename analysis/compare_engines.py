"""Compares the difference between two engines in whole tests with the scatter between specimens.

    python analysis/compare_engines.py cv_seed*_fused.run.nc cv_seed*_yade.run.nc

The arguments are runs along one path, from the same specimens in both engines. The table lists, for each quantity
averaged over the second half of the axial strain: the mean over specimens in each engine, the difference between the
engines, and the standard deviation over specimens in YADE.
"""

import sys

import numpy as np
import xarray as xr

import labkit as lk
from labkit.engines import ENGINES


def quantities(run: xr.Dataset) -> dict[str, np.ndarray]:
    """Name -> values at the records."""
    p, q = run.lab.mean_stress(), run.lab.deviatoric_stress()
    return {
        "q/p": (q / p).values,
        "e": run["void_ratio"].values,
        "Z": run["coordination_number"].values,
        "Lambda": run["mean_normalised_force"].values,
        "A_zz": run["contact_anisotropy"].values[:, 2, 2],
        "F_zz": run["normal_force_anisotropy"].values[:, 2, 2],
        "Ft_zz": run["mobilisation"].values[:, 2, 2],
    }


runs: dict[str, list[dict[str, np.ndarray]]] = {engine: [] for engine in ENGINES}
for file in sys.argv[1:]:
    run = lk.open_run(file)
    runs[run.attrs["engine"]].append(quantities(run))
if len(runs["yade"]) < 2 or len(runs["yade"]) != len(runs["fused"]):
    sys.exit("name the run files of at least two specimens, each on both engines")
print(f"{len(runs['yade'])} specimens; means over the second half of the test")
print(f"{'':<7} {'yade':>9} {'fused':>9} {'difference':>11} {'scatter':>9} {'ratio':>6}")
for name in runs["yade"][0]:
    yade, fused = (np.array([values[name] for values in runs[engine]]) for engine in ("yade", "fused"))
    half = yade.shape[1] // 2
    a, b = yade[:, half:].mean(axis=1), fused[:, half:].mean(axis=1)
    difference, scatter = b.mean() - a.mean(), a.std(ddof=1)
    row = f"{name:<7} {a.mean():9.4f} {b.mean():9.4f} {difference:11.5f} {scatter:9.5f}"
    print(f"{row} {abs(difference) / scatter:6.2f}")
