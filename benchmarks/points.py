"""Speed of the model's finite-element interface on one core: labkit.model.update and the compiled law."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas

from labkit.model.controls import model_path
from labkit.model.driver import drive
from labkit.model.parameters import Model
from labkit.model.state import isotropic_state
from labkit.plugins.umat.library import Library, build, copy_sources, missing_compilers
from labkit.plugins.umat.material_point import Update, states, update

POINTS = 20_000
SIZES = (1e-5, 3e-5, 1e-4, 1e-3)  # norms of the strain increments
REPEATS = 5

Law = Callable[[np.ndarray, np.ndarray, bool], Update]


def measure(model: Model) -> pandas.DataFrame:
    """Measure millions of updates per second of POINTS points at once, without and with the consistent tangent.

    Returns one row per law and size of the strain increment: law, increment, substeps, stress, tangent. The state is
    reached on a CV path at 5 %, the directions of the increments are random, and the time is the shortest CPU time of
    the thread in REPEATS measurements. The compiled law is left out if a compiler is missing.
    """
    path = model_path("cv", 0.5e6, strain=0.05)
    y = states(drive(model, path, isotropic_state(model, 0.67, 0.5e6)).state(), POINTS)
    directions = np.random.default_rng(0).normal(size=(POINTS, 6))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    laws: dict[str, Law] = {"Python": lambda state, increment, tangent: update(model, state, increment, tangent)}
    with tempfile.TemporaryDirectory() as folder:
        if not missing_compilers():
            copy_sources(Path(folder))
            laws["compiled"] = Library(build(Path(folder)), model).update
        rows = [
            {"law": name, "increment": size, **_speeds(law, y, size * directions)}
            for size in SIZES
            for name, law in laws.items()
        ]
    return pandas.DataFrame(rows)


def _speeds(law: Law, y: np.ndarray, increments: np.ndarray) -> dict[str, float]:
    speeds = {}
    for kind, tangent in (("stress", False), ("tangent", True)):
        times = []
        for _ in range(REPEATS):
            begin = time.thread_time()
            result = law(y, increments, tangent).require()
            times.append(time.thread_time() - begin)
        speeds[kind] = POINTS / min(times) / 1e6
    return {"substeps": float(result.substeps.mean()), **speeds}


def text_of(speeds: pandas.DataFrame) -> str:
    """Format the table as text."""
    lines = [f"updates of {POINTS} material points at once, tolerance 1e-4, one core, in millions per second:"]
    for row in speeds.to_dict("records"):
        lines.append(
            f"  {row['law']:<8} |strain increment| {row['increment']:g}: {row['stress']:.2f} for state and stress, "
            f"{row['tangent']:.2f} with the consistent tangent; {row['substeps']:.2f} substeps on average"
        )
    if "compiled" not in set(speeds["law"]):
        lines.append(f"  compiled law not measured: {' and '.join(missing_compilers())} not found")
    return "\n".join(lines)
