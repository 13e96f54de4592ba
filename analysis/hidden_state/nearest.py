"""Nearest states with other histories: do they have equal rates, and which candidate explains the difference?"""

from __future__ import annotations

import numpy as np
import pandas

from analysis.hidden_state.table import CANDIDATES, RATES, STATE, along_direction, stacked

FAR = 0.5  # largest distance of a pair, in standard deviations
ANGLE = 25.0  # largest angle between the directions of strain, degrees
BINS = np.arange(0.0, FAR + 0.05, 0.05)  # of distance, for equal histograms
DRAWS, SEED = 2000, 1
OTHER, SAME = "other", "same"


def scaled(rows: pandas.DataFrame, names: tuple[str, ...]) -> list[np.ndarray]:
    """Columns divided by their standard deviations, that of a tensor being the norm of its deviation from the mean."""
    columns = [stacked(rows, name) for name in names]
    return [values / np.sqrt(((values - values.mean(axis=0)) ** 2).sum(axis=1).mean()) for values in columns]


def distances(rows: pandas.DataFrame) -> np.ndarray:
    """Distances (n, n) of states: root of the mean of the squares of the six scaled differences."""
    x = np.concatenate(scaled(rows, STATE), axis=1) / np.sqrt(len(STATE))
    square = (x**2).sum(axis=1)
    return np.sqrt(np.maximum(square[:, None] + square - 2.0 * x @ x.T, 0.0))


def pairs_of(rows: pandas.DataFrame) -> pandas.DataFrame:
    """Pairs of nearest records of two packings of one density, columns i, j (positions), distance, sort and density."""
    found = []
    rows = rows.reset_index(drop=True)
    for density, own in rows.groupby("density", sort=False):
        far, n = distances(own), stacked(own, "n")
        packing, kind = own["packing"].to_numpy(), own["kind"].to_numpy()
        far[(n @ n.T < np.cos(np.radians(ANGLE))) | (packing[:, None] == packing)] = np.inf
        for sort in (OTHER, SAME):
            of_sort = np.where((kind[:, None] == kind) == (sort == SAME), far, np.inf)
            chosen = []
            for other in sorted(set(packing)):
                within = np.where(packing == other, of_sort, np.inf)
                j = within.argmin(axis=1)
                chosen += [(within[i, j[i]], i, j[i]) for i in range(len(own)) if within[i, j[i]] < FAR]
            used: set[int] = set()
            for distance, i, j in sorted(chosen):
                if i not in used and j not in used:
                    used |= {i, j}
                    found.append((own.index[i], own.index[j], distance, sort, density))
    return pandas.DataFrame(found, columns=["i", "j", "distance", "sort", "density"])


def differences(rows: pandas.DataFrame, pairs: pandas.DataFrame) -> pandas.DataFrame:
    """The pairs with the scaled size of the difference of each rate; scales are those of a density."""
    rows, made = rows.reset_index(drop=True), pairs.copy()
    for name in RATES:
        made[name] = 0.0
    for density, own in rows.groupby("density", sort=False):
        here = (pairs["density"] == density).to_numpy()
        place = pandas.Series(np.arange(len(own)), own.index)
        i, j = (place[pairs.loc[here, key]].to_numpy() for key in ("i", "j"))
        for name, values in zip(RATES, scaled(own, RATES), strict=True):
            made.loc[here, name] = np.linalg.norm(values[i] - values[j], axis=1)
    made["first"] = rows["packing"].to_numpy()[pairs["i"]]
    made["second"] = rows["packing"].to_numpy()[pairs["j"]]
    cell = made["density"] + np.digitize(made["distance"], BINS).astype(str)
    counts = pandas.crosstab(cell, made["sort"]).reindex(columns=[OTHER, SAME], fill_value=0)
    ratio = (counts[OTHER] / counts[SAME]).where(counts[SAME] > 0, 0.0)
    there = (counts[SAME] > 0).astype(float)
    made["weight"] = np.where(made["sort"] == SAME, cell.map(ratio), cell.map(there))
    return made


def draws_of(packings: list[str]) -> np.ndarray:
    """How often each packing is in a bootstrap sample, (DRAWS, packings), the first sample being that of all."""
    generator = np.random.default_rng(SEED)
    density = np.array([name.rpartition("-")[0] for name in packings])
    counts = np.ones((DRAWS + 1, len(packings)))
    for one in np.unique(density):
        own = np.flatnonzero(density == one)
        counts[1:, own] = generator.multinomial(own.size, np.full(own.size, 1.0 / own.size), DRAWS)
    return counts


def interval(values: np.ndarray, looks: int) -> tuple[float, float]:
    """The interval of a bootstrap at the level 1 - 0.05/looks."""
    values = values[np.isfinite(values)]
    low, high = np.quantile(values, [0.025 / looks, 1.0 - 0.025 / looks]) if values.size else (np.nan, np.nan)
    return float(low), float(high)


