"""The campaign file: YAML that a person edits, read as values, with every mistake in it and its line.

    settings: quick                     # quick, standard, reference; for what says nothing else
    engine: fused
    specimens:
      dense: {void_ratio: 0.606, step1_friction: 0.0405, grains: 500, seed: [1, 2]}
      dense_1MPa: {from: dense, pressure: 1 MPa}         # the same, consolidated
    runs:
      cp: {path: cp, specimen: dense, pressure: [0.5 MPa, 1 MPa], engine: [yade, fused]}

Lists multiply: `cp` is eight runs, cp-dense-s1-p500kPa-yade and so on.
"""

from __future__ import annotations

import dataclasses
import difflib
import itertools
import re
from pathlib import Path

from labkit.campaign.values import choice, number, quantity, whole, word
from labkit.engines import ENGINES, require_law
from labkit.errors import InputError
from labkit.dem.paths import PATHS, make_path
from labkit.dem.scene import LAWS, Scene
from labkit.dem.settings import SETTINGS, settings
from labkit.dem.simulation import SNAPSHOTS, Schedule
from labkit.dem.specimen import MINIMUM_GRAINS, Recipe, mean_grain_volume, side_for

MOST_GRAINS = 100_000  # of one specimen: hours on one core already
MOST_THREADS = 256
MOST_RUNS = 10_000
MOST_MISTAKES = 100  # that are shown


@dataclasses.dataclass(frozen=True)
class Specimen:
    """A specimen to make. Lengths in m; `side` or `grains` or neither (then the settings say)."""

    name: str
    void_ratio: float
    step1_friction: float = 0.15
    step1_rolling_friction: float = 0.1
    side: float | None = None
    grains: int | None = None
    seed: int = 1
    law: str = "yade"
    time_step_factor: float | None = None
    settings: str = "standard"
    engine: str = "yade"
    threads: int = 1

    @property
    def scene(self):
        factor = self.time_step_factor or settings(self.settings).time_step_factor
        return Scene(law=self.law, time_step_factor=factor)

    @property
    def expected_grains(self):
        """Number of grains, about."""
        chosen = settings(self.settings)
        side, grains = (self.side, self.grains) if self.side or self.grains else (chosen.side, chosen.grains)
        return grains or round(side**3 / (1.0 + self.void_ratio) / mean_grain_volume(self.scene))


@dataclasses.dataclass(frozen=True)
class Consolidated:
    """The specimen `source` brought to `pressure`, Pa, in all directions."""

    name: str
    source: str
    pressure: float
    engine: str = "yade"
    threads: int = 1


@dataclasses.dataclass(frozen=True)
class Run:
    """A loading path of a specimen. None: what `labkit run` takes when nothing is given."""

    name: str
    specimen: str
    path: str
    pressure: float | None = None
    strain: float | None = None
    rate: float | None = None
    reversals: tuple[float, ...] | None = None
    record_strain: float | None = None
    snapshots: int = SNAPSHOTS
    law: str | None = None
    time_step_factor: float | None = None
    settings: str = "standard"
    engine: str = "yade"
    threads: int = 1

    def scene(self, specimen):
        """The Scene of the run of a Specimen."""
        factor = self.time_step_factor or settings(self.settings).time_step_factor
        return dataclasses.replace(specimen.scene, time_step_factor=factor, law=self.law or specimen.law)

    def loading(self):
        """The path of labkit.dem.paths. A pressure that is the specimen's own is not known yet: a usual one stands."""
        kind = PATHS[self.path]
        rate = self.rate or kind.rate * settings(self.settings).rate_factor
        return make_path(
            self.path, 0.5e6, pressure=self.pressure, strain=self.strain, rate=rate, reversals=self.reversals
        )


