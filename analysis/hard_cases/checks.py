"""The conditions that a case requires, and the means that it compares."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import xarray as xr


@dataclasses.dataclass(frozen=True)
class Check:
    """A condition required by physics or by an identity, and whether it holds."""

    name: str
    value: float
    limit: str
    holds: bool

    def __str__(self) -> str:
        return f"{self.name}: {self.value:.4g}, required {self.limit}"


def below(name: str, value: float, limit: float) -> Check:
    """Checks that a value is below a limit."""
    return Check(name, float(value), f"< {limit:.3g}", bool(value < limit))


def between(name: str, value: float, low: float, high: float) -> Check:
    """Checks that a value lies in a range."""
    return Check(name, float(value), f"{low:.4g} to {high:.4g}", bool(low <= value <= high))


def true(name: str, holds: bool) -> Check:
    """Checks that a condition is true."""
    return Check(name, float(holds), "1", bool(holds))


def later_half(run: xr.Dataset) -> dict[str, float]:
    """Means of p (Pa), q/p and Z over the second half of the records, and the last void ratio e."""
    half = slice(run.sizes["time"] // 2, None)
    p, q = run.lab.mean_stress().values[half].mean(), run.lab.deviatoric_stress().values[half].mean()
    coordination = float(run["coordination_number"].values[half].mean())
    return {"p": p, "q/p": q / p, "Z": coordination, "e": float(run["void_ratio"][-1])}


def agree(run: xr.Dataset, reference: xr.Dataset, **tolerances: float) -> Iterator[Check]:
    """Checks that the means of a run differ from those of `reference` by less than the tolerances.

    For p, the difference is relative.

    A test is chaotic: two converged runs of one specimen differ by some scatter, from which the tolerances are derived.
    """
    means, expected = later_half(run), later_half(reference)
    means["p"], expected["p"] = means["p"] / expected["p"], 1.0
    names = {"p": "p", "ratio": "q/p", "Z": "Z", "e": "e"}
    for key, tolerance in tolerances.items():
        name = names[key]
        yield below(f"{name}, difference from half the time step", abs(means[name] - expected[name]), tolerance)


def pressure_text(run: xr.Dataset) -> str:
    """Text with p at the start and at the end."""
    p = run.lab.mean_stress().values
    return f"p {p[0] / 1e3:.4g} -> {p[-1] / 1e3:.4g} kPa"


def ratio_text(run: xr.Dataset) -> str:
    """The mean of q/p as text."""
    return f"q/p {later_half(run)['q/p']:.3f} (mean of the second half)"
