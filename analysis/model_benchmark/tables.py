"""Tables of the benchmark: errors by group and part, ratios to one of the models, and first failures."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas

from analysis.statistics import SIGNIFICANT, adjusted, cluster_mean

MEASURES = ("stress", "p", "e", "strain", "lode", "direction", "A", "F", "Ft", "Z", "Lambda")
AGAINST = "calibrated"
COMPLETE = 0.985  # the strain recorded in cycles ends just beyond that of the path, one point later


def summary(scores: pandas.DataFrame) -> pandas.DataFrame:
    """Mean errors over packings, a row per part, group, drive and model: each of MEASURES with NAME_within.

    Also tests, packings, and `failed`, the number of tests that the model does not complete.
    """
    rows = []
    for labels, own in scores.groupby(["part", "group", "drive", "model"], sort=False):
        failed = int((own["reached"] < COMPLETE).sum())
        row = dict(zip(("part", "group", "drive", "model"), labels, strict=True))
        row |= {"tests": len(own), "packings": own["packing"].nunique(), "failed": failed}
        for measure in MEASURES:
            found = cluster_mean(own[measure].abs() if measure != "lode" else own[measure], own["packing"])
            row |= {measure: found.value, f"{measure}_within": found.within}
        rows.append(row)
    return pandas.DataFrame(rows)


def ratios(scores: pandas.DataFrame, against: str = AGAINST) -> pandas.DataFrame:
    """Error of s/p (rotation by stress: of the strain) over that of `against`, a row per part, group, drive and model.

    Geometric mean over the packings, with its 95 % interval `low` to `high`; `corrected` for the number of rows (Holm).
    """
    rows = []
    for labels, pair in _pairs(scores, against):
        found = cluster_mean(pair["ratio"], pair["packing"])
        interval = (float(np.exp(found.value + by)) for by in (0.0, -found.within, found.within))
        rows.append((*labels, found.n, *interval, found.p_value))
    table = pandas.DataFrame(rows, columns="part group drive model packings ratio low high p_value".split())
    return judged(table, table["ratio"] < 1.0)


def judged(table: pandas.DataFrame, better: pandas.Series) -> pandas.DataFrame:
    """The table with `corrected`, p_value for the number of rows (Holm), and `verdict`: better, worse, not resolved."""
    corrected = adjusted(table["p_value"].to_numpy(dtype=float))
    verdict = np.where(corrected <= SIGNIFICANT, np.where(better, "better", "worse"), "not resolved")
    return table.assign(corrected=corrected, verdict=verdict)


def judged_part(scores: pandas.DataFrame) -> pandas.DataFrame:
    """The scores by which models are compared: held out, and rotation, all of whose packings are known."""
    return scores[(scores["part"] == "held out") | (scores["group"] == "rotation")]


def _pairs(scores: pandas.DataFrame, against: str) -> Iterator[tuple[tuple[str, ...], pandas.DataFrame]]:
    for (part, group, drive), own in scores.groupby(["part", "group", "drive"], sort=False):
        measure = "strain" if (group, drive) == ("rotation", "stress") else "stress"
        wide = own.pivot(index=["run", "packing"], columns="model", values=measure)
        for model in wide.columns.drop(against):
            ratio = np.log(wide[model] / wide[against]).rename("ratio").reset_index()
            yield (str(part), str(group), str(drive), str(model)), ratio


def first_wrong(scores: pandas.DataFrame) -> pandas.DataFrame:
    """Which statistic of a model is wrong first (errors_of), driven by strain, a row per group and model.

    Columns: group, model, tests, A, F, Ft, Z, Lambda (number of tests in which that statistic is first), never, at
        (median strain).
    """
    own = scores[(scores["drive"] == "strain") & scores["A"].notna()]
    rows = []
    for (group, model), tests in own.groupby(["group", "model"], sort=False):
        counts = tests["first"].value_counts()
        numbers = {key: int(counts.get(key, 0)) for key in ("A", "F", "Ft", "Z", "Lambda")}
        row = {"group": group, "model": model, "tests": len(tests), **numbers}
        rows.append(row | {"never": int(tests["first"].isna().sum()), "at": tests["first_at"].median()})
    return pandas.DataFrame(rows)
