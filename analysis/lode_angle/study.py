"""`./lab lode-angle`: runs the campaign, or uses the stored records, and writes results/lode_angle."""

from __future__ import annotations

import pandas
import xarray as xr

from analysis.critical_state.ends import BEGIN, end_table, records
from analysis.critical_state.questions import JUDGED
from analysis.other_paths.collect import reduced
from analysis.statistics import corrected, paired_difference
from analysis.statistics.stationarity import slope_table, stationarity_table
from analysis.study import Figures, StoredTables, Study, Tables
from labkit.figures import WIDTH, new_figure

ASKED = {"M": "M", "Z": "Z", "Lambda": r"$\Lambda$", "e": "e"}  # quantity -> label
STATIONARY = (*ASKED, "A", "F", "Ft")
BOUND = 2.5e-4  # limit of the inertial number; a test above it is left out
COMPRESSION, MIDDLE, EXTENSION = "b000", "b050", "b100"


class LodeAngle(Study):
    """True triaxial tests of the same cubes to 100 % strain."""

    data, title = "statistics.nc", "True triaxial tests of the same cubes to 100 % strain"
    reduce = staticmethod(reduced)

    def tables(self, data: xr.Dataset) -> Tables:
        table = records(data)
        largest = data["inertial_number"].max("point").to_series()
        ends = end_table(data, table)
        ends["inertial_number"] = ends["run"].map(largest)
        slopes = slope_table(table, STATIONARY, BEGIN, by=["test"])
        return {
            "ends": ends,
            "comparisons": comparisons(ends[ends["inertial_number"] <= BOUND]),
            "stationarity": stationarity_table(slopes, by=["test"], judged=JUDGED),
        }

    def figures(self, data: xr.Dataset, tables: StoredTables) -> Figures:
        figure = new_figure(WIDTH, 5.0)
        for axes, (quantity, name) in zip(figure.subplots(2, 2, sharex=True).flat, ASKED.items(), strict=True):
            for number, (_, cube) in enumerate(tables["ends"].groupby("specimen")):
                cube, label = cube.sort_values("lode"), "_" if number else "one cube"
                axes.plot("lode", quantity, "o-", color="0.6", ms=3, lw=0.8, data=cube, label=label)
            means = tables["ends"].groupby("test")[["lode", quantity]].mean()
            axes.plot("lode", quantity, "C0s", ms=5, data=means, label="mean")
            axes.set(ylabel=name, xlabel="Lode angle (degrees)" if quantity in ("Lambda", "e") else "")
        figure.axes[0].legend()
        return {"lode_angle": figure}


STUDY = LodeAngle()


def comparisons(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Comparisons 1 (b = 1 minus b = 0) and 2 (b = 0.5 minus the mean of both) of the plan, paired by cube.

    ends: Result of end_table. Columns: comparison, quantity, specimens, difference, within (95 %), p_value, corrected
    (Holm, for the four of each).
    """
    axial = ends["test"].isin([COMPRESSION, EXTENSION])
    both = ends[axial].groupby("specimen").filter(lambda cube: len(cube) == 2)
    chord = both.groupby("specimen", as_index=False)[list(ASKED)].mean().assign(test="chord")
    bent = pandas.concat([chord, ends[ends["test"] == MIDDLE]])
    parts = []
    for comparison, table, pair in ((1, ends, (COMPRESSION, EXTENSION)), (2, bent, ("chord", MIDDLE))):
        found = {quantity: paired_difference(table, quantity, "test", *pair) for quantity in ASKED}
        rows = [{"comparison": comparison, "quantity": name} | one.columns("difference") for name, one in found.items()]
        parts.append(corrected(rows))
    return pandas.concat(parts)
