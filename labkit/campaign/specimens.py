"""The section `specimens` of a campaign file: specimens to make, and specimens consolidated from others."""

from __future__ import annotations

import dataclasses
import functools
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from labkit.campaign.document import Entry, Errors, Fields, is_mapping, read_fields, similar
from labkit.campaign.items import Consolidated, Specimen
from labkit.campaign.keys import (
    FROM,
    MOST_GRAINS,
    MULTIPLIED,
    Common,
    consolidated_keys,
    given,
    specimen_keys,
)
from labkit.dem.limits import require_pressure
from labkit.dem.paths import Consolidation
from labkit.dem.scene import Scene
from labkit.dem.settings import Settings, settings
from labkit.dem.specimen import Recipe, side_for
from labkit.engines import ENGINES, require_engine
from labkit.parameters import restored


@dataclasses.dataclass(frozen=True)
class Specimens:
    """The parsed contents of the section.

    groups: name in the file -> names of its specimens, empty if the entry is invalid; origins: name of any specimen ->
    the Specimen from which it is derived.
    """

    made: tuple[Specimen, ...]
    consolidated: tuple[Consolidated, ...]
    groups: Mapping[str, Sequence[str]]
    origins: Mapping[str, Specimen]


def read_specimens(section: Iterable[Entry], top: Mapping[str, Any], errors: Errors) -> Specimens:
    """Reads the section. `top`: the defaults at the top of the file."""
    groups: dict[str, list[str]] = {}
    made: list[Specimen] = []
    lines: dict[str, int] = {}
    others: dict[str, Fields] = {}
    for name, line, node in section:
        groups[name], lines[name] = [], line
        where = f"specimen {name}"
        if is_mapping(node) and any(key.value == FROM.name for key, _ in node.value):
            others[name] = read_fields(node, consolidated_keys(), where, errors, line=line)
            continue
        fields = read_fields(node, specimen_keys(), where, errors, MULTIPLIED["specimens"], line=line)
        items = _made(name, fields, top)
        groups[name] = [item.name for item in items]
        made += items
    origins = {item.name: item for item in made}
    consolidated = _all_consolidated(others, groups, origins, lines, top, errors)
    named = [(one, lines[name]) for name, ones in groups.items() for one in ones]
    engines = "|".join(map(re.escape, ENGINES))
    reserved = re.compile(rf".*-at-p[0-9.e+-]+kPa-({engines})(-mixed)?")  # Campaign.consolidation
    for one, line in named:
        if reserved.fullmatch(one):
            errors.add(line, f"specimen {one}: labkit reserves this name for its own consolidations: choose another")
    require_unique(named, "specimen", errors)
    return Specimens(tuple(made), tuple(consolidated), groups, origins)


def chosen_settings(values: Mapping[str, Any], top: Mapping[str, Any]) -> Settings:
    """The Settings of an entry, or else those at the top of the file."""
    return settings(values.get("settings", top.get("settings", Common.settings)))


def worked(values: Mapping[str, Any], top: Mapping[str, Any]) -> dict[str, Any]:
    """Engine, threads and precision of an entry, or else those at the top of the file.

    An engine over MPI has `ranks` where the others have `threads`.
    """
    engine = values.get("engine", top.get("engine", Common.engine))
    parallel = ENGINES[engine].parallel if engine in ENGINES else "threads"
    names = {"engine": "engine", parallel: "threads", "precision": "precision"}
    return {to: value for name, to in names.items() if (value := values.get(name, top.get(name))) is not None}


