"""Do twins by state have equal rates, and which candidate explains the difference of their dilatancy?"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas

from analysis.hidden_state.driving import ENOUGH, directions
from analysis.hidden_state.nearest import DRAWS, OTHER, SAME, SEED, left_out
from analysis.hidden_state.table import CANDIDATES, RATES, STATE

ENOUGH_PAIRS = 5  # twins of a sort and density, below which near pairs are compared; without as many pairs, no verdict
TOO_FEW = "too few pairs"
NEAR = 2.0 * ENOUGH
ALL = "all"
WINDOWS = ("0 to 0.5 %", "0.5 to 1 %", "1 to 2 %")
WIDTHS = np.array([0.005, 0.005, 0.01])  # axial strain of each
Pair = dict[str, Any]


def read_pairs(file: Path) -> list[Pair]:
    """The lines of a file of pairs."""
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def compared_pairs(pairs: Sequence[Pair]) -> list[Pair]:
    """The twins of each sort and density, or those nearer than NEAR where there are too few twins of a sort."""
    chosen = []
    for density in dict.fromkeys(pair["density"] for pair in pairs):
        own = [pair for pair in pairs if pair["density"] == density and "off" in pair]
        twins = [pair for pair in own if pair["distance"] < ENOUGH]
        few = min(sum(pair["sort"] == sort for pair in twins) for sort in (OTHER, SAME)) < ENOUGH_PAIRS
        chosen += own if few else twins
    return chosen


def reached(pairs: Sequence[Pair]) -> pandas.DataFrame:
    """A row per density and sort: pairs tried, twins, near pairs, failed ones, distances before and after.

    The distances and the differences of e, Z, Lambda, |A|, |F|, |F^t| are means over the pairs that are compared.
    """
    rows, used = [], {pair["name"] for pair in compared_pairs(pairs)}
    frame = pandas.DataFrame([{"density": pair["density"], "sort": pair["sort"]} for pair in pairs])
    for (density, sort), index in frame.groupby(["density", "sort"], sort=False).groups.items():
        own = [pairs[k] for k in index]
        mine = [pair for pair in own if pair["name"] in used]
        row = {"density": density, "sort": sort, "tried": len(own), "compared": len(mine)}
        row["twins"] = sum(pair.get("distance", 1.0) < ENOUGH for pair in own)
        row["failed"] = sum("failed" in pair for pair in own)
        for name in ("before", "distance"):
            row[name] = float(np.mean([pair[name] for pair in mine])) if mine else np.nan
        for name in STATE:
            off = [np.linalg.norm(np.subtract(*pair["state"][name])) for pair in mine]
            row[name] = float(np.mean(off)) if mine else np.nan
        row["Lambda_scaled"] = 1e5 * row["Lambda"]
        rows.append(row)
    return pandas.DataFrame(rows)


def ratio_of(squares: dict[str, np.ndarray], looks: int) -> tuple[float, float, float, float, float, str]:
    """(root mean square of OTHER and of SAME, their ratio, its interval, verdict) by bootstrap over pairs."""
    generator = np.random.default_rng(SEED)
    sizes = [float(np.sqrt(squares[sort].mean())) for sort in (OTHER, SAME)]
    other, same = (generator.choice(squares[sort], (DRAWS, squares[sort].size)).mean(axis=1) for sort in (OTHER, SAME))
    low, high = np.quantile(np.sqrt(other / same), [0.025 / looks, 1.0 - 0.025 / looks])
    verdict = "remembered" if low > 1.0 else "a state" if high < 1.25 else "not decided"
    verdict = TOO_FEW if min(map(len, squares.values())) < ENOUGH_PAIRS else verdict
    return sizes[0], sizes[1], sizes[0] / sizes[1], float(low), float(high), verdict


def compared_rates(pairs: Sequence[Pair]) -> pandas.DataFrame:
    """Differences of the rates between members, a row per rate and density, and D while shearing on (`window`)."""
    used, rows = compared_pairs(pairs), []
    densities = list(dict.fromkeys(pair["density"] for pair in used))
    looks = [(name, ALL, 1 if name == "D" else len(RATES) - 1) for name in RATES]
    looks += [("D", density, len(densities)) for density in densities]
    looks += [(window, ALL, len(WINDOWS)) for window in WINDOWS]
    for name, density, count in looks:
        own = [pair for pair in used if density in (ALL, pair["density"])]
        squares = {
            sort: np.array([square_of(pair, name) for pair in own if pair["sort"] == sort]) for sort in (OTHER, SAME)
        }
        if min(map(len, squares.values())) >= 2:
            found = ratio_of(squares, count)
            rows.append((name, density, len(squares[OTHER]), len(squares[SAME]), *found, count))
    columns = "rate density other_pairs same_pairs other same ratio low high verdict looks".split()
    return pandas.DataFrame(rows, columns=columns)


def square_of(pair: Pair, name: str) -> float:
    """Mean square difference of a rate over the directions, or of D in a window of shearing on."""
    if name in RATES:
        return float(np.mean(np.square(pair["off"][name])))
    place = WINDOWS.index(name)
    volume = np.diff(np.array(pair["on"]), axis=2)[:, :, place] / WIDTHS[place]
    return float(np.mean((volume[0] - volume[1]) ** 2))


def ranked(pairs: Sequence[Pair]) -> pandas.DataFrame:
    """Share of the variance of the difference of D that each candidate explains in `other` pairs left out.

    Columns: candidate, share, low, high, slope, memory; the first row is the state itself.
    """
    used, n = [pair for pair in compared_pairs(pairs) if pair["sort"] == OTHER], directions()
    y = np.concatenate([np.subtract(*pair["D"]) for pair in used])
    group = np.repeat(np.arange(len(used)), len(n))
    density = np.repeat([pair["density"] for pair in used], len(n))

    def scalar(name: str) -> np.ndarray:
        members = [np.array([pair["state"][name][k] for pair in used]) for k in (0, 1)]
        off = [np.repeat(a, len(n), axis=1).ravel() if a.shape[1] == 1 else (a @ n.T).ravel() for a in members]
        size = pandas.Series(np.concatenate(off)).groupby(np.tile(density, 2)).std()
        return (off[0] - off[1]) / pandas.Series(density).map(size).to_numpy()

    groups = [group == k for k in range(len(used))]
    base = np.column_stack([scalar(name) for name in STATE])
    generator = np.random.default_rng(SEED)
    draws = generator.multinomial(len(used), np.full(len(used), 1.0 / len(used)), DRAWS)
    counts = np.concatenate([np.ones((1, len(used))), draws])[:, group]
    before, _ = left_out(base, y, groups)
    found = [("the state itself", np.nan, counts @ (y**2 - before))]
    for name in CANDIDATES:
        columns = np.column_stack([base, scalar(name)])
        after, _ = left_out(columns, y, groups)
        slope = np.linalg.lstsq(columns, y, rcond=None)[0][-1]
        found.append((name, slope, counts @ (before - after)))
    rows = []
    for name, slope, gain in found:
        share = gain / (counts @ y**2)
        low, high = np.quantile(share[1:], [0.025 / len(CANDIDATES), 1.0 - 0.025 / len(CANDIDATES)])
        memory = TOO_FEW if len(used) < ENOUGH_PAIRS else "yes" if low > 0.0 else "no"
        rows.append((name, share[0], low, high, slope, memory))
    table = pandas.DataFrame(rows, columns="candidate share low high slope memory".split())
    return pandas.concat([table[:1], table[1:].sort_values("share", ascending=False)], ignore_index=True)
