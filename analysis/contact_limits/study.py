"""`./lab contact-limits`: runs the campaign, or uses the stored values, and writes results/contact_limits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas

import labkit as lk
from analysis.critical_state.ends import quantities_of
from analysis.curves import accumulated_strain
from analysis.paper.lines import critical_Z
from analysis.statistics import cluster_mean, corrected, judge_plan, paired_difference, with_verdict
from analysis.study import Figures, Study, Tables
from labkit.figures import WIDTH, new_figure
from labkit.io import write_with_provenance

WINDOWS = {"before shear": (0.0, 0.0), "20-30 %": (0.2, 0.3), "30-40 %": (0.3, 0.4)}
PLANNED = "30-40 %"
MARGIN = 0.02  # margin of Z
LINE = 0.04  # uncertainty of Z^c(e) from the paper's rounding
SECOND = ("M", "A", "F", "Ft", "Lambda", "p_MPa", "rattlers")
RELATIVE, OF_RATTLERS = 0.01, 0.005  # differences that matter
ROUNDING = 1e-6  # tolerance of a strain


class ContactLimits(Study):
    """Which forces the limits of Eqs. 2 and 3 apply to, in pairs of specimens."""

    data = "values.csv"

    def gather(self, runs: Sequence[Path], file: Path, command: str) -> None:
        rows = []
        for one in runs:
            reading, _, seed = one.name.removesuffix(".run.nc").removeprefix("cv-").partition("-")
            with lk.open_run(one) as run:
                values = pandas.DataFrame({"strain": accumulated_strain(run), **quantities_of(run)})
                values["rattlers"] = run["rattler_fraction"].values
            for window, (begin, end) in WINDOWS.items():
                inside = values[values["strain"].between(begin, end + ROUNDING)]
                rows.append({"reading": reading, "specimen": seed, "window": window, **inside.mean().to_dict()})
        text = pandas.DataFrame(rows).to_csv(index=False, float_format="%.7g")
        write_with_provenance(file, text, runs, command)

    def read(self, file: Path) -> pandas.DataFrame:
        values = pandas.read_csv(file)
        return values.assign(Z_off=values["Z"] - critical_Z(values["e"]))

    def tables(self, data: pandas.DataFrame) -> Tables:
        return {"differences": differences(data), "offsets": offsets(data)}

    def figures(self, data: pandas.DataFrame, tables: Tables) -> Figures:
        wide = data[data["window"] == PLANNED].pivot(index="specimen", columns="reading", values="Z")
        figure = new_figure(0.5 * WIDTH, 2.8)
        axes = figure.subplots()
        axes.plot(range(2), wide[["springs", "forces"]].T, "o-", color="0.5", ms=3, lw=0.8)
        axes.set(xticks=range(2), xticklabels=["springs", "forces"], xlim=(-0.3, 1.3), ylabel="coordination number $Z$")
        return {"pairs": figure}


STUDY = ContactLimits()


def differences(values: pandas.DataFrame) -> pandas.DataFrame:
    """`forces` minus `springs` on the same seeds, a row per comparison of the plan (1, 2 and 4), quantity and window.

    Columns: comparison, quantity, window, springs (mean), difference, within (95 %), specimens (pairs), p_value,
    corrected (comparison 2: Holm; else as p_value), judged (the smallest difference that matters), resolved, equivalent
    (the whole interval is within `judged`).
    """
    asked = [(1, "Z", PLANNED)] + [(2, name, PLANNED) for name in SECOND]
    asked += [(4, "Z", window) for window in WINDOWS if window != PLANNED]
    rows = []
    for comparison, quantity, window in asked:
        own = values[values["window"] == window]
        mean = float(own.loc[own["reading"] == "springs", quantity].mean())
        found = paired_difference(own, quantity, "reading", "springs", "forces")
        judged = {"Z": MARGIN, "rattlers": OF_RATTLERS}.get(quantity, RELATIVE * abs(mean))
        row = {"comparison": comparison, "quantity": quantity, "window": window, "springs": mean}
        rows.append(row | found.columns("difference") | {"judged": judged})
    return judge_plan(rows)


def offsets(values: pandas.DataFrame) -> pandas.DataFrame:
    """Comparison 3: Z - Z^c(e) of the paper with either reading. Columns: reading, offset, within, ..., verdict."""
    own = values[values["window"] == PLANNED]
    rows = []
    for reading, group in own.groupby("reading", sort=False):
        rows.append({"reading": reading, **cluster_mean(group["Z_off"], group["specimen"]).columns("offset")})
    return with_verdict(corrected(rows).assign(judged=LINE), "offset").drop(columns="judged")
