"""Tables, figure and page of the experiment of analysis.sand.fabric: `python -m analysis.sand.fabric_table`."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas
from scipy.stats import t as student

from analysis.pages import render
from analysis.pictures import save
from analysis.sand.fabric import FABRICS, LABELS, MOST_CYCLES, STORED, cells_of
from analysis.sand.karlsruhe import RESULTS
from analysis.statistics import adjusted

LEVEL = 0.05  # of the planned comparisons
LEAST_Q = 0.02  # of p_0: below, q counts as this
DENSITIES = ("medium", "loose")
PLANNED = ("abs(q)/p_0 at 3 %, compression", "abs(q)/p_0 at 3 %, extension")  # ratios: compared by their logarithms
FACTORS = (*PLANNED, "cycles to r_u = 0.95")
COLOURS = dict(zip(FABRICS, ("C0", "C1", "C2"), strict=True))


def features(row: dict) -> dict[str, float]:
    """Features of the tests of one specimen."""
    found = {f"least p/p_0, {test}": row[test]["least"] for test in ("compression", "extension")}
    found |= {
        f"abs(q)/p_0 at 3 %, {test}": max(abs(row[test]["q_end"]), LEAST_Q) for test in ("compression", "extension")
    }
    drained = {"largest q/p, drained": row["drained"]["largest_ratio"]}
    drained["contraction, drained (%)"] = 100.0 * row["drained"]["contraction"]
    return found | drained | {"cycles to r_u = 0.95": row["cyclic"]["cycles"]}


def table_of(rows: Sequence[dict]) -> pandas.DataFrame:
    """A row per specimen of the seeds that are complete for their shape: labels, state, features."""
    made = pandas.DataFrame([{**{k: row[k] for k in (*LABELS, "e", "Z", "A")}, **features(row)} for row in rows])
    complete = made.groupby(["shape", "seed"])["e"].transform("size") == [len(cells_of(s)) for s in made["shape"]]
    return made[complete].reset_index(drop=True)


def combination(groups: Sequence[tuple[float, np.ndarray]]) -> dict[str, float]:
    """A weighted sum of means of groups, (weight, values), with its 95 % interval and p: Welch's t.

    Without scatter in any group the interval is empty. With a single specimen in a group it is NaN, and with none the
    estimate too.
    """
    if not all(len(values) for _, values in groups):
        return {"estimate": np.nan, "within": np.nan, "p": np.nan}
    value = sum(weight * values.mean() for weight, values in groups)
    if min(len(values) for _, values in groups) < 2:
        return {"estimate": value, "within": np.nan, "p": np.nan}
    parts = np.array([weight**2 * values.var(ddof=1) / len(values) for weight, values in groups])
    if not parts.sum():
        return {"estimate": value, "within": 0.0, "p": float(value == 0.0)}
    freedom = parts.sum() ** 2 / sum(p**2 / (len(v) - 1) for p, (_, v) in zip(parts, groups, strict=True))
    error = np.sqrt(parts.sum())
    return {
        "estimate": value,
        "within": float(student.ppf(0.975, freedom) * error),
        "p": float(2.0 * student.sf(abs(value) / error, freedom)),
    }


def _values(table: pandas.DataFrame, feature: str, shape: str, density: str, fabric: str) -> np.ndarray:
    own = table.query("shape == @shape and density == @density and fabric == @fabric")[feature].to_numpy()
    return np.log(own) if feature in FACTORS else own


def interactions(table: pandas.DataFrame) -> pandas.DataFrame:
    """The planned comparisons: by how much the effect of a fabric on ln |q| grows from medium to loose."""
    found = []
    for shape, feature, fabric in itertools.product(table["shape"].unique(), PLANNED, FABRICS[1:]):
        signs = itertools.product(((1, "loose"), (-1, "medium")), ((1, fabric), (-1, FABRICS[0])))
        groups = [(a * b, _values(table, feature, shape, density, which)) for (a, density), (b, which) in signs]
        found.append({"shape": shape, "feature": feature, "fabric": fabric} | combination(groups))
    made = pandas.DataFrame(found).dropna(subset="estimate").reset_index(drop=True)
    judged = made["p"].notna()
    made.loc[judged, "p_holm"] = adjusted(made.loc[judged, "p"])
    return made


def effects(table: pandas.DataFrame) -> pandas.DataFrame:
    """The effect of each ingredient on each feature; of FACTORS the logarithm of a ratio."""
    found = []
    for feature in features_of(table):
        for shape in table["shape"].unique():
            cells = {(d, f): _values(table, feature, shape, d, f) for d in DENSITIES for f in FABRICS}
            pairs = {f"{f}, {d}": ((d, f), (d, FABRICS[0])) for d in DENSITIES for f in FABRICS[1:]}
            pairs |= {f"loose, {f}": (("loose", f), ("medium", f)) for f in FABRICS}
            for name, (more, less) in pairs.items():
                groups = [(1.0, cells[more]), (-1.0, cells[less])]
                found.append({"feature": feature, "shape": shape, "ingredient": name} | combination(groups))
        if {"rods", "spheres"} <= set(table["shape"]):
            for density, fabric in itertools.product(DENSITIES, FABRICS):
                groups = [
                    (s, _values(table, feature, k, density, fabric)) for s, k in ((1.0, "rods"), (-1.0, "spheres"))
                ]
                found.append({"feature": feature, "shape": "rods", "ingredient": f"shape, {density}, {fabric}"}
                             | combination(groups))  # fmt: skip
    return pandas.DataFrame(found).dropna(subset="estimate").reset_index(drop=True)


def readable(described: pandas.DataFrame) -> pandas.DataFrame:
    """A row per shape and ingredient, a column per feature: ratios of FACTORS, differences of the others.

    A change whose 95 % interval does not contain zero, or a ratio of 1, is bold.
    """
    made = described[["shape", "ingredient", "feature"]].copy()
    texts = []
    for row in described.to_dict("records"):
        value, within = row["estimate"], row["within"]
        if row["feature"] in FACTORS:
            low, high = np.exp(value - within), np.exp(value + within)
            text = f"x {np.exp(value):.2g}" + ("" if np.isnan(within) else f" ({low:.2g} to {high:.2g})")
        else:
            text = f"{value:+.2f}" + ("" if np.isnan(within) else f" ± {within:.2f}")
        texts.append(f"**{text}**" if abs(value) > within else text)
    made["text"] = texts
    return made.pivot(index=["shape", "ingredient"], columns="feature", values="text").reset_index()


def features_of(table: pandas.DataFrame) -> list[str]:
    """Names of the features."""
    return [name for name in table.columns if name not in (*LABELS, "e", "Z", "A")]


def cells(table: pandas.DataFrame) -> pandas.DataFrame:
    """Mean and standard deviation of state and features in each cell, as text."""
    columns = [name for name in table.columns if name not in LABELS]
    rows = []
    for (shape, density, fabric), own in table.groupby(["shape", "density", "fabric"], sort=False):
        row = {"shape": shape, "density": density, "fabric": fabric, "n": str(len(own))}
        for name in columns:
            digits = 3 if name == "e" else 1 if name.startswith(("cycles", "Z")) else 2
            spread = "" if len(own) < 2 else f" ± {own[name].std():.{digits}f}"
            row[name] = f"{own[name].mean():.{digits}f}{spread}"
        rows.append(row)
    return pandas.DataFrame(rows)


def draw(rows: Sequence[dict], file: Path) -> None:
    """Draw the stress paths of undrained compression and extension, a panel per shape and density."""
    shapes = list(dict.fromkeys(row["shape"] for row in rows))
    figure, panels = plt.subplots(len(shapes), 2, figsize=(7.5, 3.4 * len(shapes)), layout="constrained", squeeze=False)
    for (shape, density), axes in zip(itertools.product(shapes, DENSITIES), panels.ravel(), strict=True):
        own = [row for row in rows if (row["shape"], row["density"]) == (shape, density)]
        for row, test in itertools.product(own, ("compression", "extension")):
            axes.plot(row[test]["p"], row[test]["q"], COLOURS[row["fabric"]], lw=1.0, alpha=0.8)
        axes.axhline(0.0, color="0.6", lw=0.6)
        axes.set(title=f"{shape}, {density}", xlabel="$p/p_0$", ylabel="$q/p_0$", xlim=(0.0, None))
        axes.grid(alpha=0.25)
    for fabric, colour in COLOURS.items():
        panels[0, 0].plot([], [], colour, label=fabric)
    panels[0, 0].legend(fontsize=8, loc="upper left")
    save(figure, file, [STORED], "python -m analysis.sand.fabric_table", dpi=90)


def main() -> None:
    """Write tables, figure and page."""
    every = [json.loads(line) for line in STORED.read_text(encoding="utf-8").splitlines()]
    rows = [row for row in every if "failed" not in row]
    table = table_of(rows)
    planned, described = interactions(table), effects(table)
    planned.to_csv(RESULTS / "fabric_interactions.csv", index=False, float_format="%.4g")
    described.to_csv(RESULTS / "fabric_effects.csv", index=False, float_format="%.4g")
    used = {tuple(key) for key in table[[*LABELS]].to_numpy().tolist()}
    draw([row for row in rows if tuple(row[key] for key in LABELS) in used], RESULTS / "fabric.png")
    means = table.groupby(["shape", "density", "fabric"])[[*features_of(table), "Z"]].mean()
    shown = np.where(planned["p_holm"] < LEVEL, "yes", "not shown")
    values = {
        "mean": lambda density, fabric, feature, shape="spheres": f"{means.loc[(shape, density, fabric), feature]:.2f}",
        "cells": cells(table),
        "planned": planned.assign(factor=np.exp(planned["estimate"]), shown=shown),
        "effects": readable(described),
        "numbers": table.groupby("shape")["seed"].nunique().to_dict(),
        "described": len(described),
        "failures": ", ".join(" ".join(str(row[key]) for key in LABELS) for row in every if "failed" in row),
        "unused": len(rows) - len(table),
        "most_cycles": MOST_CYCLES,
    }
    page = render(Path(__file__).with_name("fabric_page.md"), values)
    (RESULTS / "fabric.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
