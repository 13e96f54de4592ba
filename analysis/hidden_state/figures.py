"""Figures: equal states and their rates, the two forms, and the four tests that only fabric can tell apart."""

from __future__ import annotations

import numpy as np
import pandas
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.hidden_state.contest import FORMS, WITH_FABRIC, summary
from analysis.hidden_state.equal import TOO_FEW, WINDOWS
from analysis.hidden_state.fabric import GRAINS
from analysis.hidden_state.law import PRINTED_K
from analysis.study import StoredTables
from labkit.figures import WIDTH, colors_for, new_figure

DENSITIES = ("dense", "medium", "loose")
LABELS = {"D": "$D$", "dZ": "$dZ$", "dLambda": r"$d\Lambda$", "dA": "$dA$", "dF": "$dF$", "dFt": "$dF^t$"}
TURNS = ("turn 0.2", "turn 0.4", "turn 0.6", "cycles", "monotonic")
OF_D = ("cycles", "monotonic", "again 90")
OF_LABKIT = ("calibrated", "better", FORMS)
SHOWN = (GRAINS, FORMS, "calibrated", "better", WITH_FABRIC, "sanisand", "hypoplasticity")


def state_figure(tables: StoredTables) -> Figure:
    """Differences of rates between twins and between nearest states, other history over same; and the rankings."""
    figure = new_figure(WIDTH, 3.6)
    left, right = figure.subplots(1, 2)
    twins, nearest = (tables[name].query("density == 'all'") for name in ("twin_rates", "rates"))
    names, few = [*LABELS, *WINDOWS], (twins["verdict"] == TOO_FEW).any()
    for k, (label, rates) in enumerate(
        (("pairs below 0.2, too few" if few else "twins", twins), ("nearest states", nearest))
    ):
        x = np.array([names.index(name) for name in rates["rate"]]) + 0.2 * k
        errors = None if few and k == 0 else [rates["ratio"] - rates["low"], rates["high"] - rates["ratio"]]
        fill = "none" if errors is None else "full"
        left.errorbar(
            x, rates["ratio"], errors, fmt="os"[k], color=f"C{k}", fillstyle=fill, capsize=2, ms=4, label=label
        )
    left.axhline(1.0, color="0.6", lw=0.8)
    ticks = [LABELS.get(name, "D, " + name.replace(" %", "")) for name in names]
    left.set_xticks(range(len(names)), ticks, rotation=60, fontsize=7)
    left.set(ylabel="difference of rates, other history / same", ylim=(0.0, None))
    left.legend(fontsize=6, loc="upper center")
    order = list(tables["ranking"]["candidate"][1:][::-1])
    for k, name in enumerate(("twin_ranking", "ranking")):
        if few and k == 0:
            continue
        ranking = tables[name].set_index("candidate").loc[order]
        share = 100.0 * ranking[["share", "low", "high"]]
        errors = [share["share"] - share["low"], share["high"] - share["share"]]
        y = np.arange(len(order)) - 0.2 * k
        right.errorbar(share["share"], y, xerr=errors, fmt="os"[k], color=f"C{k}", capsize=2, ms=4)
    right.axvline(0.0, color="0.6", lw=0.8)
    right.set_yticks(range(len(order)), order)
    right.set_xlim(-60.0, 60.0)
    right.set_xlabel("variance of the difference of $D$ explained,\nleft out (%)")
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
            x = np.arange(len(tests)) + 0.12 * (k - 3.0)
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


def contest_figure(tables: StoredTables) -> Figure:
    """Errors of s/p and of volume of all laws, dense and medium, held out, with intervals; and undrained cycles."""
    figure = new_figure(WIDTH, 5.6)
    grid = figure.subplot_mosaic("AA;BB;CL")
    table = summary(tables["contest"]).query("part == 'held out' and densities == 'dense, medium'")
    laws, groups = list(dict.fromkeys(table["law"])), list(dict.fromkeys(table["group"]))
    colors = [*(f"C{k}" for k in range(10)), "navy"][: len(laws)]
    for axes, value, label in ((grid["A"], "stress", "error of s/p (%)"), (grid["B"], "volume", "error of volume (%)")):
        for k, (law, color) in enumerate(zip(laws, colors, strict=True)):
            own = table[table["law"] == law].set_index("group").reindex(groups)
            x = np.arange(len(groups)) + 0.85 * ((k + 0.5) / len(laws) - 0.5)
            marker = "s" if law in OF_LABKIT else "o"
            axes.errorbar(x, own[value], own[f"{value}_within"], fmt=marker, ms=4, color=color, label=law, capsize=1)
        axes.set_xticks(range(len(groups)), groups)
        axes.set(ylabel=label, ylim=(0.0, None))
    grid["B"].set(yscale="log", ylim=(1.0, 1e3))
    own, axes = tables["cycles"].query("density == 'loose'"), grid["C"]
    for law, color in zip((GRAINS, *laws), ("k", *colors), strict=True):
        of_law = own[own["law"] == law]
        median = of_law.groupby("CSR")["N"].median()
        if law == GRAINS:
            axes.plot(of_law["N"], of_law["CSR"], ".", color="0.5", ms=4, label="a specimen of grains")
        line = {"lw": 2.0, "label": "grains, median"} if law == GRAINS else {"lw": 0.8}
        axes.plot(median.values, median.index, "-", color=color, **line)
    axes.set(xscale="log", xlabel="N to $r_u$ = 0.95, loose (30: not reached)", ylabel="CSR")
    axes.set_xticks([1, 2, 5, 10, 20, 30], ["1", "2", "5", "10", "20", "30"], minor=False)
    axes.minorticks_off()
    handles = [handle for panel in "AC" for handle in grid[panel].get_legend_handles_labels()[0]]
    grid["L"].legend(handles=handles, fontsize=7, ncols=2, loc="center")
    grid["L"].axis("off")
    return figure
