"""Dilatancy against stress ratio in drained compression: grains, C4 at their states, Rowe and Nova."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
import pandas
import xarray as xr
from matplotlib.figure import Figure

from analysis.curves import each_run
from analysis.model_benchmark.tables import judged
from analysis.statistics import cluster_mean
from labkit.figures import WIDTH, colors_for, new_figure
from labkit.micro import deviator, mean_stress
from labkit.model import Model, ModelState, stress_rate

WINDOW = 0.02  # axial strain over which the dilatancy of the grains is fitted as a slope
PATHS = {"cp": np.eye(3) / 3.0, "cr": np.diag([0.5, 0.5, 0.0])}  # path -> measure of the stress that it holds
ROWE, NOVA, GRAINS = "Rowe", "Nova", "grains"
AXIAL = np.diag([-0.5, -0.5, 1.0])  # deviatoric strain rate with an equivalent rate of 1
COMPRESSING = np.eye(3) / 3.0  # strain rate with a volumetric rate of 1


def dilatancy(data: xr.Dataset, models: Mapping[str, Model]) -> pandas.DataFrame:
    """D = -d eps_v/d eps_q and q/p of the grains in windows of drained compression, and D of the models there.

    A row per test and window: run, part, packing, strain (axial, at the middle), ratio (q/p), grains, and a column per
    model. A model has the e, Z, Lambda, A, F, F^t of the grains at the middle of the window.
    """
    rows = []
    for name, one in each_run(data.astype("f8")):
        path = str(one["path"].values)
        if str(one["group"].values) != "compression" or path not in PATHS:
            continue
        axial = one["strain"].values[:, 2, 2]
        volumetric = np.trace(one["strain"].values, axis1=1, axis2=2)
        sheared = axial - volumetric / 3.0
        edges = np.arange(0.0, axial[-1], WINDOW)
        for low, high in itertools.pairwise(edges):
            v, q = (np.diff(np.interp([low, high], axial, values))[0] for values in (volumetric, sheared))
            middle = one.isel(point=int(np.abs(axial - 0.5 * (low + high)).argmin()))
            s = deviator(middle["stress"].values)
            ratio = 1.5 * s[2, 2] / mean_stress(middle["stress"].values)
            row: dict[str, object] = {"run": name, **{key: str(one[key].values) for key in ("part", "packing")}}
            row |= {"strain": 0.5 * (low + high), "ratio": float(ratio), GRAINS: -v / q}
            rows.append(row | {label: _of_model(model, middle, PATHS[path]) for label, model in models.items()})
    table = pandas.DataFrame(rows)
    M, N = constants(table)
    excess = table["ratio"] - M
    rowe = 9.0 * excess / (9.0 + 3.0 * M - 2.0 * M * table["ratio"])
    return table.assign(**{ROWE: rowe, NOVA: excess / N})


def constants(table: pandas.DataFrame) -> tuple[float, float]:
    """M and N of Rowe's equation and Nova's line D = (q/p - M)/N, from the windows of the training part.

    M is the mean q/p beyond 30 % axial strain, N the least-squares fit.
    """
    own = table[table["part"] == "training"]
    M = float(own.loc[own["strain"] > 0.3, "ratio"].mean())
    excess = own["ratio"] - M
    return M, float(excess @ excess / (excess @ own[GRAINS]))


def _of_model(model: Model, point: xr.Dataset, measure: np.ndarray) -> float:
    """D of a model that holds measure:sigma, in the state of the grains: its rates are linear on each branch."""
    tensors = (deviator(point[key].values) for key in ("A", "F", "Ft"))
    state = ModelState(float(point["e"]), float(point["Z"]), float(point["Lambda"]), *tensors)
    shear = np.sum(measure * stress_rate(model, state, AXIAL))
    for sign in (1.0, -1.0):
        volumetric = -shear / (sign * np.sum(measure * stress_rate(model, state, sign * COMPRESSING)))
        if volumetric * sign >= 0.0:
            return float(-volumetric)
    return np.nan


def dilatancy_errors(table: pandas.DataFrame) -> pandas.DataFrame:
    """Root mean square error of D, a row per part and rule, its mean over packings, and its ratio to that of Rowe.

    The ratio is a geometric mean over packings with `low` and `high`; `corrected` for the number of rows (Holm).
    """
    rules = [name for name in table.columns if name not in ("run", "part", "packing", "strain", "ratio", GRAINS)]
    rows = []
    for part, own in table.groupby("part", sort=False):
        each = pandas.DataFrame({rule: (own[rule] - own[GRAINS]) ** 2 for rule in rules}).groupby(own["packing"])
        errors = np.sqrt(each.mean())
        for rule in rules:
            found = cluster_mean(errors[rule], errors.index)
            ratio = cluster_mean(np.log(errors[rule] / errors[ROWE]), errors.index)
            bounds = np.exp([ratio.value, ratio.value - ratio.within, ratio.value + ratio.within])
            p_value = ratio.p_value if rule != ROWE else np.nan
            rows.append((part, rule, found.n, len(own), found.value, found.within, *bounds, p_value))
    columns = "part rule packings windows error within ratio low high p_value"
    found_table = pandas.DataFrame(rows, columns=columns.split())
    found_table = judged(found_table, found_table["ratio"] < 1.0)
    return found_table.assign(verdict=found_table["verdict"].where(found_table["rule"] != ROWE, ""))


def dilatancy_figure(table: pandas.DataFrame) -> Figure:
    """D against q/p of held-out tests: grains and each rule, a panel each for the models."""
    figure = new_figure(WIDTH, 3.2)
    own = table[table["part"] == "held out"].sort_values("ratio")
    models = [name for name in table.columns[6:] if name not in (ROWE, NOVA)]
    panels = figure.subplots(1, len(models), sharex=True, sharey=True)
    colors = colors_for(3)
    for panel, model in zip(panels, models, strict=True):
        panel.plot(own["ratio"], own[GRAINS], "o", color="0.6", ms=3, label=GRAINS)
        panel.plot(own["ratio"], own[model], ".", color=colors[0], ms=4, label="model")
        for rule, color in zip((ROWE, NOVA), colors[1:], strict=True):
            panel.plot(own["ratio"], own[rule], "-", color=color, lw=1.0, label=rule)
        panel.set(title=model, xlabel="q/p", ylim=(-0.8, 1.6))
    panels[0].set(ylabel=r"$D = -d\varepsilon_v/d\varepsilon_q$")
    panels[0].legend(fontsize=7)
    return figure
