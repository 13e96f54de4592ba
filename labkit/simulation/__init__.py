"""Simulations: the Python interface, tasks, the run as a generator, many tests at once, grains in a finite element."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.simulation.api import consolidate as consolidate
    from labkit.simulation.api import make_specimen as make_specimen
else:
    __getattr__, __dir__, __all__ = attach(__name__)
