"""The section `runs` of a campaign file: loading paths applied to specimens, with lists expanded."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from labkit.campaigns import keys
from labkit.campaigns.document import Block, Entry, Errors, Fields, Node, Text, read_fields, similar
from labkit.campaigns.items import Campaign, PlannedRun, schedule_of
from labkit.campaigns.path_file import STEPS, read_steps
from labkit.campaigns.specimens import Specimens, chosen_settings, require_unique, worked
from labkit.parameters import restore
from labkit.paths.path import Path
from labkit.paths.rates import at_rate, default_rate
from labkit.paths.registry import PATHS
from labkit.paths.steps import Steps
from labkit.records.limits import require_pressure
from labkit.records.schedule import Options
from labkit.runs.run.pace import require_one_rate

MOST_RUNS = 10_000
EXPANDED = "pressure"  # the parameter of a path that accepts a list of values


def read_runs(
    section: Iterable[Entry], top: Mapping[str, object], specimens: Specimens, errors: Errors
) -> list[tuple[PlannedRun, Fields]]:
    """Read every run of the section, with the fields of its entry; `top` holds the defaults of the file."""
    runs: list[tuple[PlannedRun, Fields]] = []
    for name, line, node in section:
        kind, where = _path_of(node), f"run {name}"
        sections = (STEPS,) if kind is Steps else ()
        several = [key for key in keys.run_keys(kind) if key != keys.PATH.name]
        fields = read_fields(node, keys.run_keys(kind), where, errors, several, sections, line)
        if kind is Steps:
            read_steps(node, fields, f"{where}: {STEPS}")
        added: list[PlannedRun] = []
        for suffix, one in fields.combinations(keys.MULTIPLIED["runs"]):
            added += _runs(name + suffix, kind, one, top, specimens)
            if len(runs) + len(added) > MOST_RUNS:
                errors.add(
                    line, f"with this entry there are more than {MOST_RUNS} runs: make several campaigns of them"
                )
                return []
        runs += [(run, fields) for run in added]
        specimens = specimens.with_runs(name, added)
    require_unique([(run.name, fields.line) for run, fields in runs], "run", errors)
    return runs


def _path_of(node: Node) -> type[Path] | None:
    """Return the path named by an entry, or None if it is missing or unknown."""
    named = node.get(keys.PATH.name) if isinstance(node, Block) else None
    return PATHS[named] if isinstance(named, Text) and named in PATHS else None


def _runs(
    name: str, kind: type[Path] | None, fields: Fields, top: Mapping[str, object], specimens: Specimens
) -> list[PlannedRun]:
    """Return the runs of one entry, none if the entry has errors."""
    fields.require([keys.PATH], example="cv")
    fields.require([keys.SPECIMEN], example=next(iter(specimens.groups), "dense"))
    for one in fields.listed(keys.SPECIMEN.name):
        if one not in specimens.groups:
            problem = f"there is no specimen {one!r}{similar(one, tuple(specimens.groups))}"
            fields.error(problem, keys.SPECIMEN.name)
    if kind is None:
        return []
    paths = list(itertools.islice(_paths(kind, fields, top), MOST_RUNS + 1))
    names = [item for one in fields.listed(keys.SPECIMEN.name) for item in specimens.groups.get(one, ())]
    options = restore(Options, {**keys.given(top, Options), **keys.given(fields.values, Options)})
    changes = _changes(fields, top)
    runs = []
    factor = chosen_settings(fields.values, top).rate_factor
    engines = fields.listed("engine")
    workings = [worked({**fields.values, "engine": one}, top) for one in engines] or [worked(fields.values, top)]
    combinations = itertools.product(names, paths, workings)
    for specimen, (pressure, path), working in itertools.islice(combinations, MOST_RUNS + 1):
        if factor != 1.0 and "rate" not in fields.values and options.inertial_number is None:
            scene = fields.attempt(functools.partial(specimens.origins[specimen].scene.replace, **dict(changes)))
            if scene is None:
                return []
            path = at_rate(path, factor * default_rate(kind, scene))
        suffixes = _suffixes(fields, names, specimen, pressure, working)
        runs.append(PlannedRun("-".join([name, *suffixes]), specimen, path, options, changes, **working))
    for run in runs[:MOST_RUNS]:  # checked even if the entry has other errors
        scene = fields.attempt(run.scene, specimens.origins[run.specimen])
        if scene is None:
            return []
        fields.attempt(require_pressure, run.path, scene)
        fields.attempt(require_one_rate, run.path, run.options)
    return [] if fields.broken else runs


def _paths(kind: type[Path], fields: Fields, top: Mapping[str, object]) -> Iterator[tuple[float | None, Path]]:
    """Yield (pressure, path) for each listed pressure, from the parameters that could be read."""
    known, values = keys.options_of(kind), keys.given(fields.values, kind)
    for name in set(fields.values) - set(known) - set(keys.any_run_keys()):
        fields.error(f"{name} is not a parameter of {kind.name}: leave it out", name)
        fields.broken.add(name)
    required = [one for one in known.values() if one.default is dataclasses.MISSING]
    if not fields.require(required) or any(one.name not in values for one in required):
        fields.broken.add(keys.PATH.name)
        return
    several = isinstance(values.get(EXPANDED), list)
    for one in values[EXPANDED] if several else [None]:
        chosen = {**values, EXPANDED: one} if several else values
        path = fields.attempt(restore, kind, chosen)
        if path is not None:
            yield one, path
        else:
            fields.broken.add(keys.PATH.name)


def _changes(fields: Fields, top: Mapping[str, object]) -> tuple[tuple[str, Any], ...]:
    """Return changes to the specimen's Scene. The time step comes from the run's settings, never the specimen's."""
    factor = top.get("time_step_factor", chosen_settings(fields.values, top).time_step_factor)
    known = keys.changes_of_runs()
    own = {name: value for name, value in fields.values.items() if name in known}
    return tuple({"time_step_factor": factor, **own}.items())


def _suffixes(
    fields: Fields, names: list[str], specimen: str, pressure: float | None, working: Mapping[str, Any]
) -> list[str]:
    """Return the parts of the name that distinguish a run from the others of its entry."""
    parts = [specimen] * (len(names) > 1)
    parts += [f"p{pressure / 1e3:g}kPa"] if pressure is not None else []
    return [*parts, working["engine"]] if isinstance(fields.values.get("engine"), list) else parts


def check_run(campaign: Campaign, run: PlannedRun, fields: Fields) -> None:
    """Make the checks that also need the specimen: of the contact law, and of the number of steps."""
    origin, where = campaign.origin(run.specimen), f"run {run.name}"
    fields.attempt(lambda: run.require_engine(run.scene(origin)), where=where)
    if campaign.consolidation(run):
        fields.attempt(lambda: run.require_engine(origin.scene), where=f"{where}, its consolidation")
    fields.attempt(lambda: schedule_of(run, origin), where=where)
