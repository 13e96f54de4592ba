"""`./lab constants`: runs the campaign, or uses the stored curves, and writes results/constants."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas
import xarray as xr

from analysis.constants import materials
from analysis.constants.figures import changes_figure, lines_figure
from analysis.curves import AT_FULL_STRAIN, CURVES, curves_at_full_strain, read_curves, window_means
from analysis.markdown import text
from analysis.places import results_folder
from analysis.statistics import SIGNIFICANT, Tested, corrected
from analysis.statistics.stationarity import slope_table, stationarity_table
from analysis.study import Figures, StoredTables, Study, Tables, Values
from labkit.model import Parameters

WINDOW = (0.35, 0.5)  # window of strain; the state of a test is its mean over it
LIMITS = {"Lambda": 1e-4, "e": 1e-3}  # smallest slopes that matter, per 0.1 of strain
SLOW = "slow"  # tests of Table 1's grains that results/critical_state has stored: material, and beginning of the names
SLOW_TESTS = {f"cv-{density}-s{seed}": 4000 for density in materials.DENSITIES for seed in range(1, 6)}


class Constants(Study):
    """The constants of Table 2 for other grains."""

    data, title = CURVES, "The constants of Table 2 for other grains"

    def stored(self) -> tuple[Mapping[str, xr.Dataset], Sequence[Path]]:
        results = Path(results_folder())
        known = curves_at_full_strain(results, SLOW_TESTS, WINDOW[1])
        slow = {name.replace("cv-", f"{SLOW}-{SLOW}_"): data for name, data in known.items()}
        return slow, [results / AT_FULL_STRAIN] * bool(slow)

    def read(self, file: Path) -> pandas.DataFrame:
        return read_curves(file)

    def tables(self, data: pandas.DataFrame) -> Tables:
        ends = window_means(data, *WINDOW)
        ends[["material", "density"]] = [materials.material_of(specimen) for specimen in ends["specimen"]]
        slow = ends["material"] == SLOW
        cells = materials.cells_of(ends[~slow])
        slopes = slope_table(data[data["test"] != SLOW], materials.MEASURED, *WINDOW)
        return {
            "ends": ends,
            "constants": materials.constant_table(cells),
            "slopes": materials.slope_table(cells),
            "rate": rate_table(cells, materials.cells_of(ends[slow])),
            "stationarity": stationarity_table(slopes, judged=LIMITS),
        }

    def figures(self, data: pandas.DataFrame, tables: StoredTables) -> Figures:
        ends = tables["ends"]
        lines = lines_figure(ends, materials.cells_of(ends[ends["material"] != SLOW]))
        return {"lines": lines, "changes": changes_figure(tables["constants"])}

    def numbers(self, tables: StoredTables) -> Values:
        found = tables["constants"]
        others = found[found["parameter"] != materials.PAPER]
        base = found[found["parameter"] == materials.PAPER].set_index("constant")
        above = base.loc["Lambda_067", "estimate"] - Parameters().c_cLam * (Parameters().e_cmax - materials.AT)
        slopes = tables["slopes"]
        bold = ["**" * (p_value <= SIGNIFICANT) for p_value in slopes["corrected"]]
        cells = [f"{b}{text(*pair)}{b}" for b, *pair in zip(bold, slopes["slope"], slopes["within"], strict=True)]
        return {
            "differences": differences(found),
            "changes": changes(others),
            "comparisons": int(others["p_value"].notna().sum()),
            "slopes": wide(slopes["parameter"], slopes, cells),
            "above": text(above, base.loc["Lambda_067", "within"]),
            "needed": needed(slopes, base, above),
            "paper_Ft": Parameters().Ft_c / math.sqrt(1.5),
        }


STUDY = Constants()


def rate_table(cells: materials.Cells, slow: materials.Cells) -> pandas.DataFrame:
    """Constants of Table 1's grains here minus those of the stored slow tests, a row per constant.

    Columns: constant, slow, difference, within, specimens (of both), p_value, corrected (Holm).
    """
    rows = []
    for pair in slow.values():
        here, there = map(materials.with_variance, (cells[materials.PAPER], pair))
        n = sum(cell.specimens for cell in (*cells[materials.PAPER], *pair))
        for k, constant in enumerate(materials.CONSTANTS):
            error = math.sqrt(here[1][k] + there[1][k])
            found = Tested.of(here[0][k] - there[0][k], error, materials.freedom_of(slow), n)
            rows.append({"constant": constant, "slow": there[0][k], **found.columns("difference")})
    return corrected(rows, ["constant", "slow", "difference", "within", "specimens", "p_value"])


def wide(labels: pandas.Series, rows: pandas.DataFrame, cells: Sequence[str]) -> pandas.DataFrame:
    """Cells of text, a row per label in the first column and a column per constant. rows: Constant of every cell."""
    name = str(labels.name)
    table = rows.assign(**{name: labels, "cell": cells}).pivot(index=name, columns="constant", values="cell")
    return table.loc[labels.unique(), list(materials.CONSTANTS)].reset_index()


def differences(rows: pandas.DataFrame) -> pandas.DataFrame:
    """The constants of Table 1's grains and, below, the differences of the others; bold if they differ, `=` if not."""
    marks = {"differs": ("**", "**"), "agrees": ("", " =")}
    labels, cells = [], []
    for row in rows.itertuples():
        own = row.parameter == materials.PAPER
        number = text(row.estimate, row.within) if own else text(row.difference, row.difference_within)
        before, after = marks.get(row.verdict, ("", ""))
        labels.append("Table 1" if own else f"{row.parameter} = {row.value:g}")
        cells.append(f"{before}{number}{after}")
    return wide(pandas.Series(labels, name="grains"), rows, cells)


def changes(rows: pandas.DataFrame) -> dict[str, dict[str, str]]:
    """Parameter -> names of the constants that it changes (`differs`), that agree, and of the rest."""
    found = {}
    for parameter, group in rows.groupby("parameter", sort=False):
        verdicts = {c: group[group["constant"] == c]["verdict"] for c in materials.CONSTANTS}
        differ = [c for c in materials.CONSTANTS if (verdicts[c] == "differs").any()]
        agree = [c for c in materials.CONSTANTS if (verdicts[c] == "agrees").all()]
        rest = [c for c in materials.CONSTANTS if c not in differ + agree]
        found[str(parameter)] = {"differ": ", ".join(differ), "agree": ", ".join(agree), "rest": ", ".join(rest)}
    return found


def needed(slopes: pandas.DataFrame, base: pandas.DataFrame, above: float) -> pandas.DataFrame:
    """The change of each parameter that lowers Lambda^c(0.67) by `above`, to first order, and M and F^t then, as text.

    Columns: parameter, change, M, Ft. base: constants of Table 1's grains, by their names.
    """
    rows = []
    for parameter, group in slopes.groupby("parameter", sort=False):
        known = group.set_index("constant")
        if known.loc["Lambda_067", "corrected"] > SIGNIFICANT:
            rows.append({"parameter": parameter, "change": "slope not resolved", "M": "", "Ft": ""})
            continue
        change = -above / known.loc["Lambda_067", "slope"]
        row = {"parameter": parameter, "change": f"{change:+.2g}{' doublings' if parameter == 'kappa' else ''}"}
        for name in ("M", "Ft"):
            value = base.loc[name, "estimate"] + change * known.loc[name, "slope"]
            row[name] = text(value, abs(change) * known.loc[name, "within"])
        rows.append(row)
    return pandas.DataFrame(rows)
