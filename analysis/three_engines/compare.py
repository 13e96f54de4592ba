"""Differences between engines on the same specimens, against the scatter between specimens."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas
from matplotlib.figure import Figure

import labkit as lk
from analysis.paper.ends import recorded_numbers
from analysis.places import texts
from analysis.statistics import cluster_mean, corrected
from analysis.three_engines.runs import OTHER, PATHS, PRESSURE, Test
from labkit.figures import WIDTH, colors_for, new_figure

END = 0.08  # axial strain from which the end of a test is averaged
LABELS: dict[str, str] = texts(__file__)["quantities"]


def quantities(file: Path) -> dict[str, float]:
    """Peak and end of a test: name -> value."""
    data = lk.open_run(file)
    records = recorded_numbers(data).rename(columns=lambda name: name.removesuffix("_zz"))
    end = records[np.abs(data["axial_strain"].values) >= END - 1e-9].mean()
    return {"peak": records["M"].max(), **{name: end[name] for name in LABELS if name != "peak"}}


def values(folder: Path, tests: Sequence[Test]) -> pandas.DataFrame:
    """One row per test: number of grains, path, seed, engine, law and its quantities."""
    return pandas.DataFrame([{**dataclasses.asdict(test), **quantities(test.file(folder))} for test in tests])


def differences(measured: pandas.DataFrame) -> pandas.DataFrame:
    """Mean difference from fused on the same specimens and its 95 % interval, per size, path, engine and quantity.

    `scatter` is the standard deviation over the specimens on fused; `specimens` counts those on both engines.
    """
    rows = []
    for (grains, law), some in measured.groupby(["grains", "law"], sort=False):
        for path in PATHS:
            fused, apart = _apart(some[some["path"] == path], str(law))
            for name in (name for name in LABELS if len(apart) and _varies(name, path)):
                found, on_fused = cluster_mean(apart[name]), (fused[name].mean(), fused[name].std())
                row = OTHER[str(law)], name, on_fused[0], found.value, found.within, on_fused[1], found.n
                rows.append((grains, path, *row))
    columns = "grains path engine quantity fused difference interval scatter specimens".split()
    return pandas.DataFrame(rows, columns=columns)


def _apart(measured: pandas.DataFrame, law: str) -> tuple[pandas.DataFrame, pandas.DataFrame]:
    """(quantities on fused, other engine minus fused in the tests on both), by grains, seed and path."""
    some = measured[measured["law"] == law].set_index(["grains", "seed", "path"])
    fused, theirs = (some.loc[some["engine"] == engine, list(LABELS)] for engine in ("fused", OTHER[law]))
    return fused, (theirs - fused).loc[fused.index.intersection(theirs.index)]


def pooled(measured: pandas.DataFrame) -> pandas.DataFrame:
    """Difference from fused on the same specimens, averaged over paths for each specimen, over all sizes.

    Columns: engine, quantity, specimens, difference, interval (95 %), percent (of the mean on fused), p_value,
    corrected (Holm, for all rows).
    """
    rows = []
    for law, other in OTHER.items():
        fused, apart = _apart(measured, law)
        for name in LABELS:
            judged = apart[[_varies(name, path) for *_, path in apart.index]]
            if judged.empty:
                continue
            found = cluster_mean(judged[name], [f"{grains}-{seed}" for grains, seed, _ in judged.index])
            percent = 100.0 * found.value / fused.loc[judged.index, name].mean()
            rows.append((other, name, found.n, found.value, found.within, percent, found.p_value))
    return corrected(rows, "engine quantity specimens difference interval percent p_value".split())


def _varies(name: str, path: str) -> bool:
    """False for a quantity that the path prescribes."""
    return not (name == "e" and path == "cv") and not (name == "p_MPa" and path != "cv")


def held(folder: Path, tests: Sequence[Test]) -> pandas.DataFrame:
    """One row per test: RMS error of the held stress, or the largest drift of the volume."""
    return pandas.DataFrame([{**dataclasses.asdict(test), **_held(test, folder)} for test in tests])


def _held(test: Test, folder: Path) -> Mapping[str, float]:
    data = lk.open_run(test.file(folder))
    stress = data["stress"].values[1:]
    if test.path == "cv":
        volume = data["volume"].values
        return {"volume_drift": float(np.abs(volume / volume[0] - 1.0).max())}
    kept = stress[:, [0, 1], [0, 1]] if test.path == "cr" else np.trace(stress, axis1=1, axis2=2)[:, None] / 3.0
    return {"stress_rms": float(np.sqrt(np.mean((kept / PRESSURE - 1.0) ** 2)))}


def figure(rows: pandas.DataFrame) -> Figure:
    """Difference from fused over the scatter between specimens: a row of panels per size, one panel per path.

    Bars: 95 % interval of the mean; a mean of one specimen has none. Sizes with one specimen on fused, which has no
    scatter, are left out.
    """
    rows = rows.dropna(subset=["scatter"])
    sizes = list(dict.fromkeys(rows["grains"]))
    drawn = new_figure(WIDTH * 1.3, 0.6 + 3.0 * len(sizes))
    panels = drawn.subplots(len(sizes), len(PATHS), sharey=True, sharex="row", squeeze=False)
    names = [name for name in LABELS if (rows["quantity"] == name).any()]
    for line, grains in zip(panels, sizes, strict=True):
        for panel, path in zip(line, PATHS, strict=True):
            panel.axvspan(-1, 1, color="0.9", zorder=0)
            panel.axvline(0, color="0.5", lw=0.8)
            for shift, color, engine in zip((-0.15, 0.15), colors_for(2), OTHER.values(), strict=True):
                some = rows[(rows["grains"] == grains) & (rows["path"] == path) & (rows["engine"] == engine)]
                _draw(panel, some, names, shift, color, f"{engine} - fused")
            panel.set_title(f"{path.upper()}, {grains:,} grains")
    for panel in panels[-1]:
        panel.set_xlabel("difference / scatter")
    panels[0, 0].set_yticks(range(len(names)), [LABELS[name] for name in names])
    panels[0, 0].invert_yaxis()
    panels[0, 0].legend(loc="best", fontsize="small")
    return drawn


def _draw(panel, rows: pandas.DataFrame, names: Sequence[str], shift: float, color: str, label: str) -> None:
    place = [names.index(name) + shift for name in rows["quantity"]]
    scale = rows["scatter"].to_numpy()
    interval = np.nan_to_num(rows["interval"].to_numpy() / scale)
    panel.errorbar(
        rows["difference"] / scale, place, xerr=interval, fmt="o", ms=4, color=color, capsize=2, lw=1, label=label
    )
