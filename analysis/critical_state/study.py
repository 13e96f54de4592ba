"""`./lab critical-state`: runs the campaign, or uses the stored data set, and writes results/critical_state."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from analysis.critical_state import questions
from analysis.critical_state.collect import reduced
from analysis.critical_state.ends import end_table, records
from analysis.critical_state.figures import drift_figure, lines_figure, lode_figure
from analysis.places import results_folder
from analysis.statistics import SIGNIFICANT
from analysis.study import Figures, StoredTables, Study, Tables, Values
from labkit.records import INERTIAL_LIMIT


class CriticalState(Study):
    """The critical state at 100 % strain."""

    data, title = "statistics.nc", "The critical state at large strain"
    cubes = Path(results_folder("other_paths")) / "statistics.nc"  # the same specimens in compression and extension
    reduce = staticmethod(reduced)

    def sources(self, folder: Path) -> list[str | Path]:
        return [folder / self.data, *([self.cubes] if self.cubes.exists() else [])]

    def tables(self, data: xr.Dataset) -> Tables:
        table = records(data)
        ends = end_table(data, table)
        tables = {
            "ends": ends,
            "stationarity": questions.stationarity(table),
            "plateau": questions.plateau(table),
            "inertia": questions.inertia(data),
            "by_lode_angle": questions.by_lode_angle(ends),
            "curvature": questions.curvature(ends),
        }
        if self.cubes.exists():
            tables["same_cubes"] = questions.same_cubes(xr.load_dataset(self.cubes))
        asked = questions.one_critical_state(ends)
        tables |= {"one_critical_state": asked, "equivalence": questions.limits_of_equivalence(asked)}
        return tables | {"lines": questions.lines(ends), "offsets": questions.offsets(ends)}

    def figures(self, data: xr.Dataset, tables: StoredTables) -> Figures:
        return {
            "drift": drift_figure(records(data)),
            "lines": lines_figure(tables["ends"]),
            "lode_angle": lode_figure(tables["by_lode_angle"], tables["ends"]),
        }

    def numbers(self, tables: StoredTables) -> Values:
        asked = tables["one_critical_state"]
        once = asked.drop_duplicates(["quantity", "factor"])
        one = once.pivot(index="quantity", columns="factor", values="corrected")
        one = one.loc[once["quantity"].unique(), once["factor"].unique()].assign(
            shared=once.groupby("quantity")["shared"].first()
        )
        return {
            "one": one.reset_index(),
            "above": tables["inertia"][tables["inertia"]["max"] > INERTIAL_LIMIT],
            "resolved": asked[
                (asked["corrected"] <= SIGNIFICANT)
                & (asked["offset"].abs() > asked["within"])
                & ~asked["group"].isin(["compression", "paper"])  # the same offset with the other sign
            ],
        }


STUDY = CriticalState()