@dataclasses.dataclass(frozen=True)
class Campaign:
    """What a file asks for, lists multiplied out; names are unique among specimens and among runs."""

    name: str
    specimens: tuple[Specimen, ...]
    consolidated: tuple[Consolidated, ...]
    runs: tuple[Run, ...]

    def origin(self, name):
        """The Specimen that a specimen's name goes back to."""
        sources = {item.name: item.source for item in self.consolidated}
        while name in sources:
            name = sources[name]
        return next(item for item in self.specimens if item.name == name)

    def consolidation(self, run):
        """The name of the consolidation that labkit adds before a run, where the run holds a stress that its specimen
        was not brought to; None for any other run."""
        at = next((item.pressure for item in self.consolidated if item.name == run.specimen), None)
        if run.pressure in (None, at) or run.loading().control() is None:
            return None
        return f"{run.specimen}-at-p{run.pressure / 1e3:.10g}kPa-{run.engine}"


RESERVED = re.compile(r".*-at-p[0-9.e+-]+kPa-(yade|fused)")  # names of Campaign.consolidation

COMMON = {"settings": choice(tuple(SETTINGS)), "engine": choice(ENGINES), "threads": whole}
SPECIMEN = {
    "void_ratio": number, "step1_friction": number, "step1_rolling_friction": number, "side": quantity("length"),
    "grains": whole, "seed": whole, "law": choice(LAWS), "time_step_factor": number, **COMMON,
}  # fmt: skip
CONSOLIDATED = {"from": word, "pressure": quantity("pressure"), "engine": COMMON["engine"], "threads": whole}
RUN = {
    "path": choice(tuple(PATHS)), "specimen": word, "pressure": quantity("pressure"), "strain": number,
    "rate": quantity("rate"), "reversals": number, "record_strain": number, "snapshots": whole,
    "law": choice(LAWS), "time_step_factor": number, **COMMON,
}  # fmt: skip
TOP = {"name": word, **COMMON, "time_step_factor": number, "snapshots": whole}
MULTIPLIED = {"specimens": ("seed",), "runs": ("specimen", "pressure", "engine")}  # keys that may be lists
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,59}")


class Mistakes:
    """Collects what is wrong in a file."""

    def __init__(self):
        self.found = []

    def add(self, line, text):
        if (line, text) not in self.found:
            self.found.append((line, text))

    @property
    def count(self):
        return len(self.found)

    def report(self, file):
        """One line per mistake, in the order of the file."""
        what = "a mistake" if self.count == 1 else f"{self.count} mistakes"
        lines = [f"{file} has {what}, nothing was started"]
        lines += [f"  line {line}: {text}" for line, text in sorted(self.found)[:MOST_MISTAKES]]
        return "\n".join(lines + ["  ..."] * (self.count > MOST_MISTAKES))


def read_campaign(file):
    """The Campaign in a file. Raises InputError that names every mistake with its line."""
    file = Path(file)
    mistakes = Mistakes()
    root = compose(file, mistakes)
    campaign = _campaign(root, file, mistakes) if root is not None else None
    if mistakes.count:
        raise InputError(mistakes.report(file))
    return campaign


def compose(file, mistakes):
    """The YAML node of the file, or None after a mistake of YAML. Raises InputError when it cannot be read."""
    try:
        import yaml
    except ImportError:
        raise InputError("a campaign needs PyYAML and Snakemake: pip install 'labkit[campaign]'") from None
    try:
        text = file.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{file} is not UTF-8 text: give a campaign file, see README.md") from None
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}): give a campaign file") from None
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        mistakes.add(mark.line + 1, f"this is not YAML: {error.problem}")
        return None
    except RecursionError:
        mistakes.add(1, "it is nested too deep: a campaign file has names, and values of these names")
        return None
    except yaml.YAMLError as error:
        mistakes.add(1, f"this is not YAML: {str(error).splitlines()[0]}")
        return None
    if root is None or root.id != "mapping":
        mistakes.add(1, "a campaign file holds `specimens:` and `runs:`, see README.md")
        return None
    return root


def line_of(node):
    return node.start_mark.line + 1


