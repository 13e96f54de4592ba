"""The section `runs` of a campaign file: loading paths applied to specimens, with lists expanded."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Iterable, Iterator

from labkit.grains.scene import Scene
from labkit.parameters import options_of
from labkit.paths.path import Path
from labkit.paths.path_file import PATH, STEPS, read_steps
from labkit.paths.rates import at_rate, default_rate
from labkit.paths.registry import PATHS
from labkit.paths.steps import Steps
from labkit.plugins.campaigns import keys
from labkit.plugins.campaigns.jobs import Job
from labkit.plugins.campaigns.specimens import Planner, require_unique
from labkit.records.limits import require_pressure
from labkit.records.schedule import Options
from labkit.simulation.clock import require_one_rate
from labkit.simulation.cost import schedule_of
from labkit.text.document import Block, Entry, Errors, Fields, Node, Text, similar
from labkit.text.foreign import noting_files

MOST_RUNS = 10_000
EXPANDED = "pressure"  # the parameter of a path that accepts a list of values
Changes = tuple[tuple[str, object], ...]  # parameters of the Scene that differ from those of the specimen


def read_runs(section: Iterable[Entry], planner: Planner, errors: Errors) -> list[Job]:
    """Read every run of the section, each after the consolidation that it needs.

    Entries may start from specimens and from runs of earlier entries. If a specimen and a run have the same name, the
    specimen is used.
    """
    runs: list[tuple[Job, int]] = []
    for entry in section:
        with noting_files():
            runs += _read_entry(entry, planner, errors)
        if len(runs) > MOST_RUNS:
            problem = f"with this entry there are more than {MOST_RUNS} runs: make several campaigns of them"
            errors.add(entry.line, problem)
            return []
    require_unique(runs, "run", errors)
    return [*planner.prepared.values(), *(run for run, _ in runs)]


def _read_entry(entry: Entry, planner: Planner, errors: Errors) -> list[tuple[Job, int]]:
    """Return the runs of an entry with their line; at most a few more than MOST_RUNS."""
    name, _, node = entry
    kind = _path_of(node)
    fields = keys.read_entry(entry, "run", keys.run_keys(kind), errors, [STEPS] * (kind is Steps))
    if kind is Steps:
        read_steps(node, fields, f"{fields.where}: {STEPS}")
    added: list[Job] = []
    for suffix, expanded in fields.combinations(keys.MULTIPLIED["runs"]):
        added += _runs(name + suffix, kind, expanded, planner)
        if len(added) > MOST_RUNS:
            break
    planner.groups.setdefault(name, added)
    return [(run, fields.line) for run in added]


def _path_of(node: Node) -> type[Path] | None:
    """Return the path named by an entry, or None if it is missing or unknown."""
    named = node.get(PATH.name) if isinstance(node, Block) else None
    return PATHS[named] if isinstance(named, Text) and named in PATHS else None


def _runs(name: str, kind: type[Path] | None, fields: Fields, planner: Planner) -> list[Job]:
    """Return the runs of one entry, or an empty list if the entry has errors."""
    groups = planner.groups
    fields.require([PATH], example="cv")
    fields.require([keys.SPECIMEN], example=next(iter(groups), "dense"))
    for specimen in fields.values_of(keys.SPECIMEN.name):
        if specimen not in groups:
            fields.error(f"there is no specimen {specimen!r}{similar(specimen, tuple(groups))}", keys.SPECIMEN.name)
    if kind is None:
        return []
    paths = list(itertools.islice(_paths(kind, fields), MOST_RUNS + 1))
    sources = [job for specimen in fields.values_of(keys.SPECIMEN.name) for job in groups.get(specimen, ())]
    options = Options(**{**keys.select(planner.values, Options), **keys.select(fields.values, Options)})
    changes = _changes(fields, planner)
    engines = fields.values_of("engine")
    devices = [planner.device({**fields.values, "engine": engine}) for engine in engines] or [
        planner.device(fields.values)
    ]
    factor = planner.settings(fields.values).rate_factor
    scaled = factor != 1.0 and "rate" not in fields.values and options.inertial_number is None
    runs = []
    combinations = itertools.product(sources, paths, devices)
    for source, (pressure, path), device in itertools.islice(combinations, MOST_RUNS + 1):
        scene = fields.attempt(_scene, source.scene, changes)
        if scene is None:
            return []
        path = _at_factor(path, factor, scene) if scaled else path
        fields.attempt(require_pressure, path, scene)  # checked even if the entry has other errors
        fields.attempt(require_one_rate, path, options)
        if fields.broken:
            continue
        parts = [name, source.name * (len(sources) > 1), pressure]
        label = "-".join(filter(None, [*parts, device.name * isinstance(fields.values.get("engine"), list)]))
        start = planner.start(source, path, device)
        if start is not source:
            fields.attempt(device.require_scene, source.scene, where=f"run {label}, its consolidation")
        runs.append(planner.job(label, device, scene, start, path=path, options=options, specimen=source.name))
        fields.attempt(device.require_scene, scene, where=f"run {label}")
        fields.attempt(schedule_of, path, scene, source.grains, options, where=f"run {label}")
    return runs


@functools.lru_cache
def _scene(scene: Scene, changes: Changes) -> Scene:
    """Return a changed Scene. Raises InputError."""
    return scene.replace(**dict(changes))


@functools.lru_cache(MOST_RUNS)
def _at_factor(path: Path, factor: float, scene: Scene) -> Path:
    """Return a path at its default rate times a factor."""
    return at_rate(path, factor * default_rate(type(path), scene))


def _paths(kind: type[Path], fields: Fields) -> Iterator[tuple[str, Path]]:
    """Yield (part of the name, path) for each listed pressure, from the parameters that could be read."""
    parameters, values = options_of(kind), keys.select(fields.values, kind)
    for name in sorted(set(fields.values) - set(parameters) - set(keys.any_run_keys())):
        fields.error(f"{name} is not a parameter of {kind.name}: leave it out", name)
        fields.broken.add(name)
    required = [parameter for parameter in parameters.values() if parameter.default is dataclasses.MISSING]
    if not fields.require(required) or any(parameter.name not in values for parameter in required):
        fields.broken.add(PATH.name)
        return
    pressures = values.get(EXPANDED)
    several = (
        [(f"p{pressure / 1e3:g}kPa", {EXPANDED: pressure}) for pressure in pressures]
        if isinstance(pressures, list)
        else [("", {})]
    )
    for part, pressure in several:
        path = fields.attempt(functools.partial(kind, **{**values, **pressure}))
        if path is not None:
            yield part, path
        else:
            fields.broken.add(PATH.name)


def _changes(fields: Fields, planner: Planner) -> Changes:
    """Return changes to the specimen's Scene. The time step comes from the run's settings, never the specimen's."""
    factor = planner.values.get("time_step_factor", planner.settings(fields.values).time_step_factor)
    allowed = keys.changes_of_runs()
    changes = {name: value for name, value in fields.values.items() if name in allowed}
    return tuple({"time_step_factor": factor, **changes}.items())
