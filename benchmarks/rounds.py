"""Measurements in alternating rounds, and their ratios, because speeds vary with a computer's other work."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from labkit.engines.base import Progress

T = TypeVar("T")


def alternate(measures: Mapping[str, Callable[[], T]], rounds: int, progress: Progress) -> dict[str, list[T]]:
    """Measure everything once in every round; name -> one result for each round."""
    results: dict[str, list[T]] = {name: [] for name in measures}
    for turn in range(rounds):
        for number, (name, measure) in enumerate(measures.items()):
            progress((turn * len(measures) + number) / (rounds * len(measures)), name)
            results[name].append(measure())
    progress(1.0, "done")
    return results


def ratio(values: Sequence[float], base: Sequence[float]) -> str:
    """Format the median and range of the ratios within each round as three columns."""
    ratios = [a / b for a, b in zip(values, base, strict=True)]
    return f"{statistics.median(ratios):7.2f} {min(ratios):6.2f}-{max(ratios):<6.2f}"
