"""Corrections for the number of comparisons, and verdicts that distinguish agreement from a lack of resolution."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import pandas
from numpy.typing import ArrayLike
from statsmodels.stats.multitest import multipletests

SIGNIFICANT = 0.05  # error rate of a family of comparisons

Method = Literal["holm", "fdr_bh"]


def adjusted(p_values: ArrayLike, method: Method = "holm") -> np.ndarray:
    """p-values (n,) corrected for their number; NaN stays NaN and is not counted.

    `holm` (Holm 1979) controls the probability of a single false finding, `fdr_bh` (Benjamini & Hochberg 1995) the
    share of false ones among all findings.
    """
    p = np.asarray(p_values, dtype=float)
    tested = np.isfinite(p)
    corrected = np.full(p.shape, np.nan)
    if tested.any():
        corrected[tested] = multipletests(p[tested], alpha=SIGNIFICANT, method=method)[1]
    return corrected


def adjusted_once(table: pandas.DataFrame, by: Sequence[str]) -> np.ndarray:
    """`p_value` of each row, corrected (Holm) for the number of tests; rows with the same `by` belong to one test."""
    asked = table.drop_duplicates(list(by)).set_index(list(by))["p_value"]
    corrected = pandas.Series(adjusted(asked), asked.index)
    return corrected.loc[pandas.MultiIndex.from_frame(table[list(by)])].to_numpy()


def corrected(rows: Sequence[Any], columns: Sequence[str] | None = None, method: Method = "holm") -> pandas.DataFrame:
    """A pandas.DataFrame of rows with a `p_value`, and the column `corrected`: for the number of rows."""
    table = pandas.DataFrame(rows, columns=columns)
    return table.assign(corrected=adjusted(table["p_value"].to_numpy(dtype=float), method))


def judge_plan(rows: Sequence[Any]) -> pandas.DataFrame:
    """A pandas.DataFrame of the `difference`s of a plan, with the columns corrected, resolved and equivalent.

    Comparison 2 is corrected for the number of its rows (Holm); in the others `corrected` is the p-value. `equivalent`:
    the whole interval is within `judged`.
    """
    table = pandas.DataFrame(rows)
    second = table["comparison"] == 2
    table["corrected"] = table["p_value"].mask(second, pandas.Series(adjusted(table["p_value"].where(second))))
    table["resolved"] = table["corrected"] <= SIGNIFICANT
    table["equivalent"] = table["difference"].abs() + table["within"] <= table["judged"]
    return table


def with_verdict(table: pandas.DataFrame, name: str, within: str = "within") -> pandas.DataFrame:
    """The table with the column `verdict` of the number `name`, from its columns `within`, judged and corrected."""
    verdicts = [verdict(*row) for row in table[[name, within, "judged", "corrected"]].to_numpy(dtype=float)]
    return table.assign(verdict=verdicts)


def in_bold(rows: pandas.DataFrame) -> pandas.DataFrame:
    """The rows of a table with the column `bold`: `**` if the difference from zero is resolved."""
    return rows.assign(bold=["**" * (p_value <= SIGNIFICANT) for p_value in rows["corrected"]])


def resolved(p_values: ArrayLike, method: Method = "holm") -> np.ndarray:
    """True where the corrected p-value is at most SIGNIFICANT (n,); False for NaN."""
    return np.nan_to_num(adjusted(p_values, method), nan=1.0) <= SIGNIFICANT


def verdict(difference: float, within: float, judged: float, p_value: float = math.nan, rounding: float = 0.0) -> str:
    """`differs`, `agrees` or `not resolved`.

    A number `agrees` if the whole interval is within `judged` of zero (an equivalence test). It `differs` if it does
    not agree, the interval, widened by the rounding, excludes zero, and the corrected p-value (if given) is at most
    SIGNIFICANT. Everything else, including an unknown interval, is `not resolved`.

    Args:
        difference: Our value minus the reference.
        within: Half-width of its 95 % interval.
        judged: Smallest difference that would matter.
        p_value: p-value corrected for the number of comparisons, or NaN if there is only one.
        rounding: Half a unit of the last printed digit of the reference.
    """
    if not (math.isfinite(difference) and math.isfinite(within)):
        return "not resolved"
    if abs(difference) + within <= judged:
        return "agrees"
    return "differs" if abs(difference) > within + rounding and not p_value > SIGNIFICANT else "not resolved"
