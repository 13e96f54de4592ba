"""Figures of the study: critical state lines of the materials, and the changes of the constants."""

from __future__ import annotations

import numpy as np
import pandas
from matplotlib.figure import Figure

from analysis.constants.materials import CONSTANTS, PAPER, VARIED, Cells, constants
from analysis.legends import legend_below
from analysis.paper.lines import critical_Lambda, critical_Z
from analysis.places import texts
from labkit.figures import WIDTH, colors_for, new_figure

SYMBOLS: dict[str, str] = texts(__file__)["symbols"]
NAMES: dict[str, str] = texts(__file__)["constants"]


def label_of(material: str) -> str:
    """Name of a material for a legend, with the value of its parameter."""
    for parameter, materials in VARIED.items():
        if material in materials and material != PAPER:
            return f"{SYMBOLS[parameter]} = {materials[material]:g}"
    return "Table 1"


def lines_figure(ends: pandas.DataFrame, cells: Cells) -> Figure:
    """States of the tests and the lines through them: Z and Lambda against e, a column per parameter."""
    figure = new_figure(WIDTH * 1.3, 6.6)
    axes = figure.subplots(2, len(VARIED), sharex=True, sharey="row")
    e = np.linspace(0.54, 0.82, 200)
    for column, (parameter, materials) in zip(axes.T, VARIED.items(), strict=True):
        for panel, line in zip(column, (critical_Z, critical_Lambda), strict=True):
            panel.plot(e, np.where(e < 0.76, line(e), np.nan), "-", color="0.7", lw=3, label="Table 2 of the paper")
        present = [material for material in materials if material in cells]
        for own, material in zip(colors_for(len(present)), present, strict=True):
            color = "black" if material == PAPER else own
            rows = ends[ends["material"] == material]
            states = np.array([cell.mean for cell in cells[material]])
            e_cmax, c_cLam, c_cZ, gamma = constants(states)[4:8]
            below = e[e < e_cmax]
            column[0].plot(rows["e"], rows["Z"], "o", ms=4, color=color, mfc="none")
            column[1].plot(rows["e"], rows["Lambda"], "o", ms=4, color=color, mfc="none")
            column[0].plot(below, 4.0 + c_cZ * (e_cmax - below) ** gamma, color=color, label=label_of(material))
            column[1].plot(below, c_cLam * (e_cmax - below), color=color, label=label_of(material))
        column[0].set(title=f"{SYMBOLS[parameter]} varied", ylim=(4.0, 6.4))
        column[1].set(xlabel="void ratio $e$", ylim=(0.0, 0.024))
        column[1].legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    axes[0, 0].set_ylabel("coordination number $Z$")
    axes[1, 0].set_ylabel("mean normalised force $\\Lambda$")
    return figure


def changes_figure(table: pandas.DataFrame) -> Figure:
    """Draw the constants of every material with 95 % intervals, one panel each; the band shows Table 1's grains."""
    figure = new_figure(WIDTH * 1.3, 7.0)
    axes = figure.subplots(3, 3, sharex=True)
    base = table[table["parameter"] == PAPER].set_index("constant")
    others = table[table["parameter"] != PAPER]
    names = list(dict.fromkeys(zip(others["parameter"], others["value"], strict=True)))
    positions = {name: k for k, name in enumerate(names)}
    for panel, constant in zip(axes.ravel(), CONSTANTS, strict=True):
        value, within = base.loc[constant, "estimate"], base.loc[constant, "within"]
        panel.axhspan(value - within, value + within, color="0.85", label="Table 1, 95 %")
        panel.axhline(value, color="0.6", lw=1)
        rows = others[others["constant"] == constant]
        for differs, style in ((True, {"color": "tab:red"}), (False, {"color": "tab:blue", "mfc": "none"})):
            shown = rows[(rows["verdict"] == "differs") == differs]
            at = [positions[name] for name in zip(shown["parameter"], shown["value"], strict=True)]
            label = "differs (Holm)" if differs else "agrees or not resolved"
            panel.errorbar(at, shown["estimate"], shown["within"], fmt="o", ms=4, capsize=3, label=label, **style)
        panel.set_title(NAMES[constant])
    for panel in axes[-1]:
        texts = [f"{SYMBOLS[parameter]} = {value:g}" for parameter, value in names]
        panel.set_xticks(range(len(names)), texts, rotation=60, ha="right", fontsize=8)
    legend_below(figure, axes[0, 0], 3)
    return figure