def pair_counts(pairs: pandas.DataFrame) -> np.ndarray:
    """Weights (DRAWS + 1, pairs) of the pairs in the bootstrap over packings."""
    packings = packings_of(pairs)
    counts, place = draws_of(packings), pandas.Series(np.arange(len(packings)), packings)
    return counts[:, place[pairs["first"]]] * counts[:, place[pairs["second"]]]


def ratio_of(
    counts: np.ndarray, square: np.ndarray, other: np.ndarray, looks: int
) -> tuple[float, float, float, float, float, str]:
    """(root mean square of the pairs `other`, that of the rest, their ratio, its interval, verdict).

    Args:
        counts: Weights of the pairs, (DRAWS + 1, pairs), the first row without bootstrap.
        square: Squared differences, (pairs,).
        other: Whether a pair is of OTHER, (pairs,).
        looks: Number of looks for which the interval is corrected.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        sizes = [np.sqrt(counts[:, of] @ square[of] / counts[:, of].sum(axis=1)) for of in (other, ~other)]
        ratio = sizes[0] / sizes[1]
    low, high = interval(ratio[1:], looks)
    verdict = "remembered" if low > 1.0 else "a state" if high < 1.25 else "not decided"
    return float(sizes[0][0]), float(sizes[1][0]), float(ratio[0]), low, high, verdict


def compared(made: pandas.DataFrame, densities: str = "all") -> pandas.DataFrame:
    """Root mean square difference of each rate, other and same history, and their ratio, a row per rate."""
    counts = pair_counts(made) * made["weight"].to_numpy()
    other = (made["sort"] == OTHER).to_numpy()
    rows = []
    for name in RATES:
        found = ratio_of(counts, made[name].to_numpy() ** 2, other, len(RATES))
        rows.append((densities, name, other.sum(), (~other).sum(), *found))
    columns = "density rate other_pairs same_pairs other same ratio low high verdict".split()
    return pandas.DataFrame(rows, columns=columns)


def ranking(rows: pandas.DataFrame, made: pandas.DataFrame) -> pandas.DataFrame:
    """Share of the variance of the difference of D that each candidate explains in packings left out.

    Differences of D between pairs with other history are regressed on those of the scalar forms of the state, and then
    of one candidate more. Columns: candidate, share, low, high, slope (of D on the candidate, both in their standard
    deviations), memory.
    """
    rows = rows.reset_index(drop=True)
    chosen = made[(made["sort"] == OTHER) & (made["weight"] > 0.0)]
    i, j = chosen["i"].to_numpy(), chosen["j"].to_numpy()
    y, x = np.zeros(len(chosen)), {name: np.zeros(len(chosen)) for name in (*STATE, *CANDIDATES)}
    for density, own in rows.groupby("density", sort=False):
        here = (chosen["density"] == density).to_numpy()
        D = stacked(own, "D")[:, 0]
        scale = D.std()
        place = pandas.Series(np.arange(len(own)), own.index)
        a, b = place[i[here]].to_numpy(), place[j[here]].to_numpy()
        y[here] = (D[a] - D[b]) / scale
        for name in x:
            values = along_direction(own, name)
            x[name][here] = (values[a] - values[b]) / values.std()
    return explained(x, y, chosen)


def explained(x: dict[str, np.ndarray], y: np.ndarray, pairs: pandas.DataFrame) -> pandas.DataFrame:
    """The shares of `ranking`, from differences y of D and x of STATE and CANDIDATES, and the packings of the pairs."""
    base = np.column_stack([x[name] for name in STATE])
    groups = [(pairs[["first", "second"]] == packing).any(axis=1).to_numpy() for packing in packings_of(pairs)]
    counts = pair_counts(pairs)
    before, _ = left_out(base, y, groups)
    total = counts @ y**2
    found = [("the state itself", np.nan, counts @ (y**2 - before))]
    for name in CANDIDATES:
        with_one = np.column_stack([base, x[name]])
        after, _ = left_out(with_one, y, groups)
        slope = np.linalg.lstsq(with_one, y, rcond=None)[0][-1]
        found.append((name, slope, counts @ (before - after)))
    result = []
    for name, slope, gain in found:
        with np.errstate(invalid="ignore", divide="ignore"):
            share = gain / total
        low, high = interval(share[1:], len(CANDIDATES))
        result.append((name, share[0], low, high, slope))
    table = pandas.DataFrame(result, columns=["candidate", "share", "low", "high", "slope"])
    table["memory"] = np.where(table["low"] > 0.0, "yes", "no")
    return pandas.concat([table[:1], table[1:].sort_values("share", ascending=False)], ignore_index=True)


def packings_of(pairs: pandas.DataFrame) -> list[str]:
    """The packings of pairs."""
    return sorted({*pairs["first"], *pairs["second"]})


def left_out(x: np.ndarray, y: np.ndarray, groups: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mean squared errors (n,) of linear regressions without intercept that leave out each group, and their number."""
    square, times = np.zeros(len(y)), np.zeros(len(y))
    for group in groups:
        slopes = np.linalg.lstsq(x[~group], y[~group], rcond=None)[0]
        square[group] += (y[group] - x[group] @ slopes) ** 2
        times[group] += 1
    return square / np.maximum(times, 1.0), times