def _made(name: str, fields: Fields, top: Mapping[str, Any]) -> list[Specimen]:
    """The Specimens of one entry, one per seed; empty if the entry has errors."""
    errors_before = fields.errors.count
    chosen = chosen_settings(fields.values, top)
    fields.require(known for known in specimen_keys().values() if known.default is dataclasses.MISSING)
    size, material = given(fields.values, Recipe), {**given(top, Scene), **given(fields.values, Scene)}
    seeds = size.pop("seed", Recipe.seed)
    if not (fields.has("side") or fields.has("grains")) and chosen.grains is not None:
        size["grains"] = chosen.grains
    scene = restored(Scene, {"time_step_factor": chosen.time_step_factor, **material})
    recipe = fields.attempt(lambda: restored(Recipe, size)) if "void_ratio" in size else None
    if recipe is None or fields.broken:
        return []
    specimen = Specimen(name, recipe, scene, **worked(fields.values, top))
    fields.attempt(lambda: require_engine(specimen.engine, scene, specimen.precision))
    if fields.attempt(lambda: recipe.side_of(scene)) and specimen.expected_grains > MOST_GRAINS:
        most = side_for(MOST_GRAINS, recipe.void_ratio, scene) * 1e3
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
    lines: Mapping[str, int],
    top: Mapping[str, Any],
    errors: Errors,
) -> list[Consolidated]:
    """The Consolidated of these entries, each after its source; adds them to the groups and the origins."""
    for fields in others.values():
        fields.require([consolidated_keys()["pressure"]])
        source = fields.values.get(FROM.name)
        if source is not None and source not in groups:
            fields.error(f"there is no specimen {source!r}{similar(source, tuple(groups))}", FROM.name)
    sources = {name: fields.values.get(FROM.name) for name, fields in others.items()}
    cyclic = _cycles(sources, lines, errors)
    consolidated = []
    for name in _sources_first([name for name in sources if name not in cyclic], sources):
        fields = others[name]
        for item in _consolidated(name, fields, groups, top):
            origins[item.name] = origin = origins[item.source]
            fields.attempt(functools.partial(require_engine, item.engine, origin.scene, item.precision))
            path = restored(Consolidation, {"pressure": item.pressure})
            fields.attempt(functools.partial(require_pressure, path, origin.scene))
            groups[name].append(item.name)
            consolidated.append(item)
    return consolidated


def _consolidated(
    name: str, fields: Fields, groups: Mapping[str, Sequence[str]], top: Mapping[str, Any]
) -> list[Consolidated]:
    """The Consolidated of one entry, one per specimen of its source; empty if the entry has errors."""
    source, pressure = fields.values.get(FROM.name), fields.values.get("pressure")
    if fields.broken or pressure is None or source is None:
        return []
    chosen, ones = worked(fields.values, top), list(groups.get(source, ()))
    names = [name] if ones == [source] else [name + one.removeprefix(source) for one in ones]
    return [Consolidated(made, one, pressure, **chosen) for made, one in zip(names, ones, strict=True)]


def _cycles(sources: Mapping[str, str | None], lines: Mapping[str, int], errors: Errors) -> set[str]:
    """Names of specimens that are derived from themselves, or from such a specimen. `sources`: name -> source."""
    cyclic: set[str] = set()
    known: set[str] = set()
    for name in sources:
        chain: dict[str, None] = {}
        source: str | None = name
        while source is not None and source in sources and source not in known and source not in chain:
            chain[source] = None
            source = sources[source]
        known |= chain.keys()
        if source in chain:
            names = list(chain)
            loop = names[names.index(source) :]
            first = min(loop, key=lambda one: lines[one])
            turned = loop[loop.index(first) :] + loop[: loop.index(first)]
            shown = [*turned[:LONGEST_LOOP], "..."] if len(turned) > LONGEST_LOOP else [*turned, first]
            problem = f"specimen {first} is derived from itself ({' from '.join(shown)})"
            errors.add(lines[first], f"{problem}: start from a specimen with a void ratio")
        if source in chain or source in cyclic:
            cyclic |= chain.keys()
    return cyclic


LONGEST_LOOP = 10  # names shown of specimens that are derived from each other


def _sources_first(names: Sequence[str], sources: Mapping[str, str | None]) -> list[str]:
    """The names in their order, but each after its source."""
    left: dict[str, None] = dict.fromkeys(names)
    ordered: list[str] = []
    for name in names:
        chain: list[str] = []
        source: str | None = name
        while source is not None and source in left:
            chain.append(source)
            del left[source]
            source = sources[source]
        ordered += reversed(chain)
    return ordered


def require_unique(named: Iterable[tuple[str, int]], what: str, errors: Errors) -> None:
    """Adds an error for each name that occurs twice. `named`: (name, line) pairs."""
    first: dict[str, int] = {}
    for name, line in named:
        if name in first:
            errors.add(line, f"{what} {name} is defined twice, first in line {first[name]}: choose another name")
        first.setdefault(name, line)
