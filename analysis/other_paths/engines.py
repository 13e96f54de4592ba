"""Compares YADE and `fused` on every path: do the engines differ by more than two specimens do?"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas
import xarray as xr
from matplotlib.figure import Figure

import labkit as lk
from analysis.legends import legend_below
from analysis.statistics import cluster_mean, corrected
from labkit.engines import Progress
from labkit.errors import InputError
from labkit.figures import WIDTH, colors_for, new_figure
from labkit.micro import equivalent_stress, mean_stress

POINTS = 200
QUANTITIES = ("p", "ratio", "e", "Z")
UNDRAINED = "undrained_cycles"
LIQUEFIED = 0.95  # r_u at initial liquefaction


def cycles_table(files: Sequence[Path]) -> pandas.DataFrame:
    """Initial liquefaction of the undrained cyclic tests; a pandas.DataFrame with a row per run (run.lab.liquefaction).

    Z and F are taken from the first record and from the first one with r_u > 0.95; F is its Frobenius norm.
    """
    rows = []
    for file in files:
        test, specimen, engine = file.name.removesuffix(".run.nc").rsplit("-", 2)
        if test != UNDRAINED:
            continue
        with lk.open_run(file) as run:
            found, ratio = run.lab.liquefaction(), run.lab.pore_pressure_ratio().values
            at = int(np.argmax(ratio > LIQUEFIED)) if (ratio > LIQUEFIED).any() else -1
            Z, F = run["coordination_number"].values, np.linalg.norm(run["normal_force_anisotropy"].values, axis=(1, 2))
            rows.append(
                {
                    "specimen": specimen,
                    "engine": engine,
                    **dataclasses.asdict(found),
                    "Z_start": Z[0],
                    "Z_liquefied": Z[at],
                    "F_start": F[0],
                    "F_liquefied": F[at],
                    "finite": bool(np.isfinite(run["stress"].values).all()),
                }
            )
    return pandas.DataFrame(rows)


def liquefaction_figure(files: Sequence[Path]) -> Figure:
    """r_u, Z and |F| of the undrained cyclic tests against the number of cycles; colour: specimen, dashed: YADE.

    |F| is drawn where r_u < 0.95: it is not defined without contact forces.
    """
    figure = new_figure(WIDTH, 3.6)
    panels = figure.subplots(1, 3)
    chosen = [file for file in files if file.name.startswith(UNDRAINED)]
    specimens = sorted({file.name.split("-")[1] for file in chosen})
    colors = dict(zip(specimens, colors_for(len(specimens)), strict=True))
    for file in chosen:
        _, specimen, engine = file.name.removesuffix(".run.nc").rsplit("-", 2)
        with lk.open_run(file) as run:
            ratio = run.lab.pore_pressure_ratio().values
            F = np.linalg.norm(run["normal_force_anisotropy"].values, axis=(1, 2))
            values = (ratio, run["coordination_number"].values, np.where(ratio < LIQUEFIED, F, np.nan))
            for panel, y in zip(panels, values, strict=True):
                style = "--" if engine == "yade" else "-"
                panel.plot(run.lab.cycles(), y, style, lw=0.8, color=colors[specimen], label=f"{specimen}, {engine}")
    for panel, label in zip(panels, ("r_u = 1 - p/p_0", "coordination number Z", "|F|"), strict=True):
        panel.set(xlabel="number of cycles N", ylabel=label)
        panel.grid(alpha=0.25)
    legend_below(figure, panels[0], 6, fontsize=8)
    return figure


def curves(run: xr.Dataset) -> dict[str, np.ndarray]:
    """p (over its initial value), q/p, e and Z at POINTS equal intervals of the duration of a run, each (POINTS,)."""
    time = run["time"].values
    at = np.linspace(0.0, time[-1], POINTS)
    stress = run["stress"].values
    p = mean_stress(stress)
    values = {
        "p": 100.0 * p / p[0],
        "ratio": equivalent_stress(stress) / np.maximum(p, 1e-3 * p[0]),
        "e": run["void_ratio"].values,
        "Z": run["coordination_number"].values,
    }
    return {name: np.interp(at, time, value) for name, value in values.items()}


def read_curves(files: Sequence[Path], progress: Progress) -> dict[tuple[str, str, str], dict[str, np.ndarray]]:
    """(test, specimen, engine) -> curves of the runs. Raises InputError if an engine is missing."""
    found = {}
    for k, file in enumerate(files):
        test, specimen, engine = file.name.removesuffix(".run.nc").rsplit("-", 2)
        progress(k / len(files), f"reading {test}")
        with lk.open_run(file) as run:
            found[test, specimen, engine] = curves(run)
    if {engine for _, _, engine in found} != {"yade", "fused"}:
        raise InputError("the campaign has runs of one engine only: finish the campaign of engines.yaml")
    return found


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Root mean square of the difference of two curves (n,)."""
    return float(np.sqrt(np.mean((a - b) ** 2)))


def agreement(found: Mapping[tuple[str, str, str], Mapping[str, np.ndarray]]) -> pandas.DataFrame:
    """Compare the engines, and two specimens on one engine; a pandas.DataFrame with a row per test and quantity.

    `engines` is the root mean square along the test of YADE minus fused, from the same specimen, the mean over the
    specimens; `specimens` is the same between two specimens on one engine, the mean over all pairs. `difference` is
    YADE minus fused in the mean over the last quarter, the mean over the specimens; `p_value` comes from the paired
    t-test over the specimens that it is zero, and `corrected` the same after Benjamini and Hochberg over all rows.
    """
    rows = []
    for test in dict.fromkeys(test for test, _, _ in found):
        of_test = {key[1:]: value for key, value in found.items() if key[0] == test}
        both = [s for s in sorted({s for s, _ in of_test}) if (s, "yade") in of_test and (s, "fused") in of_test]
        for quantity in QUANTITIES:
            curve = {key: value[quantity] for key, value in of_test.items()}
            pairs = [(curve[s, "yade"], curve[s, "fused"]) for s in both]
            others = [(curve[a, e], curve[b, e]) for e in ("yade", "fused") for a, b in itertools.combinations(both, 2)]
            last = [float((yade - fused)[-POINTS // 4 :].mean()) for yade, fused in pairs]
            change = cluster_mean(last)
            between = (np.mean([distance(*pair) for pair in some]) for some in (pairs, others))
            rows.append((test, quantity, len(both), *between, change.value, change.p_value))
    columns = "test quantity specimens engines between_specimens difference p_value".split()
    return corrected(rows, columns, "fdr_bh")