def entries(node, where, mistakes):
    """(key, key node, value node) of a mapping; twice the same key is a mistake."""
    if node.id != "mapping":
        mistakes.add(line_of(node), f"{where} is {_kind(node)}: write names and values, `key: value`")
        return []
    first = {}
    for key, value in node.value:
        if key.id != "scalar":
            mistakes.add(line_of(key), f"{where} has {_kind(key)} for a name: write a word")
        elif key.value in first:
            mistakes.add(line_of(key), f"{key.value!r} is there twice, first in line {line_of(first[key.value][1])}: "
                         "give another name")  # fmt: skip
        else:
            first[key.value] = key.value, key, value
    return list(first.values())


def _kind(node):
    empty = node.id == "scalar" and node.value == ""
    return "empty" if empty else {"scalar": "a single value", "sequence": "a list", "mapping": "a mapping"}[node.id]


@dataclasses.dataclass
class Fields:
    """The fields of one entry: name -> value (a list where it may be one), and their lines."""

    where: str
    line: int
    values: dict
    lines: dict
    broken: set  # names of fields that were given and could not be read

    def has(self, name):
        return name in self.values or name in self.broken


def read_fields(node, readers, where, mistakes, lists=(), sections=()):
    """Fields of a mapping; what is unknown or cannot be read is a mistake and is left out."""
    found = Fields(where, line_of(node), {}, {}, set())
    for name, key, value in entries(node, where, mistakes):
        if name in sections:
            continue
        found.lines[name] = line_of(key)
        if name not in readers:
            mistakes.add(line_of(key), f"{where}: {name!r} is unknown{similar(name, (*readers, *sections))}")
            continue
        if value.id == "sequence" and name in lists:
            nodes = value.value
            if not nodes:
                mistakes.add(line_of(value), f"{where}: {name} is an empty list: give a value, or leave it out")
        else:
            nodes = [value]
        read = [_read(item, readers[name], f"{where}: {name}", mistakes) for item in nodes]
        if not read or None in read:
            found.broken.add(name)
        elif len(set(read)) < len(read) and name != "reversals":
            mistakes.add(line_of(value), f"{where}: {name} has the same value twice: leave one out")
            found.broken.add(name)
        else:
            found.values[name] = read if value.id == "sequence" and name in lists else read[0]
    return found


def _read(node, reader, where, mistakes):
    if node.id != "scalar":
        mistakes.add(line_of(node), f"{where} is {_kind(node)}: give one value")
    elif node.value == "" or node.tag.endswith(":null"):
        mistakes.add(line_of(node), f"{where} is empty: give a value, or leave it out")
    else:
        try:
            return reader(node.value)
        except ValueError as error:
            mistakes.add(line_of(node), f"{where}: {error}")
    return None


def similar(name, known):
    close = difflib.get_close_matches(name, known, 1)
    return f": did you mean {close[0]!r}?" if close else f": use {', '.join(known)}"


def checked(function, where, line, mistakes):
    """What `function` returns, or None after its InputError became a mistake."""
    try:
        return function()
    except InputError as error:
        text = re.sub(r"--([a-z0-9-]+)", lambda match: match[1].replace("-", "_"), str(error))
        mistakes.add(line, f"{where}: {text}")
        return None


def _campaign(root, file, mistakes):
    sections = {name: node for name, _, node in entries(root, "the file", Mistakes())}
    top = read_fields(root, TOP, "the file", mistakes, sections=("specimens", "runs"))
    name = top.values.pop("name", file.stem)
    if not NAME.fullmatch(name):
        line = top.lines.get("name", 1)
        mistakes.add(line, f"the name {name!r} makes no name of a folder: use letters, digits, _ . -")
    _check_common(top, mistakes)
    if "time_step_factor" in top.values:
        factor = top.values["time_step_factor"]
        if not checked(lambda: Scene(time_step_factor=factor), "the file", top.lines["time_step_factor"], mistakes):
            del top.values["time_step_factor"]
    for section in ("specimens", "runs"):
        if section not in sections:
            mistakes.add(1, f"`{section}:` is missing: add it, see README.md")
    defaults = {key: value for key, value in top.values.items() if key != "snapshots"}
    groups, made, consolidated = _specimens(sections.get("specimens"), defaults, mistakes)
    runs = _runs(sections.get("runs"), top.values, groups, mistakes)
    campaign = Campaign(name, tuple(made), tuple(consolidated), tuple(run for run, _ in runs))
    for run, line in runs:
        _check_run(campaign, run, line, mistakes)
    return campaign


