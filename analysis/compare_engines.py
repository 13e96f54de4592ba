"""Compares the difference between two engines in whole tests with the scatter between specimens.

    python -m analysis.compare_engines cv_seed*_fused.run.nc cv_seed*_yade.run.nc

The arguments are runs along one path, from the same specimens in both engines. The table lists, for each quantity
averaged over the second half of the axial strain: the mean over specimens in each engine, the difference between the
engines, and the standard deviation over specimens in YADE.
"""

import sys

import numpy as np
import pandas

import labkit as lk
from analysis.paper.ends import recorded_numbers
from labkit.engines import ENGINES

runs: dict[str, list[pandas.DataFrame]] = {engine: [] for engine in ENGINES}
for file in sys.argv[1:]:
    run = lk.open_run(file)
    runs[run.attrs["engine"]].append(recorded_numbers(run).drop(columns="p_MPa").rename(columns={"M": "q/p"}))
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
