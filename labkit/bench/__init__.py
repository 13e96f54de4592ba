"""Benchmarks: engines and LAMMPS on one specimen, cost of the kernel, threads, statistics, the model's integrators."""

from labkit.lazy import attach

_NAMES = {
    "bench": "engines",
    "deform": "lammps",
    "measure_all": "model",
}

__getattr__, __dir__, __all__ = attach(__name__, _NAMES)