def _named(node, section, mistakes):
    """(name, line, node) of the entries of a section."""
    found = entries(node, f"`{section}:`", mistakes) if node is not None else []
    if node is not None and node.id == "mapping" and not found:
        mistakes.add(line_of(node), f"`{section}:` is empty: add one")
    for name, key, value in found:
        if NAME.fullmatch(name):
            yield name, line_of(key), value
        else:
            said = f"the name {name!r} makes no name of a file: use up to 60 letters, digits, _ . -"
            mistakes.add(line_of(key), said)


def _check_common(fields, mistakes):
    """Threads and snapshots, which no class of labkit judges."""
    for name, least, most in (("threads", 1, MOST_THREADS), ("snapshots", 0, 10**6)):
        value = fields.values.get(name, least)
        if not least <= value <= most:
            mistakes.add(fields.lines[name], f"{fields.where}: {name} {value} is not possible: give {least} to {most}")
            fields.broken.add(name)
            del fields.values[name]


def _specimens(node, defaults, mistakes):
    """Groups (name in the file -> names made of it, None after a mistake), Specimens, Consolidated."""
    groups, made, entries_from = {}, [], {}
    lines = {}
    for name, line, value in _named(node, "specimens", mistakes):
        groups[name], lines[name] = None, line
        if value.id == "mapping" and any(key.value == "from" for key, _ in value.value):
            entries_from[name] = read_fields(value, CONSOLIDATED, f"specimen {name}", mistakes)
            entries_from[name].line = line
            continue
        fields = read_fields(value, SPECIMEN, f"specimen {name}", mistakes, MULTIPLIED["specimens"])
        fields.line = line
        items = _made(name, fields, defaults, mistakes)
        groups[name] = [item.name for item in items] or None
        made += items
    for name, fields in entries_from.items():
        _check_consolidated(fields, groups, mistakes)
    sources = {name: fields.values.get("from") for name, fields in entries_from.items()}
    cyclic = _cycles(sources, lines, mistakes)
    consolidated = []
    waiting = [name for name in sources if name not in cyclic]
    while waiting:  # sources before what is made of them
        name = next(one for one in waiting if sources[one] not in waiting)
        waiting.remove(name)
        items = _consolidated(name, entries_from[name], groups, defaults)
        groups[name] = [item.name for item in items] or None
        consolidated += items
    named = [(one, lines[name]) for name, ones in groups.items() for one in ones or []]
    for one, line in named:
        if RESERVED.fullmatch(one):
            mistakes.add(line, f"specimen {one}: labkit names consolidations of its own so: give another name")
    _unique(named, "specimen", mistakes)
    origins = {item.name: item for item in made}
    for item in consolidated:
        origins[item.name] = origins[item.source]
        line = dict(named)[item.name]
        checked(lambda: require_law(item.engine, origins[item.name].scene), f"specimen {item.name}", line, mistakes)
    return groups, made, consolidated


