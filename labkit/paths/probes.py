"""Paths that apply one small increment of strain or stress smoothly and then let the grains rest."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from labkit.errors import InputError
from labkit.micro.tensors import to_tensor
from labkit.parameters import Number, Numbers, parameter, parameters_of
from labkit.paths.control import Control
from labkit.paths.path import Path, StressPath, rate_parameter

SIX = "xx,yy,zz,sqrt2 yz,sqrt2 xz,sqrt2 xy"
LOADING = 2.0 / 3.0  # fraction of a probe in which the increment is applied; the grains rest in the remainder


def increment_parameter(what: str) -> Numbers:
    """Return the field of an increment with six numbers; its help text starts with `what`."""
    return parameter((0.0,) * 6, help=f"{what}: {SIX}")


@dataclasses.dataclass(frozen=True)
class _Probe(Path):
    """A path that applies a small increment and lets the grains rest."""

    rate: Number[float | None] = rate_parameter("`strain` divided by the duration of the probe", 0.05)
    strain: float = parameter(
        1.5e-4, above=0.0, high=1.0, help="`rate` times the duration of the probe, two thirds of which is loading"
    )
    increment: Numbers = increment_parameter("increment")

    standard_rate = 0.05

    def __post_init__(self) -> None:
        """Check every parameter. Raises InputError."""
        super().__post_init__()
        for name, definition in parameters_of(type(self)).items():
            values = getattr(self, name)
            if definition.kind is tuple and (len(values) != 6 or not np.isfinite(values).all()):
                raise InputError(field=name, value=values, allowed=f"6 numbers: {SIX}")

    def applied_share(self, accumulated: float) -> float:
        """Return the applied fraction of the increment at an accumulated strain: s - sin(2 pi s)/(2 pi)."""
        s = min(accumulated / (LOADING * self.strain), 1.0)
        return s - math.sin(2.0 * math.pi * s) / (2.0 * math.pi)


@dataclasses.dataclass(frozen=True)
class StrainProbe(_Probe):
    """A small increment of strain, applied smoothly; the grains then rest."""

    increment: Numbers = increment_parameter("increment of strain")

    name = "strain_probe"

    def flow(self, accumulated: float) -> np.ndarray:
        s = accumulated / (LOADING * self.strain)
        speed = (1.0 - math.cos(2.0 * math.pi * s)) / (LOADING * self.strain) if s < 1.0 else 0.0
        return speed * to_tensor(np.array(self.increment))


@dataclasses.dataclass(frozen=True)
class StressProbe(_Probe, StressPath):
    """A small increment of stress, applied smoothly by all six strain rates; the grains then rest.

    `pressure` is the mean stress before the probe; all other stresses are given as multiples of it.
    """

    increment: Numbers = increment_parameter("increment of stress, divided by `pressure`")
    start_stress: Numbers = parameter(
        (1.0, 1.0, 1.0, 0.0, 0.0, 0.0), help=f"stress before the probe, divided by `pressure`: {SIX}"
    )

    name = "stress_probe"
    holds = "stress"
    rate_limit = 100.0  # a sheared specimen is many times softer than in its elastic response

    def start_pressure(self) -> float | None:
        return None  # the specimen is not consolidated, so its stress stays unchanged

    def flow(self, accumulated: float) -> np.ndarray:
        return np.zeros((3, 3))

    def control(self) -> Control:
        basis = to_tensor(np.eye(6))
        start, increment = np.array(self.start_stress), np.array(self.increment)
        return Control(
            basis, basis, lambda accumulated: self.held_pressure * (start + self.applied_share(accumulated) * increment)
        )
