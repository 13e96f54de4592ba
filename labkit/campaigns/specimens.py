"""The section `specimens` of a campaign file: specimens to make, and specimens consolidated from others."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from labkit.campaigns import keys
from labkit.campaigns.document import Block, Entry, Errors, Fields, read_fields, similar
from labkit.campaigns.items import Consolidated, PlannedRun, Specimen
from labkit.engines import ENGINES
from labkit.grains.scene import Scene
from labkit.parameters import restore
from labkit.paths.standard import Consolidation
from labkit.records.limits import require_pressure
from labkit.specimens.settings import SETTINGS, Settings
from labkit.specimens.specimen import Recipe, side_for

LONGEST_LOOP = 10  # names to show when specimens are derived from each other


@dataclasses.dataclass(frozen=True)
class Specimens:
    """The parsed contents of the section.

    `groups` maps a name in the file to the names of its specimens, none if the entry is invalid. `origins` maps the
    name of any specimen to the Specimen from which it is derived.
    """

    made: tuple[Specimen, ...]
    consolidated: tuple[Consolidated, ...]
    groups: Mapping[str, Sequence[str]]
    origins: Mapping[str, Specimen]

    def with_runs(self, name: str, runs: Sequence[PlannedRun]) -> Specimens:
        """Add the runs of an entry, from whose ends later runs continue; a specimen of the same name wins."""
        if name in self.groups:
            return self
        origins = {run.name: self.origins[run.specimen] for run in runs}
        scenes = {
            one: dataclasses.replace(at, scene=run.scene(at))
            for (one, at), run in zip(origins.items(), runs, strict=True)
        }
        groups = {**self.groups, name: [run.name for run in runs]}
        return dataclasses.replace(self, groups=groups, origins={**scenes, **self.origins})


def read_specimens(section: Iterable[Entry], top: Mapping[str, object], errors: Errors) -> Specimens:
    """Read the section; `top` holds the defaults of the file."""
    groups: dict[str, list[str]] = {}
    made: list[Specimen] = []
    lines: dict[str, int] = {}
    others: dict[str, Fields] = {}
    for name, line, node in section:
        groups[name], lines[name] = [], line
        where = f"specimen {name}"
        if isinstance(node, Block) and keys.FROM.name in node:
            several = [key for key in keys.consolidated_keys() if key != keys.FROM.name]
            others[name] = read_fields(node, keys.consolidated_keys(), where, errors, several, line=line)
            continue
        fields = read_fields(node, keys.specimen_keys(), where, errors, keys.specimen_keys(), line=line)
        combined = fields.combinations(keys.MULTIPLIED["specimens"])
        items = [item for suffix, one in combined for item in _made(name + suffix, one, top)]
        groups[name] = [item.name for item in items]
        made += items
    origins = {item.name: item for item in made}
    consolidated = _all_consolidated(others, groups, origins, top, errors)
    named = [(one, lines[name]) for name, ones in groups.items() for one in ones]
    engines = "|".join(map(re.escape, ENGINES))
    reserved = re.compile(rf".*-at-p[0-9.e+-]+kPa-({engines})(-mixed)?")  # Campaign.consolidation
    for one, line in named:
        if reserved.fullmatch(one):
            errors.add(line, f"specimen {one}: labkit reserves this name for its own consolidations: choose another")
    require_unique(named, "specimen", errors)
    return Specimens(tuple(made), tuple(consolidated), groups, origins)


def chosen_settings(values: Mapping[str, Any], top: Mapping[str, object]) -> Settings:
    """Return the Settings of an entry, or those at the top of the file."""
    return SETTINGS[values.get("settings", top.get("settings", keys.Common.settings))]


def worked(values: Mapping[str, Any], top: Mapping[str, object]) -> dict[str, Any]:
    """Return engine, threads and precision of an entry, or those at the top of the file.

    An engine over MPI has `ranks` where the others have `threads`.
    """
    engine = values.get("engine", top.get("engine", keys.Common.engine))
    parallel = ENGINES[engine].abilities.parallel if engine in ENGINES else "threads"
    names = {"engine": "engine", parallel: "threads", "precision": "precision"}
    return {to: value for name, to in names.items() if (value := values.get(name, top.get(name))) is not None}


def _made(name: str, fields: Fields, top: Mapping[str, object]) -> list[Specimen]:
    """Return the Specimens of one entry, one per seed, none if the entry has errors."""
    errors_before = fields.errors.count
    chosen = chosen_settings(fields.values, top)
    fields.require(known for known in keys.specimen_keys().values() if known.default is dataclasses.MISSING)
    size, material = keys.given(fields.values, Recipe), {**keys.given(top, Scene), **keys.given(fields.values, Scene)}
    seeds = size.pop("seed", Recipe.seed)
    if not (fields.has("side") or fields.has("grains")) and chosen.grains is not None:
        size["grains"] = chosen.grains
    scene = fields.attempt(restore, Scene, {"time_step_factor": chosen.time_step_factor, **material})
    recipe = fields.attempt(restore, Recipe, size) if "void_ratio" in size else None
    if recipe is None or scene is None or fields.broken:
        return []
    specimen = Specimen(name, recipe, scene, **worked(fields.values, top))
    fields.attempt(specimen.require_engine, scene)
    if fields.attempt(recipe.side_of, scene) and specimen.expected_grains > keys.MOST_GRAINS:
        most = side_for(keys.MOST_GRAINS, recipe.void_ratio, scene) * 1e3
        problem = f"side makes about {specimen.expected_grains} grains: give at most {most:.2g} mm, or `grains`"
        fields.error(problem, "side")
    if fields.errors.count > errors_before:
        return []
    several = isinstance(seeds, list)
    named = [(f"{name}-s{seed}" if several else name, seed) for seed in (seeds if several else [seeds])]
    return [
        dataclasses.replace(specimen, name=one, recipe=dataclasses.replace(recipe, seed=seed)) for one, seed in named
    ]


def _all_consolidated(
    others: Mapping[str, Fields],
    groups: dict[str, list[str]],
    origins: dict[str, Specimen],
    top: Mapping[str, object],
    errors: Errors,
) -> list[Consolidated]:
    """Return the Consolidated of these entries, each after its source, and add them to the groups and the origins."""
    consolidated = []
    for name in _sources_first(others, errors):
        fields = others[name]
        source = fields.values.get(keys.FROM.name)
        fields.require([keys.consolidated_keys()["pressure"]])
        if source is not None and source not in groups:
            fields.error(f"there is no specimen {source!r}{similar(source, tuple(groups))}", keys.FROM.name)
        if fields.broken or not fields.has("pressure") or source is None:
            continue
        for one, (suffix, each) in itertools.product(tuple(groups.get(source, ())), fields.combinations()):
            made = name + suffix if one == source else name + one.removeprefix(source) + suffix
            item = Consolidated(made, one, each.values["pressure"], **worked(each.values, top))
            origins[made] = origin = origins[one]
            fields.attempt(item.require_engine, origin.scene)
            path = restore(Consolidation, {"pressure": item.pressure})
            fields.attempt(require_pressure, path, origin.scene)
            groups[name].append(item.name)
            consolidated.append(item)
    return consolidated


def _sources_first(others: Mapping[str, Fields], errors: Errors) -> list[str]:
    """Return the names, each after its source; adds an error for specimens that are derived from each other."""
    ordered: dict[str, None] = {}
    for name in others:
        chain: dict[str, None] = {}
        while name in others and name not in ordered and name not in chain:
            chain[name] = None
            name = others[name].values.get(keys.FROM.name, "")
        if name in chain:
            loop = list(chain)[list(chain).index(name) :]  # each is derived from the next one
            first = min(range(len(loop)), key=lambda k: others[loop[k]].line)
            turned = [*loop[first:], *loop[:first], loop[first]]
            shown = [*turned[:LONGEST_LOOP], "..."] if len(loop) > LONGEST_LOOP else turned
            problem = f"specimen {turned[0]} is derived from itself ({' from '.join(shown)})"
            errors.add(others[turned[0]].line, f"{problem}: start from a specimen with a void ratio")
        ordered |= dict.fromkeys(reversed(chain))
    return list(ordered)


def require_unique(named: Iterable[tuple[str, int]], what: str, errors: Errors) -> None:
    """Add an error for each name that occurs twice in the (name, line) pairs."""
    first: dict[str, int] = {}
    for name, line in named:
        if name in first:
            errors.add(line, f"{what} {name} is defined twice, first in line {first[name]}: choose another name")
        first.setdefault(name, line)