def _made(name, fields, defaults, mistakes):
    """The Specimens of one entry, one for each seed; none when something is wrong with it."""
    before, where, values = mistakes.count, fields.where, fields.values
    _check_common(fields, mistakes)
    if not fields.has("void_ratio"):
        mistakes.add(fields.line, f"{where}: void_ratio is missing: give it, e.g. 0.67")
    if fields.has("side") and fields.has("grains"):
        mistakes.add(fields.lines["grains"], f"{where}: side and grains are both given: leave one out")
    for key, value in values.items():
        line = fields.lines[key]
        if key == "grains" and not MINIMUM_GRAINS <= value <= MOST_GRAINS:
            mistakes.add(line, f"{where}: grains {value} are not possible: give {MINIMUM_GRAINS} to {MOST_GRAINS}")
        elif key in ("void_ratio", "step1_friction", "step1_rolling_friction", "side", "seed"):
            for one in _listed(value):
                checked(lambda: Recipe(**{"void_ratio": 0.67, key: one}), where, line, mistakes)
        elif key in ("law", "time_step_factor"):
            checked(lambda: Scene(**{key: value}), where, line, mistakes)
    if mistakes.count > before or fields.broken:
        return []
    seeds = values.pop("seed", Recipe.seed)
    specimen = Specimen(name=name, **{**defaults, **values})
    if not MINIMUM_GRAINS <= specimen.expected_grains <= MOST_GRAINS:
        least, most = (side_for(n, specimen.void_ratio, specimen.scene) * 1e3 for n in (MINIMUM_GRAINS, MOST_GRAINS))
        said = f"{where}: side for {specimen.expected_grains} grains: give {least:.2g} to {most:.2g} mm, or grains"
        mistakes.add(fields.lines.get("side", fields.line), said)
        return []
    engine_line = fields.lines.get("engine", fields.lines.get("law", fields.line))
    checked(lambda: require_law(specimen.engine, specimen.scene), where, engine_line, mistakes)
    if isinstance(seeds, list):
        return [dataclasses.replace(specimen, name=f"{name}-s{seed}", seed=seed) for seed in seeds]
    return [dataclasses.replace(specimen, seed=seeds)]


def _check_consolidated(fields, groups, mistakes):
    where, source, pressure = fields.where, fields.values.get("from"), fields.values.get("pressure")
    _check_common(fields, mistakes)
    if not fields.has("pressure"):
        mistakes.add(fields.line, f"{where}: pressure is missing: give it, e.g. 0.5 MPa")
    if pressure is not None:
        checked(lambda: make_path("cr", pressure=pressure), where, fields.lines["pressure"], mistakes)
    if source is not None and source not in groups:
        mistakes.add(fields.lines["from"], f"{where}: there is no specimen {source!r}{similar(source, tuple(groups))}")


def _consolidated(name, fields, groups, defaults):
    """The Consolidated of one entry: as many as its source has names; none when something is wrong with it."""
    source, pressure = fields.values.get("from"), fields.values.get("pressure")
    if fields.broken or pressure is None or not groups.get(source):
        return []
    known = {key: fields.values.get(key, defaults.get(key)) for key in ("engine", "threads")}
    chosen = {key: value for key, value in known.items() if value is not None}
    if groups[source] == [source]:
        return [Consolidated(name, source, pressure, **chosen)]
    return [Consolidated(name + one.removeprefix(source), one, pressure, **chosen) for one in groups[source]]


def _runs(node, defaults, groups, mistakes):
    """(Run, line) of every run, lists multiplied out."""
    found = []
    for name, line, value in _named(node, "runs", mistakes):
        where = f"run {name}"
        fields = read_fields(value, RUN, where, mistakes, (*MULTIPLIED["runs"], "reversals"))
        fields.line = line
        _check_common(fields, mistakes)
        for needed, example in (("path", "cv"), ("specimen", next(iter(groups), "dense"))):
            if not fields.has(needed):
                mistakes.add(line, f"{where}: {needed} is missing: give it, e.g. {example}")
        specimens = _listed(fields.values.pop("specimen", []))
        for one in specimens:
            if one not in groups:
                said = f"{where}: there is no specimen {one!r}{similar(one, tuple(groups))}"
                mistakes.add(fields.lines["specimen"], said)
        _check_fields(fields, mistakes)
        names = [item for one in specimens for item in groups.get(one) or []]
        if not fields.broken and "path" in fields.values:
            found += [(run, line) for run in _multiplied(name, fields.values, names, defaults)]
    if len(found) > MOST_RUNS:
        mistakes.add(found[-1][1], f"there are {len(found)} runs: give at most {MOST_RUNS} in one campaign")
        return []
    _unique([(run.name, line) for run, line in found], "run", mistakes)
    return found


