"""Figures of the study: drift with strain, critical state lines, and the critical state against the Lode angle."""

from __future__ import annotations

import numpy as np
import pandas
from matplotlib.figure import Figure

from analysis.critical_state.ends import BEGIN
from analysis.critical_state.questions import direction
from analysis.legends import legend_below
from analysis.paper.lines import critical_Lambda, critical_Z, paper_pressure
from analysis.places import texts
from labkit.figures import WIDTH, colors_for, new_figure

LABELS: dict[str, str] = texts(__file__)["labels"]
TESTS: dict[str, str] = texts(__file__)["tests"]  # test -> label
GRID = np.linspace(0.02, 1.0, 50)


def drift_figure(records: pandas.DataFrame) -> Figure:
    """M, A, F, Ft, Z and Lambda of medium specimens against strain: mean over each kind of test, with the scatter."""
    records = records[records["density"] == "medium"]
    figure = new_figure(WIDTH * 1.2, 5.6)
    axes = figure.subplots(2, 3, sharex=True).ravel()
    tests = [test for test in ("cv", "cp", "cr", "cv_extension", "cp_extension", "shear") if _has(records, test)]
    for color, test in zip(colors_for(len(tests)), tests, strict=True):
        rows = records[records["test"] == test]
        for panel, quantity in zip(axes, ("M", "A", "F", "Ft", "Z", "Lambda"), strict=True):
            curves = np.array([_at(run, quantity) for _, run in rows.groupby("run")])
            mean, scatter = np.nanmean(curves, axis=0), np.nanstd(curves, axis=0)
            panel.plot(100 * GRID, mean, color=color, label=f"{TESTS[test]} ({len(curves)})")
            panel.fill_between(100 * GRID, mean - scatter, mean + scatter, color=color, alpha=0.15, lw=0)
            panel.set_ylabel(LABELS[quantity])
    for panel in axes:
        panel.axvspan(30, 40, color="0.85", zorder=0)
        panel.axvspan(100 * BEGIN, 100, color="0.92", zorder=0)
        panel.set_xlim(0, 100)
    for panel in axes[3:]:
        panel.set_xlabel("accumulated strain (%)")
    legend_below(figure, axes[0], 6, fontsize=8)
    return figure


def _has(records: pandas.DataFrame, test: str) -> bool:
    return bool((records["test"] == test).any())


def _at(run: pandas.DataFrame, quantity: str) -> np.ndarray:
    """A quantity at the strains GRID, as a fraction of the whole test."""
    strain = run["strain"].to_numpy()
    return np.interp(GRID * strain.max(), strain, run[quantity].to_numpy())


def lines_figure(ends: pandas.DataFrame) -> Figure:
    """Ends of the tests: e against p, Z and Lambda against e, with the paper's lines."""
    figure = new_figure(WIDTH * 1.2, 4.2)
    axes = figure.subplots(1, 3)
    e = np.linspace(0.58, 0.76, 200)
    for panel, x, y in zip(axes, (paper_pressure(e), e, e), (e, critical_Z(e), critical_Lambda(e)), strict=True):
        panel.plot(x, y, "-", color="0.3", label="Table 2 of the paper")
    tests = [test for test in TESTS if _has(ends, test)]
    for color, test in zip(colors_for(len(tests)), tests, strict=True):
        rows = ends[ends["test"] == test]
        marker = "v" if direction(test) == "extension" else "s" if "series" in test else "o"
        style = {"ls": "", "marker": marker, "ms": 4, "color": color, "mfc": color if "full" in test else "none"}
        for panel, (across, up) in zip(axes, (("p_MPa", "e"), ("e", "Z"), ("e", "Lambda")), strict=True):
            panel.plot(rows[across], rows[up], **style, label=TESTS[test])
            panel.set(xlabel=LABELS[across], ylabel=LABELS[up])
    legend_below(figure, axes[0], 5, fontsize=8)
    return figure


MARKERS: dict[str, tuple[str, str]] = texts(__file__)["markers"]


def lode_figure(table: pandas.DataFrame, ends: pandas.DataFrame) -> Figure:
    """M, A, F, Ft, and the distances of Z and Lambda from the paper's lines, against the Lode angle."""
    figure = new_figure(WIDTH * 1.2, 5.4)
    axes = figure.subplots(2, 3, sharex=True).ravel()
    names = {**LABELS, "Z_off": "$Z - Z^c(e)$", "Lambda_off": "$\\Lambda - \\Lambda^c(e)$"}
    for panel, quantity in zip(axes, ("M", "A", "F", "Ft", "Z_off", "Lambda_off"), strict=True):
        if quantity in ends:
            shown = ends[ends["test"].isin(table["test"]) & (ends["density"] == "medium")]
            panel.plot(shown["lode"], shown[quantity], ".", color="0.7", label="one test")
        for path, (label, marker) in MARKERS.items():
            rows = table[table["test"].str.startswith(path)]
            within = rows[f"{quantity}_within"]
            panel.errorbar(rows["lode"], rows[quantity], within, fmt=marker, ms=5, capsize=3, label=label)
        panel.set_ylabel(names[quantity])
    for panel in axes[3:]:
        panel.set_xlabel("Lode angle (degrees)")
    title = "symbols: means, with 95 % intervals over specimens"
    legend_below(figure, axes[0], 6, title=title, fontsize=8)
    return figure
