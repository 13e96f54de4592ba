"""The section `specimens` of a campaign file: specimens to make, and specimens consolidated from other specimens."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import re
import shlex
from collections.abc import Iterable, Mapping
from typing import Any

from labkit.engines import ENGINES
from labkit.engines.device import Device
from labkit.extensions import is_labkits
from labkit.files.hashes import file_sha256
from labkit.grains.scene import Scene
from labkit.parameters import Values
from labkit.paths.path import Path
from labkit.paths.standard import Consolidation
from labkit.plugins.campaigns import keys
from labkit.plugins.campaigns.jobs import Job, words_of
from labkit.plugins.campaigns.layout import output_of
from labkit.records.limits import require_pressure
from labkit.specimens.recipe import SETTINGS, Recipe, Settings, side_for
from labkit.text.document import Block, Entry, Errors, Fields, read_fields, similar
from labkit.text.foreign import noted_files, noting_files

LONGEST_LOOP = 10  # largest number of names to show when specimens are derived from each other


@dataclasses.dataclass(frozen=True)
class Planner:
    """Creates jobs from entries, the default values at the top of the file, and the user's files with their hashes.

    `groups` maps each entry so far to its jobs, `prepared` a name to the consolidation that labkit inserts.
    """

    values: Values
    use: tuple[str, ...] = ()
    hashes: tuple[str, ...] = ()
    groups: dict[str, list[Job]] = dataclasses.field(default_factory=dict)
    prepared: dict[str, Job] = dataclasses.field(default_factory=dict)

    def settings(self, values: Values) -> Settings:
        """Return the Settings of an entry, or the default Settings of the file."""
        return SETTINGS[({"settings": keys.COMMON["settings"].default} | self.values | values)["settings"]]

    def device(self, values: Values) -> Device:
        """Return the engine of an entry, or the file's default; it ignores threads, or ranks, that it cannot use."""
        values = {name: parameter.default for name, parameter in keys.COMMON.items()} | self.values | values
        parallel = ENGINES[values["engine"]].abilities.parallel
        return Device(values["engine"], precision=values["precision"], **{name: values[name] for name in parallel})

    def job(self, name: str, device: Device, scene: Scene, source: Job | None = None, **what: Any) -> Job:
        """Create a job; `what` holds its other fields. Every run records user-defined statistics."""
        depends = "path" in what or not (is_labkits(type(scene.contact_law)) and is_labkits(device.kind))
        basis = (() if source is None else (source.digest,)) + (self.hashes if depends else ())
        if source is not None:
            what |= {"source": output_of(source), "grains": source.grains}
        files = {} if "pressure" in what else {file: file_sha256(file) for file in noted_files()}  # of the entry
        job = Job(name=name, device=device, scene=scene, basis=basis, use=self.use, files=files, **what)
        words = ["labkit", *words_of(job, None if source is None else source.scene), "-o", output_of(job)]
        return dataclasses.replace(job, command=shlex.join(words))

    def start(self, source: Job, path: Path, device: Device) -> Job:
        """Return the job whose result a run starts from: a consolidation if the specimen has a different pressure.

        A run that continues another run performs its own consolidation.
        """
        pressure = path.start_pressure()
        if source.kind == "run" or pressure is None or pressure == source.pressure:
            return source
        working = device.name if device.precision == "double" else f"{device.name}-{device.precision}"
        name = f"{source.name}-at-p{pressure / 1e3:.10g}kPa-{working}"
        if name not in self.prepared:
            self.prepared[name] = self.job(name, device, source.scene, source, pressure=pressure, cell=source.cell)
        return self.prepared[name]


def read_specimens(section: Iterable[Entry], planner: Planner, errors: Errors) -> list[Job]:
    """Read the section; consolidated specimens come last, each after its source."""
    groups = planner.groups
    lines: dict[str, int] = {}
    others: dict[str, Fields] = {}
    for entry in section:
        name, line, node = entry
        groups[name], lines[name] = [], line
        if isinstance(node, Block) and keys.FROM.name in node:
            several = [key for key in keys.consolidated_keys() if key != keys.FROM.name]
            where = f"specimen {name}"
            others[name] = read_fields(node, keys.consolidated_keys(), where, errors, several, line=line)
            continue
        fields = keys.read_entry(entry, "specimen", keys.specimen_keys(), errors)
        combined = fields.combinations(keys.MULTIPLIED["specimens"])
        with noting_files():
            groups[name] = [job for suffix, each in combined for job in _specimens(name + suffix, each, planner)]
    for name in _sources_first(others, errors):
        jobs = _consolidations(name, others[name], planner)
        del groups[name]  # moves the entry to the end
        groups[name] = jobs
    lined = [(job, lines[name]) for name, jobs in groups.items() for job in jobs]
    engines = "|".join(map(re.escape, ENGINES))
    reserved = re.compile(rf".*-at-p[0-9.e+-]+kPa-({engines})(-mixed)?")  # Planner.start
    for job, line in lined:
        if reserved.fullmatch(job.name):
            errors.add(
                line, f"specimen {job.name}: labkit reserves this name for its own consolidations: choose another"
            )
    require_unique(lined, "specimen", errors)
    return [job for job, _ in lined]


