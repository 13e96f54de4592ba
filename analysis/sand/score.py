"""Coverage and interval score of the predicted features, beside a constant prediction: `python -m analysis.sand.score`.

The score of a 90 % interval [l, u] for the measured x is u - l + 20 max(l - x, x - u, 0) (Gneiting and Raftery 2007):
the smaller, the better; neither a wide interval nor one that misses wins. It is divided by the standard deviation of
the measured values of a feature, so that features can be averaged. The constant prediction of a test is the mean of
the other measured values, in undrained tests of the same direction, with the 90 % interval of a further value.
"""

from __future__ import annotations

import numpy as np
import pandas
from scipy.stats import t as student

from analysis.sand.karlsruhe import RESULTS

LEVEL = 0.9


def interval_score(measured: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the score of intervals, (n,), in the unit of the values."""
    beyond = np.maximum(np.maximum(low - measured, measured - high), 0.0)
    return high - low + 2.0 / (1.0 - LEVEL) * beyond


def constant_intervals(measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return low and high, (n,), of the interval of each value from the n - 1 others."""
    others = np.array([np.delete(measured, k) for k in range(len(measured))])
    count = others.shape[1]
    half = student.ppf(0.5 + 0.5 * LEVEL, count - 1) * others.std(axis=1, ddof=1) * np.sqrt(1.0 + 1.0 / count)
    return others.mean(axis=1) - half, others.mean(axis=1) + half


def scored(table: pandas.DataFrame, of: str) -> list[dict[str, object]]:
    """Rows of the score: one per feature, of tests in compression and extension apart; at least three tests each."""
    direction = np.where(table["test"].str.contains("extension"), "extension", "compression")
    rows: list[dict[str, object]] = []
    for (feature, which), own in table.groupby(["feature", direction], sort=False):
        x, low, high = (own[name].to_numpy(float) for name in ("measured", "low", "high"))
        row = {"tests": of, "direction": which, "feature": feature, "n": len(own), "inside": int(own["inside"].sum())}
        if len(own) < 3:
            rows.append(row)
            continue
        lower, upper = constant_intervals(x)
        row |= {"score": float(interval_score(x, low, high).mean() / x.std(ddof=1))}
        row |= {"inside of constant": int(((lower <= x) & (x <= upper)).sum())}
        rows.append(row | {"score of constant": float(interval_score(x, lower, upper).mean() / x.std(ddof=1))})
    return rows


def means(rows: list[dict[str, object]]) -> pandas.DataFrame:
    """Number of features, those inside, and mean score of those that have one; a row per kind of tests."""
    table = pandas.DataFrame(rows)
    scores = ["score", "score of constant"]
    table[scores] = table[scores].mul(table["n"], axis=0)
    sums = table.groupby("tests")[["n", "inside"]].sum()
    judged = table.dropna().groupby("tests")
    sums = sums.join(judged[["inside of constant"]].sum()).join(judged[scores].sum().div(judged["n"].sum(), axis=0))
    return sums.join(judged["n"].sum().rename("with a score")).reset_index()


def main() -> None:
    """Score the stored predictions, and write results/sand/score.csv."""
    files = {"drained": "predictions.csv", "undrained": "undrained.csv"}
    rows = [row for of, file in files.items() for row in scored(pandas.read_csv(RESULTS / file), of)]
    table = pandas.DataFrame(rows)
    table.to_csv(RESULTS / "score.csv", index=False, float_format="%.3g")
    print(table.to_string(index=False, float_format="%.3g"), means(rows).to_string(index=False), sep="\n")


if __name__ == "__main__":
    main()
