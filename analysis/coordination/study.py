"""`./lab coordination`: runs the campaign, or uses the stored curves, and writes results/coordination."""

from __future__ import annotations

import numpy as np
import pandas
import xarray as xr

from analysis.curves import each_run
from analysis.initial_fabric.loading import STRAIN, loading_of
from analysis.initial_fabric.response import MEASURES, coefficient, measures_of
from analysis.statistics import corrected
from analysis.study import Figures, StoredTables, Study, Tables, Values
from labkit.figures import WIDTH, new_figure
from labkit.micro import deviator

ASKED = next(iter(MEASURES))  # q/p at 0.5 %
CELLS = ("inserted", "inserted, opened", "compressed", "compressed, opened")
BEFORE = ("e0", "Z0", "Lambda0", "A0", "q/p0")


class Coordination(Study):
    """Effects of Z0 and of the preparation."""

    data = "curves.nc"
    title = "CR tests of specimens prepared in two ways with two coordination numbers each"
    reduce = staticmethod(loading_of)

    def tables(self, data: xr.Dataset) -> Tables:
        found = response(data)
        cells = found.groupby("cell", sort=False)[[*BEFORE, *MEASURES]].mean().reindex(CELLS).reset_index()
        return {"response": found, "effects": effects(found), "cells": cells, "models": models(found)}

    def numbers(self, tables: StoredTables) -> Values:
        Z = tables["response"].groupby("cell")["Z0"]
        within = float((tables["response"]["Z0"] - Z.transform("mean")).var() / tables["response"]["Z0"].var())
        return {"between": 1.0 - within}

    def figures(self, data: xr.Dataset, tables: StoredTables) -> Figures:
        figure = new_figure(WIDTH, 3.0)
        curves, dots = figure.subplots(1, 2)
        found = tables["response"]
        for cell, colour in zip(CELLS, ("C0", "C9", "C1", "C8"), strict=True):
            for name, run in each_run(data):
                if cell_of(name) == cell:
                    curves.plot(100.0 * STRAIN, run["ratio"], color=colour, lw=0.8)
            dots.plot("Z0", ASKED, "o", color=colour, data=found[found["cell"] == cell], label=cell)
        curves.set(xlabel="axial strain (%)", ylabel="q/p", xlim=(0.0, 5.0))
        dots.set(xlabel="coordination number $Z_0$ before shear", ylabel=ASKED)
        dots.legend()
        return {"response": figure}


STUDY = Coordination()


def cell_of(run: str) -> str:
    """The cell of the 2 x 2 to which a run belongs, e.g. `inserted, opened`."""
    test, specimen, *_ = run.split("-")
    return specimen.partition("_")[0] + ", opened" * test.startswith("opened")


def response(data: xr.Dataset) -> pandas.DataFrame:
    """Start and MEASURES of every test, a row per run: run, cell, compressed (1 or 0), BEFORE, MEASURES."""
    rows = []
    for name, run in each_run(data):
        cell = cell_of(name)
        A = deviator(run["A"].values.astype(float))
        start = {f"{key}0": float(run[key][0]) for key in ("e", "Z", "Lambda")}
        start |= {"A0": float(np.linalg.norm(A)), "q/p0": float(run["ratio"][0])}
        curves = {key: run[key].values.astype(float) for key in ("ratio", "volumetric", "Z")}
        rows.append({"run": name, "cell": cell, "compressed": int("compressed" in cell)} | start | measures_of(curves))
    return pandas.DataFrame(rows)


def effects(found: pandas.DataFrame) -> pandas.DataFrame:
    """Comparisons 1 to 3 of the plan: c and d of every measure, and g of ASKED.

    The effect of Z0 in each preparation, which was not planned, is listed next to g. Columns: comparison, measure,
    effect (`Z0`, per unit; `compressed`; `Z0 x compressed`), difference, within, specimens, p_value, corrected (Holm,
    for the two of 1, the twelve of 2 and the three of 3).
    """
    Z = (found["Z0"] - found["Z0"].mean()).to_numpy()
    e = (found["e0"] - found["e0"].mean()).to_numpy()
    compressed, one = found["compressed"].to_numpy(dtype=float), np.ones(len(found))
    designs = {
        "Z0": (Z, compressed, e, one),
        "compressed": (compressed, Z, e, one),
        "Z0 x compressed": (Z * compressed, Z, compressed, e, one),
        "Z0, inserted": (Z * (1.0 - compressed), Z * compressed, compressed, e, one),
        "Z0, compressed": (Z * compressed, Z * (1.0 - compressed), compressed, e, one),
    }
    rows = []
    for measure in MEASURES:
        for effect, design in designs.items():
            comparison = 2 if measure != ASKED else 1 if effect in ("Z0", "compressed") else 3
            if comparison == 2 and effect not in ("Z0", "compressed"):
                continue
            fit = coefficient(found[measure].to_numpy(dtype=float), np.column_stack(design), len(found))
            rows.append({"comparison": comparison, "measure": measure, "effect": effect} | fit.columns("difference"))
    table = pandas.DataFrame(rows)
    return pandas.concat([corrected(part.to_dict("records")) for _, part in table.groupby("comparison")])


def models(found: pandas.DataFrame) -> pandas.DataFrame:
    """The effect of Z0 on ASKED in models that describe four cells equally well; only the first was planned.

    Columns: model, Z0 (per unit; with an interaction the mean of the two preparations), within, p_value, added (p-value
    of the added term, NaN if there is none or several), residual (standard deviation). All models have e0.
    """
    y = found[ASKED].to_numpy(dtype=float)
    Z, e = ((found[name] - found[name].mean()).to_numpy() for name in ("Z0", "e0"))
    half = found["compressed"].to_numpy() - 0.5
    opened = found["cell"].str.contains("opened").to_numpy(dtype=float)
    cells, one = pandas.get_dummies(found["cell"], dtype=float).to_numpy(), np.ones(len(found))
    base = np.column_stack([half, e, one])
    added = {
        "as planned": None,
        "with Z0 x preparation": Z * half,
        "with opened": opened,
        "with Z0 squared": Z**2,
        "within cells": cells,
    }
    rows = []
    for name, term in added.items():
        design = np.column_stack([Z, base] if term is None else [Z, base, term])
        fit, left = coefficient(y, design, len(y)), np.linalg.lstsq(design, y)
        freedom = len(y) - int(left[2])
        residual = float(np.sqrt(np.sum((y - design @ left[0]) ** 2) / freedom))
        known = term is not None and term.ndim == 1
        p_value = coefficient(y, np.column_stack([term, Z, base]), len(y)).p_value if known else np.nan
        rows.append({"model": name} | fit.columns("Z0") | {"added": p_value, "residual": residual})
    return pandas.DataFrame(rows)
