"""`./lab dense-against-loose`: runs the campaign, or uses the stored records; writes results/dense_against_loose."""

from __future__ import annotations

import pandas
import xarray as xr

from analysis.critical_state.ends import end_table, records
from analysis.critical_state.questions import JUDGED
from analysis.other_paths.collect import reduced
from analysis.statistics import corrected, difference_of_means
from analysis.statistics.stationarity import slope_table, stationarity_table
from analysis.study import Figures, StoredTables, Study, Tables
from labkit.figures import WIDTH, new_figure

STRAIN, BEGIN = 0.75, 0.45  # strain of a test, and of its window
SECOND = ("Z", "Lambda", "M", "A", "F", "Ft")
PRESSURES = {"low": "250 kPa", "high": "1 MPa"}
DENSITIES = {"dense": "C0", "loose": "C1"}  # colours
MARGINS = {"e": 0.003, "Z": 0.04, "Lambda": 1e-4}
RELATIVE = 0.01  # margin of the other quantities, as a fraction of their value


class DenseAgainstLoose(Study):
    """CP tests at two pressures from dense and from loose specimens, to 75 % strain."""

    data, title = "statistics.nc", "CP tests from dense and from loose specimens to 75 % strain"
    reduce = staticmethod(reduced)

    def tables(self, data: xr.Dataset) -> Tables:
        table = records(data)
        ends = end_table(data, table, BEGIN / STRAIN)
        slopes = slope_table(table, ("e", *SECOND), BEGIN, by=["test", "density"])
        return {
            "ends": ends,
            "differences": differences(ends),
            "stationarity": stationarity_table(slopes, by=["test", "density"], judged=JUDGED),
        }

    def figures(self, data: xr.Dataset, tables: StoredTables) -> Figures:
        figure, table = new_figure(WIDTH, 3.2), records(data)
        for axes, (test, pressure) in zip(figure.subplots(1, 2, sharey=True), PRESSURES.items(), strict=True):
            for density, colour in DENSITIES.items():
                chosen = table[(table["test"] == test) & (table["density"] == density)]
                for number, (_, run) in enumerate(chosen.groupby("run")):
                    line = {"label": density} if number == 0 else {}
                    axes.plot(100.0 * run["strain"], run["e"], color=colour, lw=0.6, **line)
            axes.axvspan(100.0 * BEGIN, 100.0 * STRAIN, color="0.93", zorder=0)
            axes.set(xlabel="strain (%)", title=f"p = {pressure}")
        figure.axes[0].set_ylabel("void ratio e")
        figure.axes[0].legend()
        return {"void_ratio": figure}


STUDY = DenseAgainstLoose()


def differences(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Dense minus loose specimens at each pressure (Welch's t test), comparisons 1 (e) and 2 (SECOND) of the plan.

    ends: Result of end_table. Columns: comparison, test, quantity, loose (mean), specimens, difference, within (95
    %), p_value, judged (the margin), corrected (Holm, for each comparison), equivalent (the whole interval is within
    the margin).
    """
    parts = []
    for comparison, quantities in ((1, ("e",)), (2, SECOND)):
        rows = []
        for test in PRESSURES:
            groups = {name: ends[(ends["test"] == test) & (ends["density"] == name)] for name in DENSITIES}
            for quantity in quantities:
                found = difference_of_means(groups["loose"][quantity], groups["dense"][quantity])
                loose = float(groups["loose"][quantity].mean())
                row = {"comparison": comparison, "test": test, "quantity": quantity, "loose": loose}
                judged = MARGINS.get(quantity, RELATIVE * abs(loose))
                rows.append(row | found.columns("difference") | {"judged": judged})
        parts.append(corrected(rows))
    table = pandas.concat(parts)
    return table.assign(equivalent=table["difference"].abs() + table["within"] <= table["judged"])
