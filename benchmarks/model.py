"""Speed and error of the model's integrators on one core."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path as File

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from benchmarks.integrators import FIXED, BackwardEuler, Scipy
from benchmarks.points import measure, text_of
from labkit.errors import PhysicsError
from labkit.figures import plots
from labkit.figures.frame import WIDTH, new_figure
from labkit.files.atomic import write_text
from labkit.model.controls import model_path
from labkit.model.driver import drive
from labkit.model.integrators import Adaptive, Integrator
from labkit.model.parameters import Model
from labkit.model.state import ModelState, isotropic_state
from labkit.paths.path import Path

RECORD = 0.01  # axial strain between records, at which the error is evaluated
STEPS = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4)
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10)
SCIPY = ("RK45", "DOP853", "LSODA", "Radau")
REPEATS = 3
BUDGET = 1.0  # s: a slower run is not repeated, and no finer setting is tried

Point = tuple[float, float, float | None]  # setting, seconds, error or None if the integrator failed


def tests(model: Model) -> dict[str, tuple[Path, ModelState]]:
    """Define a smooth path, one with reversals and a stiff one: title -> (path, start)."""
    start = isotropic_state(model, 0.67, 0.5e6)
    return {
        "CV to 40 %, smooth": (model_path("cv", 0.5e6, strain=0.4), start),
        "cyclic CP, six reversals": (model_path("cyclic_cp", 0.5e6), start),
        "CV to 10 % from Lambda = 1e-5, stiff": (model_path("cv", 0.5e6, strain=0.1), ModelState(0.606, 5.9, 1e-5)),
    }


def measure_all(folder: File) -> str:
    """Write model_speed.txt and model_speed.png into the folder; return the text."""
    model = Model()
    results = {title: work(model, path, start) for title, (path, start) in tests(model).items()}
    text = table(results) + "\n\n" + one_path(model) + "\n\n" + text_of(measure(model)) + "\n"
    write_text(folder / "model_speed.txt", text)
    plots.save(work_precision(results), folder / "model_speed.png")
    return text


def work(model: Model, path: Path, start: ModelState) -> dict[str, list[Point]]:
    """Measure every integrator at each of its settings: label -> Points."""
    exact = drive(model, path, start, RECORD, Adaptive(1e-12)).require().stress
    kinds: dict[str, tuple[Callable[[float], Integrator], Sequence[float]]]
    kinds = {kind.__name__: (kind, STEPS) for kind in FIXED}
    kinds["Adaptive (Dormand-Prince)"] = (Adaptive, TOLERANCES)
    for method in SCIPY:
        kinds[f"scipy {method}"] = (functools.partial(Scipy, method), TOLERANCES)
    drive(model, model_path("cv", 1.0, strain=1e-3), start, integrator=BackwardEuler(1e-3)).require()  # compiles
    return {label: _curve(model, path, start, make, settings, exact) for label, (make, settings) in kinds.items()}


def _curve(
    model: Model,
    path: Path,
    start: ModelState,
    make: Callable[[float], Integrator],
    settings: Sequence[float],
    exact: np.ndarray,
) -> list[Point]:
    points = []
    for setting in settings:
        seconds, error = np.inf, None
        for _ in range(REPEATS):
            integrator = make(setting)
            begin = time.thread_time()
            try:
                result = drive(model, path, start, RECORD, integrator).require()
                error = _error(result.stress, exact)
            except (PhysicsError, FloatingPointError):
                error = None
            seconds = min(seconds, time.thread_time() - begin)
            if seconds > BUDGET:
                break
        points.append((setting, seconds, error))
        if seconds > BUDGET:
            break
    return points


def _error(stress: np.ndarray, exact: np.ndarray) -> float | None:
    """Largest stress error divided by the largest stress, Frobenius norms; None if the result is unusable."""
    if stress.shape != exact.shape:
        return None
    norm = np.linalg.norm(stress - exact, axis=(1, 2)).max() / np.linalg.norm(exact, axis=(1, 2)).max()
    return float(norm) if np.isfinite(norm) and norm < 1.0 else None


def table(results: Mapping[str, Mapping[str, Sequence[Point]]]) -> str:
    """Tabulate time and error of every integrator at every setting, from title -> label -> Points."""
    lines = [
        f"Relative stress error (maximum over the records) and time (best of {REPEATS}), for each strain step of the "
        "fixed-step integrators and each tolerance of the others."
    ]
    for title, curves in results.items():
        lines += ["", title]
        for label, points in curves.items():
            cells = (f"{s:g}: {t * 1e3:.3g} ms {'failed' if e is None else f'{e:.1e}'}" for s, t, e in points)
            lines.append(f"  {label:<26} " + ", ".join(cells))
    return "\n".join(lines)


def one_path(model: Model) -> str:
    """Measure the time of a CV path to 60 % strain with 601 records at the default tolerance."""
    start = isotropic_state(model, 0.67, 0.5e6)
    path = model_path("cv", 0.5e6, strain=0.6)
    exact = drive(model, path, start, integrator=Adaptive(1e-12)).stress
    times = []
    for _ in range(10):
        begin = time.thread_time()
        result = drive(model, path, start)
        times.append(time.thread_time() - begin)
    return (
        f"one CV path to 60 %, {len(result)} records, default tolerance: {np.median(times) * 1e3:.2f} ms, "
        f"stress error {_error(result.stress, exact):.1e}"
    )


def work_precision(panels: Mapping[str, Mapping[str, Sequence[tuple[float, float, float | None]]]]) -> Figure:
    """Draw computing time against error of integrators; returns a Figure.

    `panels` maps a title to (label -> list of (setting, seconds, error)). Settings at which an integrator failed have
    no error and are not drawn.
    """
    figure = new_figure(WIDTH * 1.3, 4.6)
    grid = figure.panels(1, len(panels), squeeze=False)
    colors = matplotlib.color_sequences["tab20"]
    for axes, (title, results) in zip(grid[0], panels.items(), strict=True):
        for number, (label, points) in enumerate(results.items()):
            kept = np.array([(error, 1e3 * seconds) for _, seconds, error in points if error])
            color, marker = colors[number % 20], "osD^v<>*PXhp"[number % 12]
            if len(kept):
                axes.loglog(*kept.T, marker=marker, ms=4, lw=1.2, color=color, label=label)
        axes.set(xlabel="relative error of the stress", ylabel="time (ms)", title=title)
        axes.title.set_fontsize(10)
        axes.invert_xaxis()
    handles = {h.get_label(): h for axes in grid[0] for h in axes.get_legend_handles_labels()[0]}
    figure.key(6, list(handles.values()))
    return figure
