"""Do twins by state have equal rates, and which candidate explains the difference of their dilatancy?"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas

from analysis.hidden_state.driving import ENOUGH, directions
from analysis.hidden_state.nearest import OTHER, SAME, explained, packings_of, pair_counts, ratio_of
from analysis.hidden_state.table import CANDIDATES, RATES, STATE

ENOUGH_PAIRS = 5  # twins of a sort and density, below which near pairs are compared; without as many pairs, no verdict
TOO_FEW = "too few pairs"
NEAR = 2.0 * ENOUGH
ALL, EQUAL_SHARES = "all", "equal shares"
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


def frame_of(pairs: Sequence[Pair]) -> pandas.DataFrame:
    """The sorts, densities and packings (first, second) of pairs."""
    rows = [
        (pair["sort"], pair["density"], *(f"{pair['density']}-s{seed}" for seed in pair["seeds"])) for pair in pairs
    ]
    return pandas.DataFrame(rows, columns="sort density first second".split())


def compared_rates(pairs: Sequence[Pair]) -> pandas.DataFrame:
    """Differences of the rates between members, a row per rate and density, and D while shearing on (`window`).

    With EQUAL_SHARES, each density has the same share in SAME as in OTHER; densities with too few pairs are left out.
    Intervals are by bootstrap over packings.
    """
    used = compared_pairs(pairs)
    frame = frame_of(used)
    densities = frame["density"].unique()
    counts = pair_counts(frame)
    looks = [(name, ALL, 1 if name == "D" else len(RATES) - 1) for name in RATES]
    looks += [("D", EQUAL_SHARES, 1)] + [("D", density, len(densities)) for density in densities]
    looks += [(window, ALL, len(WINDOWS)) for window in WINDOWS]
    other, rows = (frame["sort"] == OTHER).to_numpy(), []
    number = frame.groupby(["density", "sort"]).size().unstack(fill_value=0).reindex(columns=[OTHER, SAME])
    for name, density, count in looks:
        weights = counts * ((frame["density"] == density) | (density in (ALL, EQUAL_SHARES))).to_numpy()
        if density == EQUAL_SHARES:
            for one, pairs_of in number.iterrows():
                for of in ((frame["density"] == one).to_numpy() & sort for sort in (other, ~other)):
                    share = pairs_of[OTHER] if pairs_of.min() >= ENOUGH_PAIRS else 0.0
                    weights[:, of] *= share / np.maximum(weights[:, of].sum(axis=1, keepdims=True), 1e-9)
        own = [frame[(weights[0] > 0.0) & of] for of in (other, ~other)]
        if min(map(len, own)) >= 2:
            found = ratio_of(weights, np.array([square_of(pair, name) for pair in used]), other, count)
            verdict = TOO_FEW if min(map(len, own)) < ENOUGH_PAIRS else found[-1]
            numbers = [number for of in own for number in (len(of), len(packings_of(of)))]
            rows.append((name, density, *numbers, *found[:-1], verdict, count))
    columns = "rate density other_pairs other_packings same_pairs same_packings other same ratio low high verdict looks"
    return pandas.DataFrame(rows, columns=columns.split())


def square_of(pair: Pair, name: str) -> float:
    """Mean square difference of a rate over the directions, or of D in a window of shearing on."""
    if name in RATES:
        return float(np.mean(np.square(pair["off"][name])))
    place = WINDOWS.index(name)
    volume = np.diff(np.array(pair["on"]), axis=2)[:, :, place] / WIDTHS[place]
    return float(np.mean((volume[0] - volume[1]) ** 2))


def ranked(pairs: Sequence[Pair]) -> pandas.DataFrame:
    """Share of the variance of the difference of D that each candidate explains in `other` pairs of packings left out.

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

    packings = frame_of(used).loc[group].reset_index(drop=True)
    table = explained({name: scalar(name) for name in (*STATE, *CANDIDATES)}, y, packings)
    return table if len(used) >= ENOUGH_PAIRS else table.assign(memory=TOO_FEW)
