"""What a case asks for, and the means that are compared."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import xarray as xr


@dataclasses.dataclass(frozen=True)
class Check:
    """Something that physics or an identity asks for, and whether it holds."""

    name: str
    value: float
    limit: str
    holds: bool

    def __str__(self) -> str:
        return f"{self.name}: {self.value:.4g}, asked for {self.limit}"


def below(name: str, value: float, limit: float) -> Check:
    """That a value is below a limit."""
    return Check(name, float(value), f"< {limit:.3g}", bool(value < limit))


def between(name: str, value: float, low: float, high: float) -> Check:
    """That a value lies in a range."""
    return Check(name, float(value), f"{low:.4g} to {high:.4g}", bool(low <= value <= high))


def true(name: str, holds: bool) -> Check:
    """That something is so."""
    return Check(name, float(holds), "1", bool(holds))


def later_half(run: xr.Dataset) -> dict[str, float]:
    """Means over the records of the second half: p, Pa; q/p; Z; and the last void ratio."""
    half = slice(run.sizes["time"] // 2, None)
    p, q = run.lab.mean_stress().values[half].mean(), run.lab.deviatoric_stress().values[half].mean()
    coordination = float(run["coordination_number"].values[half].mean())
    return {"p": p, "q/p": q / p, "Z": coordination, "e": float(run["void_ratio"][-1])}


def agree(run: xr.Dataset, reference: xr.Dataset, **tolerances: float) -> Iterator[Check]:
    """Checks that means of a run differ from those of `reference` by less than tolerances, p relatively.

    A test is chaotic: two converged runs of one specimen differ by its scatter, which the tolerances are made of.
    """
    found, expected = later_half(run), later_half(reference)
    found["p"], expected["p"] = found["p"] / expected["p"], 1.0
    names = {"p": "p", "ratio": "q/p", "Z": "Z", "e": "e"}
    for key, tolerance in tolerances.items():
        name = names[key]
        yield below(f"{name} against half the step", abs(found[name] - expected[name]), tolerance)


def pressure_words(run: xr.Dataset) -> str:
    """p at the start and at the end."""
    p = run.lab.mean_stress().values
    return f"p {p[0] / 1e3:.4g} -> {p[-1] / 1e3:.4g} kPa"


def ratio_words(run: xr.Dataset) -> str:
    """q/p."""
    return f"q/p {later_half(run)['q/p']:.3f} (mean of the later half)"