def _specimens(name: str, fields: Fields, planner: Planner) -> list[Job]:
    """Return the specimens of one entry, one per seed, or an empty list if the entry has errors."""
    errors_before, values = fields.errors.count, fields.values
    chosen = planner.settings(values)
    fields.require([] if fields.has("pressure") else [keys.specimen_keys()["void_ratio"]])
    size, material = (keys.select(values, Recipe), {**keys.select(planner.values, Scene), **keys.select(values, Scene)})
    seeds = size.pop("seed", Recipe.seed)
    if not (fields.has("side") or fields.has("grains")) and chosen.grains is not None:
        size["grains"] = chosen.grains
    scene = fields.attempt(functools.partial(Scene, **{"time_step_factor": chosen.time_step_factor, **material}))
    recipe = fields.attempt(functools.partial(Recipe, **size)) if size.keys() & {"void_ratio", "pressure"} else None
    if recipe is None or scene is None or fields.broken:
        return []
    device = planner.device(values)
    fields.attempt(device.require_scene, scene)
    grains = fields.attempt(recipe.expected_grains, scene) or 0
    if grains > keys.MOST_GRAINS:
        most = side_for(keys.MOST_GRAINS, recipe.size_ratio, scene) * 1e3
        fields.error(f"side makes about {grains} grains: give at most {most:.2g} mm, or `grains`", "side")
    if fields.errors.count > errors_before:
        return []
    spheres = recipe.expected_spheres(scene)
    suffixes = {seed: f"-s{seed}" for seed in seeds} if isinstance(seeds, list) else {seeds: ""}
    return [
        planner.job(name + suffix, device, scene, grains=spheres, recipe=seeded, cell=seeded.cell)
        for seeded, suffix in ((dataclasses.replace(recipe, seed=seed), suffix) for seed, suffix in suffixes.items())
    ]


def _consolidations(name: str, fields: Fields, planner: Planner) -> list[Job]:
    """Return the consolidations of one entry."""
    groups = planner.groups
    source = fields.values.get(keys.FROM.name)
    fields.require([keys.consolidated_keys()["pressure"]])
    if source is not None and source not in groups:
        fields.error(f"there is no specimen {source!r}{similar(source, tuple(groups))}", keys.FROM.name)
    if fields.broken or not fields.has("pressure") or source is None:
        return []
    jobs = []
    for specimen, (suffix, each) in itertools.product(groups.get(source, ()), fields.combinations()):
        of_source = "" if specimen.name == source else specimen.name.removeprefix(source)
        device, pressure = planner.device(each.values), each.values["pressure"]
        fields.attempt(device.require_scene, specimen.scene)
        fields.attempt(require_pressure, Consolidation(pressure=pressure), specimen.scene)
        cell = each.values.get("cell", specimen.cell)
        jobs.append(
            planner.job(name + of_source + suffix, device, specimen.scene, specimen, pressure=pressure, cell=cell)
        )
    return jobs


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
            ring = [*loop[first:], *loop[:first], loop[first]]
            names = [*ring[:LONGEST_LOOP], "..."] if len(loop) > LONGEST_LOOP else ring
            problem = f"specimen {ring[0]} is derived from itself ({' from '.join(names)})"
            errors.add(others[ring[0]].line, f"{problem}: start from a specimen with a void ratio")
        ordered |= dict.fromkeys(reversed(chain))
    return list(ordered)


def require_unique(jobs: Iterable[tuple[Job, int]], what: str, errors: Errors) -> None:
    """Add an error for each name that occurs twice among jobs and their lines; some file systems ignore its case."""
    first: dict[str, tuple[str, int]] = {}
    for job, line in jobs:
        name, before = first.setdefault(job.name.lower(), (job.name, line))
        if before != line or name != job.name:
            twice = "is defined twice, first" if name == job.name else f"is {name} on file systems that ignore case,"
            errors.add(line, f"{what} {job.name} {twice} in line {before}: choose another name")
