"""Carries out a task for a command or a campaign, and prints what it does and what came out."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path as File

from labkit.engines.base import Progress
from labkit.files.netcdf import labkit_kind, open_netcdf
from labkit.grains.state import State
from labkit.grains.state_file import read_state
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import largest_deviation, mean_stress
from labkit.process.progress import reporter
from labkit.records.limits import exceeded_in
from labkit.results.endings import how_it_ended, void_ratio_at_start
from labkit.simulation.cost import announcement
from labkit.simulation.tasks import AnyTask, ConsolidationTask, RunTask, execute
from labkit.specimens.recipe import Recipe
from labkit.specimens.specimen import specimen_summary

ANISOTROPIC = 0.005  # deviation from an isotropic stress, relative to its pressure, above which a command says so


def execute_and_report(task: AnyTask) -> None:
    """Execute a task and print the results. Raises InputError, PhysicsError or Interrupted."""
    for line in _report(task):
        print(f"{task.output}: {line}", flush=True)


def _report(task: AnyTask) -> Iterator[str]:
    """Execute a task and yield lines about it."""
    if isinstance(task, RunTask):
        yield from _run(task)
    elif isinstance(task, ConsolidationTask):
        state = execute(task, announcing(task))
        yield f"{one_line(state)}, {_off_isotropic(state, task.path.held_pressure)}"
    else:
        if File(str(task.output)).exists():
            if task.has_made(read_state(str(task.output))):
                yield "already holds this specimen, nothing to do"
                return
            yield "holds another specimen, which will be replaced"
        state = execute(task, announcing(task))
        yield f"{one_line(state)}, {_off_isotropic(state)}"
        yield from task.findings(state)


def _run(task: RunTask) -> Iterator[str]:
    """Execute a run and yield lines about its file."""
    file = str(task.output)
    finished = _attribute(file, "complete")
    execute(task, reporter(task.title) if finished else announcing(task))
    with open_netcdf(file, "run") as dataset:
        attributes = {name: dataset.getncattr(name) for name in dataset.ncattrs()}
        met = how_it_ended(attributes, dataset["coordination_number"][...])
        start = float(dataset["void_ratio_nominal"][0])
    if consolidated := void_ratio_at_start(Recipe.made_at(task.state.recipe), start):
        yield consolidated
    yield ", ".join(("was already complete, nothing to do" if finished else "complete", *met))
    if reason := attributes.get("ended_because", ""):
        yield f"ended: {reason}"
    yield from map(str, exceeded_in(file))


def announcing(task: AnyTask, title: str | None = None) -> Progress:
    """Return a progress function that first prints one line to standard error: engine, grains, steps, expected time.

    The line appears with the first progress report, so it is not printed if the input is invalid.
    """
    title = title or task.title
    steps_done = _attribute(str(task.output), "steps") if isinstance(task, RunTask) else 0
    reporters: list[Progress] = []

    def progress(fraction: float, text: str) -> None:
        if not reporters:
            for line in filter(None, (announcement(task, steps_done), task.warning)):
                print(f"{title}: {line}", file=sys.stderr, flush=True)
            reporters.append(reporter(title))
        reporters[0](fraction, text)

    return progress


def _attribute(file: str, name: str) -> int:
    """Return an attribute of a run file; 0 if the file does not exist or lacks the attribute."""
    if labkit_kind(file) != "run":
        return 0
    with open_netcdf(file, "run") as dataset:
        return int(getattr(dataset, name, 0))


def one_line(state: State) -> str:
    """Describe a specimen in one line."""
    return ", ".join(
        f"{name} {value if isinstance(value, int) else format(value, '.4g')} {unit}".rstrip()
        for name, (value, unit) in specimen_summary(state).items()
    )


def _off_isotropic(state: State, pressure: float | None = None) -> str:
    """Say which stress is farthest from the isotropic stress `pressure`, Pa, by default from the mean stress."""
    stress = love_stress(state.snapshot())
    target = float(mean_stress(stress)) if pressure is None else pressure
    name, deviation = largest_deviation(stress, target)
    share = deviation / abs(target) if target else 0.0
    advice = "; --cell free makes the stress isotropic" if share > ANISOTROPIC else ""
    return f"deviation from the {'mean stress' if pressure is None else 'pressure'} {share:.2%} (sigma_{name}){advice}"
