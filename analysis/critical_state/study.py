"""`./lab critical-state`: runs the campaign, or uses the stored data set, and writes results/critical_state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr
from matplotlib.figure import Figure

from analysis.critical_state.ends import BEGIN, end_table, records
from analysis.critical_state.figures import drift_figure, lines_figure, lode_figure
from analysis.critical_state.questions import by_lode_angle, lines, offsets, one_critical_state, stationarity
from analysis.other_paths.collect import collect
from analysis.statistics import SIGNIFICANT
from analysis.study import Study, Tables
from labkit.engines import Progress
from labkit.io import reporter


class CriticalState(Study):
    """The critical state at 100 % of strain."""

    data = "statistics.nc"

    def gather(self, runs: Sequence[Path], file: Path, command: str) -> None:
        collect(runs, file, command, reporter("statistics"), "The critical state at large strain")

    def read(self, file: Path) -> xr.Dataset:
        return xr.load_dataset(file)

    def tables(self, data: xr.Dataset, progress: Progress) -> Tables:
        progress(0.0, "ends of the tests")
        table = records(data)
        ends = end_table(data, table)
        tables = {"ends": ends, "stationarity": stationarity(table), "by_lode_angle": by_lode_angle(ends)}
        progress(0.5, "one critical state")
        return tables | {"one_critical_state": one_critical_state(ends), "lines": lines(ends), "offsets": offsets(ends)}

    def figures(self, data: xr.Dataset, tables: Tables) -> Mapping[str, Figure]:
        return {
            "drift": drift_figure(records(data)),
            "lines": lines_figure(tables["ends"]),
            "lode_angle": lode_figure(tables["by_lode_angle"], tables["ends"]),
        }

    def numbers(self, tables: Tables) -> Mapping[str, Any]:
        asked = tables["one_critical_state"]
        once = asked.drop_duplicates(["quantity", "factor"])
        one = once.pivot(index="quantity", columns="factor", values="corrected")
        one = one.loc[once["quantity"].unique(), once["factor"].unique()].assign(
            shared=once.groupby("quantity")["shared"].first()
        )
        return {
            "last": 1.0 - BEGIN,
            "specimens": tables["ends"]["specimen"].nunique(),
            "one": one.reset_index(),
            "resolved": asked[(asked["corrected"] <= SIGNIFICANT) & (asked["offset"].abs() > asked["within"])],
        }


STUDY = CriticalState()
