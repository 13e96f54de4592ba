"""Figure of the ends of shear tests: e against p with the critical-state line, q against p, and the state parameter."""

from __future__ import annotations

import itertools

import numpy as np
import pandas
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from labkit.figures.coordinates import INVARIANT, STRAIN, VOID_RATIO, P, same_q
from labkit.figures.frame import Runs, colors_for, columns_of, new_panels, plain, plain_ticks
from labkit.results.critical import CriticalLine
from labkit.results.stationary import CONFIDENCE

MARKERS = "os^vDP*X<>"


def ends_of_tests(runs: Runs, states: pandas.DataFrame, line: tuple[CriticalLine, str] | None = None) -> Figure:
    """Draw shear tests and the means of the table `critical_states`; returns a Figure.

    A marker at the mean of the last quarter is filled if the end is shown to be critical. The third panel shows the
    state parameter psi = e - e_c(p) against the strain or, without a line, the void ratio.

    Args:
        runs: Name -> run opened with labkit.open_run.
        states: The table critical_states of these runs.
        line: Critical-state line, drawn with its 95 % interval, and its label (labkit.results.critical.line_of).
    """
    figure, (left, middle, right) = new_panels(1, 3, 4.4)
    q, _ = same_q(runs)
    handles = []
    colors = colors_for(len(runs))
    for color, marker, (name, run), (_, state) in zip(
        colors, itertools.cycle(MARKERS), runs.items(), states.iterrows(), strict=False
    ):
        look = {"marker": marker, "color": color, "mfc": color if state["critical"] == "yes" else "white", "ms": 6}
        p, deviator, e = (of.values(run, "stress") for of in (P, q, VOID_RATIO))
        left.plot(p, e, color=color, lw=1.2)
        middle.plot(p, deviator, color=color, lw=1.2)
        strain = STRAIN.values(run, "stress")
        right.plot(strain, e if line is None else line[0].state_parameter(e, 1e6 * p), color=color, lw=1.2)
        left.plot(state["p_MPa"], state["e"], **look, zorder=3)
        ratio = abs(state["M"]) if q is INVARIANT else state["M"]
        middle.plot(state["p_MPa"], ratio * state["p_MPa"], **look, zorder=3)
        handles.append(Line2D([], [], **look, lw=1.2, label=plain(name)))
    left.set(xlabel=P.common_label(runs.values()), ylabel=VOID_RATIO.label, xscale="log")
    plain_ticks(left.xaxis)
    middle.set(xlabel=P.common_label(runs.values()), ylabel=q.common_label(runs.values()), xlim=(0, None))
    right.set(
        xlabel=STRAIN.common_label(runs.values()), ylabel="void ratio e" if line is None else "state parameter $\\psi$"
    )
    if line is not None:
        p = np.geomspace(*line[0].pressures, 50)
        e, within = line[0].void_ratio(p), line[0].within(p)
        handles += left.plot(p / 1e6, e, "k--", lw=1.2, label=line[1])
        if np.isfinite(within).all():
            interval = left.fill_between(p / 1e6, e - within, e + within, color="0.85", zorder=0)
            interval.set_label(f"{CONFIDENCE:.0%} interval of the line".replace("%", " %"))
            handles.append(interval)
        right.axhline(0.0, color="0.5", lw=0.8)
    shown = {"mean of the last quarter, shown to be critical": "0.3", "not shown to be critical": "white"}
    handles += [Line2D([], [], marker="o", ls="", color="0.3", mfc=fill, label=text) for text, fill in shown.items()]
    figure.key(columns_of((str(handle.get_label()) for handle in handles), 5), handles)
    return figure
