"""Figures: equal states and their rates, the two forms, and the four tests that only fabric can tell apart."""

from __future__ import annotations

import numpy as np
import pandas
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.hidden_state.fabric import FORMS, GRAINS
from analysis.hidden_state.law import PRINTED_K
from analysis.study import StoredTables
from labkit.figures import WIDTH, colors_for, new_figure

DENSITIES = ("dense", "medium", "loose")
LABELS = {"D": "$D$", "dZ": "$dZ$", "dLambda": r"$d\Lambda$", "dA": "$dA$", "dF": "$dF$", "dFt": "$dF^t$"}
TURNS = ("turn 0.2", "turn 0.4", "turn 0.6", "cycles", "monotonic")
OF_D = ("cycles", "monotonic", "again 90")
SHOWN = (GRAINS, FORMS, "calibrated", "better", "sanisand", "hypoplasticity")


def state_figure(tables: StoredTables) -> Figure:
    """Differences of rates between equal states, with other history and with the same, and the ranking."""
    figure = new_figure(WIDTH, 3.4)
    left, right = figure.subplots(1, 2)
    rates = tables["rates"].query("density == 'all'")
    x = np.arange(len(rates))
    low, high = rates["ratio"] - rates["low"], rates["high"] - rates["ratio"]
    left.errorbar(x, rates["ratio"], yerr=[low, high], fmt="o", color="C0", capsize=3, label="all densities")
    for k, density in enumerate(DENSITIES):
        own = tables["rates"].query("density == @density")
        left.plot(x[: len(own)] + 0.1 + 0.08 * k, own["ratio"], "x", color=f"C{k + 1}", ms=4, label=density)
    left.axhline(1.0, color="0.6", lw=0.8)
    left.set_xticks(x, [LABELS[name] for name in rates["rate"]])
    left.set(ylabel="difference of rates, other history / same", ylim=(0.0, None))
    left.legend(fontsize=7)
    ranking = tables["ranking"][1:][::-1]
    y = np.arange(len(ranking))
    share = 100.0 * ranking[["share", "low", "high"]]
    errors = [share["share"] - share["low"], share["high"] - share["share"]]
    right.errorbar(share["share"], y, xerr=errors, fmt="o", color="C0", capsize=3)
    right.axvline(0.0, color="0.6", lw=0.8)
    right.set_yticks(y, ranking["candidate"])
    right.set_xlabel("variance of the difference of $D$ explained,\npackings left out (%)")
    return figure


def law_figure(tables: StoredTables) -> Figure:
    """Initial slopes of F against Z; errors of F and of D on the held-out seeds."""
    figure = new_figure(WIDTH, 5.4)
    grid = figure.subplot_mosaic("ABB;CCC")
    slopes = tables["slopes"]
    for k, density in enumerate(DENSITIES):
        own = slopes.query("density == @density")
        grid["A"].plot(own["Z"], own["slope"], ".", color=f"C{k}", label=density)
    Z = np.linspace(slopes["Z"].min(), slopes["Z"].max(), 2)
    grid["A"].plot(Z, PRINTED_K[0] * (Z - PRINTED_K[1]), "k--", lw=1.0, label="58.7 (Z - 3.15)")
    fitted = tables["stiffness"].iloc[0]
    grid["A"].plot(Z, fitted["k"] * (Z - fitted["Z_0"]), "k-", lw=1.0, label="fitted")
    grid["A"].set(xlabel="Z", ylabel="initial $dF/d\\varepsilon$")
    grid["A"].legend(fontsize=6)
    _bars(grid["B"], tables["of_F"], "error", TURNS, "error of F (%)")
    _bars(grid["C"], tables["of_D"], "D", OF_D, "error of D")
    return figure


def _bars(axes: Axes, table: pandas.DataFrame, value: str, groups: tuple[str, ...], label: str) -> None:
    held = table[table["part"] == "held out"]
    held = held if len(held) else table
    forms = list(dict.fromkeys(held["form"]))
    places = [(group, density) for group in groups for density in DENSITIES]
    places = [key for key in places if len(held.query("group == @key[0] and density == @key[1]"))]
    for k, (form, color) in enumerate(zip(forms, colors_for(len(forms)), strict=True)):
        own = held[held["form"] == form].set_index(["group", "density"])[value]
        heights = [float(own.get(key, np.nan)) for key in places]
        axes.bar(
            np.arange(len(places)) + 0.8 * (k / len(forms) - 0.4), heights, 0.8 / len(forms), color=color, label=form
        )
    axes.set_xticks(range(len(places)), [f"{group}\n{density}" for group, density in places], fontsize=5)
    axes.set_ylabel(label)
    axes.legend(fontsize=6)


def fabric_figure(table: pandas.DataFrame) -> Figure:
    """Least p/p_0 of the four tests, a panel per density: grains (specimens and their mean), models and peers."""
    figure = new_figure(WIDTH, 3.2)
    panels = figure.subplots(1, len(DENSITIES), sharey=True)
    tests = [("pre+", "compression"), ("pre+", "extension"), ("pre-", "compression"), ("pre-", "extension")]
    for axes, density in zip(panels, DENSITIES, strict=True):
        own = table[table["density"] == density]
        for k, model in enumerate(SHOWN):
            of_model = own[own["model"] == model]
            values = [of_model.query("before == @b and direction == @d")["least"] for b, d in tests]
            x = np.arange(len(tests)) + 0.12 * (k - 2.5)
            axes.plot(
                x, [value.mean() for value in values], "_" if model != GRAINS else "k_", ms=10, mew=2, label=model
            )
            if model == GRAINS:
                for place, each in zip(x, values, strict=True):
                    axes.plot(np.full(len(each), place), each, ".", color="0.5", ms=4)
        axes.set_xticks(range(len(tests)), [f"{before}\n{direction[:4]}." for before, direction in tests], fontsize=7)
        axes.set(title=density, ylim=(0.0, 1.05))
    panels[0].set_ylabel("least $p/p_0$ to 3 %")
    panels[-1].legend(fontsize=6)
    return figure
