"""`./lab size-scatter`: runs the campaign, or uses the stored curves, and writes results/size_scatter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas
import xarray as xr

import labkit as lk
from analysis.curves import AT_FULL_STRAIN, CURVES, curves_at_full_strain, curves_of, read_curves, window_means
from analysis.markdown import text
from analysis.places import results_folder
from analysis.size_scatter.figures import drift_figure, sizes_figure
from analysis.size_scatter.sizes import MEASURED, bias_table, c0_table, scatter_table, size_table
from analysis.statistics import corrected, difference_of_means
from analysis.statistics.stationarity import slope_table, stationarity_table
from analysis.study import Figures, StoredTables, Study, Tables, Values
from labkit.model import Parameters

WINDOW = (0.3, 0.4)  # window of strain; the state of a test is its mean over it
PERCENT = ("norm", "norm_within", "q", "q_within")
PREFIX = "stored"
STRAIN = 0.4  # the tests are used up to this strain
OF_THE_PAPER = ("cv-medium", "cv-medium_more-s2", "cv-medium_more-s3")  # results/paper: cubes, 10 1/s
TO_FULL_STRAIN = {  # results/critical_state: tall cells, I = 2.5e-4; run -> number of grains
    **{f"cv-medium-s{seed}": 4000 for seed in range(1, 6)},
    "cv_full-full_medium": 14331,
}
LIMITS = {"Lambda": 1e-4, "e": 1e-3}  # smallest slopes that matter, per 0.1 of strain


class SizeScatter(Study):
    """Scatter and bias of the critical state against the number of grains."""

    data, title = CURVES, "Scatter and bias against the number of grains"

    def stored(self) -> tuple[Mapping[str, xr.Dataset], Sequence[Path]]:
        """Tests of the same density: 4,000 and 14,000 grains, sheared more slowly.

        The names are `stored-SIZE-ORIGIN`, so that no two specimens of a size have the same name.
        """
        results = Path(results_folder())
        curves: dict[str, xr.Dataset] = {}
        files = []
        for name in OF_THE_PAPER:
            file = results / "paper/runs" / f"{name}.run.nc"
            if file.exists():
                with lk.open_run(file) as run:
                    curves[f"{PREFIX}-n14000-paper_{name}"] = curves_of(run)
                files.append(file)
        at_full_strain = curves_at_full_strain(results, TO_FULL_STRAIN, STRAIN)
        for name, known in at_full_strain.items():
            curves[f"{PREFIX}-n{1000 * (TO_FULL_STRAIN[name] // 1000)}-{name}"] = known
        return curves, files + [results / AT_FULL_STRAIN] * bool(at_full_strain)

    def read(self, file: Path) -> pandas.DataFrame:
        curves = read_curves(file)
        curves["size"] = curves["specimen"].str.partition("-")[0]
        return curves.sort_values("grains", kind="stable", ignore_index=True)

    def tables(self, data: pandas.DataFrame) -> Tables:
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

    def figures(self, data: pandas.DataFrame, tables: StoredTables) -> Figures:
        sizes = sizes_figure(tables["ends"], tables["sizes"], tables["scatter"])
        return {"drift": drift_figure(data, WINDOW), "sizes": sizes}

    def numbers(self, tables: StoredTables) -> Values:
        sizes = tables["sizes"]
        largest = sizes.groupby("quantity", sort=False)["mean"].last()
        scatters = []
        for quantity, group in sizes.groupby("quantity", sort=False):
            cells = {f"scatter, {row['size'][1:]}": text(row["scatter"], digits=2) for _, row in group.iterrows()}
            scatters.append({"quantity": quantity, "mean": text(largest[quantity]), **cells})
        relative = tables["scatter"].set_index("quantity").loc["Lambda", "relative"]
        return {
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
        found = difference_of_means(both.loc[slow, quantity], both.loc[~slow, quantity])
        rows.append({"quantity": quantity, "mean": both.loc[slow, quantity].mean(), **found.columns("difference")})
    return corrected(rows, ["quantity", "mean", "difference", "within", "specimens", "p_value"])
