"""The section `runs` of a campaign file: loading paths of specimens, lists multiplied out."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from labkit.campaign.document import Entry, Fields, Mistakes, read_fields, similar
from labkit.campaign.items import Campaign, Run, schedule_of
from labkit.campaign.keys import MULTIPLIED, PATH, SPECIMEN, any_run_keys, changes_of_runs, given, options_of, run_keys
from labkit.campaign.specimens import Specimens, chosen_settings, require_unique, worked
from labkit.dem.limits import require_pressure
from labkit.dem.paths import PATHS, Path
from labkit.dem.simulation import Options
from labkit.engines import require_engine
from labkit.parameters import restored

MOST_RUNS = 10_000
MANY = "pressure"  # the parameter of a path that lists multiply


def read_runs(
    section: Iterable[Entry], top: Mapping[str, Any], specimens: Specimens, mistakes: Mistakes
) -> list[tuple[Run, Fields]]:
    """Every run, with the fields of its entry; `top`: what the file says for all that say nothing."""
    found = []
    for name, line, node in section:
        kind = _path_of(node)
        fields = read_fields(node, run_keys(kind), f"run {name}", mistakes, MULTIPLIED["runs"], line=line)
        found += [(run, fields) for run in _runs(name, kind, fields, top, specimens)]
    if len(found) > MOST_RUNS:
        mistakes.add(found[-1][1].line, f"there are {len(found)} runs: give at most {MOST_RUNS} in one campaign")
        return []
    require_unique([(run.name, fields.line) for run, fields in found], "run", mistakes)
    return found


def _path_of(node: Any) -> type[Path] | None:
    """The path that an entry names, if it is known."""
    named = [value.value for key, value in node.value if key.value == PATH.name] if node.id == "mapping" else []
    return PATHS[named[0]] if named and isinstance(named[0], str) and named[0] in PATHS else None


def _runs(
    name: str, kind: type[Path] | None, fields: Fields, top: Mapping[str, Any], specimens: Specimens
) -> list[Run]:
    """The Runs of one entry; none when something is wrong with it."""
    fields.require([PATH], example="cv")
    fields.require([SPECIMEN], example=next(iter(specimens.groups), "dense"))
    for one in fields.listed(SPECIMEN.name):
        if one not in specimens.groups:
            said = f"there is no specimen {one!r}{similar(one, tuple(specimens.groups))}"
            fields.mistake(said, SPECIMEN.name)
    if kind is None:
        return []
    paths = list(_paths(kind, fields, top))
    names = [item for one in fields.listed(SPECIMEN.name) for item in specimens.groups.get(one, ())]
    options = restored(Options, {**given(top, Options), **given(fields.values, Options)})
    changes = _changes(fields, top)
    runs = []
    for specimen, (pressure, path), working in itertools.product(names, paths, _workings(fields, top)):
        words = [name, *_words(fields, names, specimen, pressure, working)]
        runs.append(Run("-".join(words), specimen, path, options, changes, **working))
    for run in runs[:MOST_RUNS]:  # whatever else is wrong with them
        scene = run.scene(specimens.origins[run.specimen])
        fields.attempt(lambda: require_pressure(run.path, scene))
    return [] if fields.broken else runs


def _paths(kind: type[Path], fields: Fields, top: Mapping[str, Any]) -> Iterator[tuple[float | None, Path]]:
    """(pressure, path) for each pressure that is listed, of all parameters that could be read."""
    known, values = options_of(kind), given(fields.values, kind)
    for name in set(fields.values) - set(known) - set(any_run_keys()):
        fields.mistake(f"{name} is not a parameter of {kind.name}: leave it out", name)
        fields.broken.add(name)
    required = [one for one in known.values() if one.default is dataclasses.MISSING]
    if not fields.require(required) or any(one.name not in values for one in required):
        fields.broken.add(PATH.name)
        return
    if "rate" in known and known["rate"] not in required:
        values = {"rate": known["rate"].default * chosen_settings(fields.values, top).rate_factor, **values}
    several = isinstance(values.get(MANY), list)
    for one in values[MANY] if several else [None]:
        path = fields.attempt(lambda: restored(kind, {**values, MANY: one} if several else values))
        if path is not None:
            yield one, path
        else:
            fields.broken.add(PATH.name)


def _changes(fields: Fields, top: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    """What the run changes of its specimen's Scene; the time step is never the specimen's but that of the settings."""
    factor = top.get("time_step_factor", chosen_settings(fields.values, top).time_step_factor)
    known = changes_of_runs()
    own = {name: value for name, value in fields.values.items() if name in known}
    return tuple({"time_step_factor": factor, **own}.items())


def _workings(fields: Fields, top: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Engine and threads, for each engine that is listed."""
    engines = fields.listed("engine")
    return [worked({**fields.values, "engine": one}, top) for one in engines] or [worked(fields.values, top)]


def _words(
    fields: Fields, names: list[str], specimen: str, pressure: float | None, working: Mapping[str, Any]
) -> list[str]:
    """What tells a run from the others of its entry."""
    words = [specimen] * (len(names) > 1)
    words += [f"p{pressure / 1e3:g}kPa"] if pressure is not None else []
    return [*words, working["engine"]] if isinstance(fields.values.get("engine"), list) else words


def check_run(campaign: Campaign, run: Run, fields: Fields) -> None:
    """What needs the specimen too: the law, and steps that fit the path."""
    origin, where = campaign.origin(run.specimen), f"run {run.name}"
    fields.attempt(lambda: require_engine(run.engine, run.scene(origin)), where)
    if campaign.consolidation(run):
        fields.attempt(lambda: require_engine(run.engine, origin.scene), f"{where}, its consolidation")
    fields.attempt(lambda: schedule_of(run, origin), where)