def _listed(value):
    return value if isinstance(value, list) else [value]


def _check_fields(fields, mistakes):
    """Every field of a run by itself, so that one mistake does not hide another."""
    path, where = fields.values.get("path"), fields.where
    before = mistakes.count
    for key, value in list(fields.values.items()):
        line = fields.lines[key]
        if key in ("pressure", "strain", "rate", "reversals") and path:
            for one in [tuple(_listed(value))] if key == "reversals" else _listed(value):
                checked(lambda: make_path(path, 0.5e6, **{key: one}), where, line, mistakes)
        elif key == "record_strain" and not 0.0 < value <= 1.0:
            mistakes.add(line, f"{where}: record_strain {value:g} is not possible: give e.g. 1e-3")
        elif key == "time_step_factor":
            checked(lambda: Scene(time_step_factor=value), where, line, mistakes)
    if mistakes.count > before:
        fields.broken.add("path")


def _multiplied(name, values, specimens, defaults):
    """Runs of all specimens, pressures and engines; a name says what there are several of."""
    values = {**defaults, **values}
    if "reversals" in values:
        values["reversals"] = tuple(_listed(values["reversals"]))
    pressures, engines = (values.pop(key, None) for key in ("pressure", "engine"))
    for specimen, pressure, engine in itertools.product(specimens, _listed(pressures), _listed(engines)):
        words = [name] + [specimen] * (len(specimens) > 1)
        words += [f"p{pressure / 1e3:g}kPa"] if isinstance(pressures, list) else []
        words += [engine] if isinstance(engines, list) else []
        chosen = {"engine": engine} if engine else {}
        yield Run(name="-".join(words), specimen=specimen, pressure=pressure, **values, **chosen)


def _unique(named, what, mistakes):
    first = {}
    for name, line in named:
        if name in first:
            mistakes.add(line, f"{what} {name} is made twice, also in line {first[name]}: give another name")
        first.setdefault(name, line)


def _cycles(sources, lines, mistakes):
    """Names of specimens that are made of themselves, or of such. `sources`: name -> name."""
    cyclic = set()
    for name in sources:
        way = [name]
        while sources.get(way[-1]) in sources and sources[way[-1]] not in way:
            way.append(sources[way[-1]])
        if sources.get(way[-1]) in way:
            cyclic.add(name)
            loop = way[way.index(sources[way[-1]]) :]
            if name == min(loop, key=lambda one: lines[one]):
                said = " from ".join([*loop, loop[0]])
                mistakes.add(lines[name], f"specimen {name} is made of itself ({said}): begin with a void ratio")
    return cyclic


def _check_run(campaign, run, line, mistakes):
    """What needs the specimen too: the law, and steps that fit the path."""
    origin, where = campaign.origin(run.specimen), f"run {run.name}"
    checked(lambda: require_law(run.engine, run.scene(origin)), where, line, mistakes)
    if campaign.consolidation(run):
        checked(lambda: require_law(run.engine, origin.scene), f"{where}, its consolidation", line, mistakes)
    checked(lambda: schedule_of(run, origin), where, line, mistakes)


def schedule_of(run, specimen):
    """The Schedule of a Run of a Specimen: how many steps and records. Raises InputError when they do not fit."""
    path = run.loading()
    return Schedule.of(
        path, run.scene(specimen).time_step, specimen.expected_grains, run.record_strain or path.record_strain,
        run.snapshots,
    )  # fmt: skip
