"""`./lab size-scatter`: runs the campaign, or uses the stored curves, and writes results/size_scatter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas
import xarray as xr
from matplotlib.figure import Figure

from analysis.curves import CURVES, read_curves, window_means
from analysis.paper.estimates import text, two_samples
from analysis.places import results_folder
from analysis.size_scatter.figures import drift_figure, sizes_figure
from analysis.size_scatter.sizes import MEASURED, SMALL, bias_table, c0_table, scatter_table, size_table
from analysis.size_scatter.stored import PREFIX, stored_curves
from analysis.statistics import corrected, slope_table, stationarity_table
from analysis.study import StoredTables, Study, Tables
from labkit.engines import Progress
from labkit.model import Parameters

WINDOW = (0.3, 0.4)  # window of strain; the state of a test is its mean over it
PERCENT = ("norm", "norm_within", "q", "q_within")
LIMITS = {"Lambda": 1e-4, "e": 1e-3}  # smallest slopes that matter, per 0.1 of strain


class SizeScatter(Study):
    """Scatter and bias of the critical state against the number of grains."""

    data, title = CURVES, "Scatter and bias against the number of grains"

    def stored(self) -> tuple[Mapping[str, xr.Dataset], Sequence[Path]]:
        return stored_curves(Path(results_folder()))

    def read(self, file: Path) -> pandas.DataFrame:
        curves = read_curves(file)
        curves["size"] = curves["specimen"].str.partition("-")[0]
        return curves.sort_values("grains", kind="stable", ignore_index=True)

    def tables(self, data: pandas.DataFrame, progress: Progress) -> Tables:
        ends = window_means(data, *WINDOW)
        ends["size"] = ends["specimen"].str.partition("-")[0]
        sizes = size_table(ends)
        return {
            "c0_error": c0_table(data),
            "ends": ends,
            "sizes": sizes,
            "scatter": scatter_table(sizes),
            "bias": bias_table(ends),
            "stored": stored_table(ends),
            "stationarity": stationarity_table(slope_table(data, MEASURED, *WINDOW), judged=LIMITS),
        }

    def figures(self, data: pandas.DataFrame, tables: StoredTables) -> Mapping[str, Figure]:
        sizes = sizes_figure(tables["ends"], tables["sizes"], tables["scatter"])
        return {"drift": drift_figure(data, WINDOW), "sizes": sizes}

    def numbers(self, tables: StoredTables) -> Mapping[str, Any]:
        ends, sizes = tables["ends"], tables["sizes"]
        largest = sizes.groupby("quantity", sort=False)["mean"].last()
        scatters = []
        for quantity, group in sizes.groupby("quantity", sort=False):
            cells = {f"scatter, {row['size'][1:]}": text(row["scatter"], digits=2) for _, row in group.iterrows()}
            scatters.append({"quantity": quantity, "mean": text(largest[quantity]), **cells})
        relative = tables["scatter"].set_index("quantity").loc["Lambda", "relative"]
        return {
            "stored": int((ends["test"] == PREFIX).sum()),
            "counts": ends.groupby("size", sort=False)["run"].count(),
            "begin": 100 * WINDOW[0],
            "end": 100 * WINDOW[1],
            "small": SMALL,
            "scatters": pandas.DataFrame(scatters),
            "c0_percent": tables["c0_error"].assign(**{key: 100 * tables["c0_error"][key] for key in PERCENT}),
            "scatter_of_e": relative * largest["Lambda"] / Parameters().c_cLam,
        }


STUDY = SizeScatter()


def stored_table(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Stored tests against those of the campaign with about as many grains (4,000), a row per quantity.

    Columns: quantity, mean (of the stored ones), difference (campaign minus stored, Welch), within, specimens, p_value,
    corrected (Holm).
    """
    both = ends[ends["size"] == "n4000"]
    slow = both["test"] == PREFIX
    rows = []
    for quantity in MEASURED:
        found = two_samples(lambda table, q=quantity: float(table[q].mean()), both[slow], both[~slow])  # type: ignore[misc]
        rows.append({"quantity": quantity, "mean": both.loc[slow, quantity].mean(), **found.columns("difference")})
    return corrected(rows, ["quantity", "mean", "difference", "within", "specimens", "p_value"])
