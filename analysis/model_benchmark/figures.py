"""Figures: attractors against the Lode angle, errors of all models, and curves of some tests."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pandas
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from analysis.model_benchmark.score import REPEATED, Contestant, predicted
from analysis.model_benchmark.tables import judged_part
from labkit.figures import WIDTH, colors_for, new_figure
from labkit.micro import equivalent_stress, lode_angle, mean_stress
from labkit.model import Model, attractors, principal_cosines

LABELS = {"A": "$A$", "F": "$F$", "Ft": "$F^t$"}
GROUPS = ("compression", "undrained", "extension", "b", "simple shear", "rotation", "cycles", "hidden fabric")
SHOWN = ("triaxial_b05-true_500-s41", "shear-cube_500-s51", "cp_extension-flat_medium_500-s11")  # held out


def attractors_figure(ends: pandas.DataFrame, models: dict[str, Model]) -> Figure:
    """Norms and Lode angles of A, F and F^t at the ends of the tests, at p near 500 kPa, and the models' attractors."""
    figure = new_figure(WIDTH, 5.2)
    panels = figure.subplots(2, 3, sharex=True)
    theta = np.linspace(0.0, 60.0, 121)
    cosines = principal_cosines(theta)
    n = np.zeros((theta.size, 3, 3))
    n[:, [0, 1, 2], [0, 1, 2]] = cosines / np.linalg.norm(cosines, axis=1, keepdims=True)
    own = ends[ends["p"].between(0.4e6, 0.6e6)]
    colors = colors_for(len(models))
    for k, key in enumerate(LABELS):
        for part, marker in (("training", "o"), ("known packing", "+"), ("held out", "x")):
            rows = own[own["part"] == part]
            panels[0, k].plot(rows["theta"], rows[key], marker, color="0.4", ms=4, label=f"grains, {part}")
            panels[1, k].plot(rows["theta"], rows[f"{key}_theta"], marker, color="0.4", ms=4)
        for color, (name, model) in zip(colors, models.items(), strict=True):
            T = attractors(n, model, float(own["e"].mean()))[k]
            panels[0, k].plot(theta, np.linalg.norm(T, axis=(1, 2)), color=color, label=name)
            panels[1, k].plot(theta, lode_angle(T), color=color)
        panels[0, k].set(title=LABELS[key], ylim=(0.0, None))
        panels[1, k].set(xlabel="Lode angle of the strain rate (degrees)")
    panels[0, 0].set(ylabel="norm")
    panels[1, 0].set(ylabel="Lode angle (degrees)")
    panels[0, 0].legend(fontsize=7)
    return figure


def errors_figure(scores: pandas.DataFrame, table: pandas.DataFrame, own: Collection[str]) -> Figure:
    """Error of s/p driven by strain (hidden fabric: by stress), a panel per group; means, intervals and packings.

    `table`: summary of the scores; `own`: labkit's models. Fewer than three packings have no interval.
    """
    means, each = (_shown(judged_part(one)) for one in (table, scores))
    each = each.groupby(["group", "model", "packing"])["stress"].mean()
    models = list(dict.fromkeys(means["model"]))[::-1]
    models.sort(key=lambda model: (model != REPEATED) + (model in own))
    figure = new_figure(WIDTH, 6.4)
    panels = figure.subplots(2, len(GROUPS) // 2, sharey=True)
    colors = dict(zip(("labkit", "peers", REPEATED), (*colors_for(2), "black"), strict=True))
    for panel, group in zip(panels.flat, GROUPS, strict=True):
        rows = means[means["group"] == group].set_index("model")
        for at, model in enumerate(models):
            if model not in rows.index:
                continue
            kind = REPEATED if model == REPEATED else "labkit" if model in own else "peers"
            values = each[group][model]
            within = rows.loc[model, "stress_within"] if len(values) > 2 else None
            panel.plot(values, np.full(len(values), at), ".", color="0.7", ms=4, zorder=1)
            mean = rows.loc[model, "stress"]
            panel.errorbar(mean, at, xerr=within, fmt="o", ms=4, lw=1.2, color=colors[kind])
        few = rows["packings"].max() < 3
        known = " (known packings)" if group == "rotation" else " (2 packings: no interval)" if few else ""
        panel.set_title(group + known, fontsize=9)
        panel.set_xlim(0.0, None)
        panel.grid(axis="x", lw=0.4)
    panels[0, 0].set_yticks(np.arange(len(models)), models)
    for panel in panels[1]:
        panel.set_xlabel("error of $s/p$ (%)")
    handles = [Line2D([], [], marker="o", ls="", color=color, label=kind) for kind, color in colors.items()]
    handles.append(Line2D([], [], marker=".", ls="", color="0.7", label="single packings"))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=8)
    return figure


def _shown(rows: pandas.DataFrame) -> pandas.DataFrame:
    driven = (rows["drive"] == "strain") | (rows["group"] == "hidden fabric") | (rows["model"] == REPEATED)
    return rows[driven]


def curves_figure(data: xr.Dataset, contestants: list[Contestant]) -> Figure:
    """q/p, Lode angle and p of grains and models along held-out tests that are driven by strain."""
    figure = new_figure(WIDTH, 7.0)
    panels = figure.subplots(3, len(SHOWN), sharex="col", squeeze=False)
    for column, name in enumerate(SHOWN):
        test = data.sel(run=name).astype("f8")
        stresses = {"grains": test["stress"].values}
        stresses |= {c.name: predicted(c, test, "strain")["stress"] for c in contestants}
        colors = ["black", *colors_for(len(contestants))]
        for color, (label, stress) in zip(colors, stresses.items(), strict=True):
            along = 100.0 * test["along"].values[: len(stress)]
            p = mean_stress(stress)
            sheared = equivalent_stress(stress) > 0.1 * p
            rows = (equivalent_stress(stress) / p, np.where(sheared, lode_angle(stress), np.nan), p / 1e6)
            for panel, values in zip(panels[:, column], rows, strict=True):
                panel.plot(along, values, color=color, lw=1.5 if label == "grains" else 1.0, label=label)
        panels[0, column].set_title(name, fontsize=9)
        panels[-1, column].set(xlabel="accumulated strain (%)")
    for row, label in enumerate(("q/p", "Lode angle (degrees)", "p (MPa)")):
        panels[row, 0].set(ylabel=label)
    panels[0, 0].legend(fontsize=7)
    return figure
