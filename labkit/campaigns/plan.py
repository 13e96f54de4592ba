"""The jobs of a campaign: commands of labkit with the files that they read and write, in the campaign folder.

    specimens/    state files, made or consolidated     runs/         run files of finished runs
    unfinished/   state and run files in progress       statistics/   a netCDF file per run
    figures/      a figure per run                      recipes/      a JSON file per job: what determines its result
    logs/         the output of each job                report.md     all runs on one page, with provenance
    extensions/   user-supplied files (`use:`)         outdated/     results of earlier parameters

A recipe is rewritten only if it changes, so that tools that compare file times rerun only the jobs that depend on it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from labkit.campaigns import keys
from labkit.campaigns.file import CAMPAIGN, FOLDER
from labkit.campaigns.items import Campaign, Consolidated, Item, PlannedRun, Specimen
from labkit.engines import ENGINES
from labkit.errors import InputError, option_name
from labkit.extensions import is_labkits
from labkit.grains.scene import Scene
from labkit.io.atomic import write_text
from labkit.io.hashes import file_sha256
from labkit.io.provenance import BESIDE
from labkit.parameters import Parameter, with_unit
from labkit.records.schedule import Options
from labkit.specimens.specimen import Recipe

STATES, RUNS, UNFINISHED, STATISTICS, PLOTS = "specimens", "runs", "unfinished", "statistics", "figures"
OUTDATED = "outdated"  # results of earlier parameters
SNAKEMAKE = ".snakemake"  # Snakemake's notes, and places from which it would load plugins
RECIPES, LOGS, REPORT, OVERVIEW = "recipes", "logs", "report.md", "overview.png"
FOLDERS = (STATES, RUNS, UNFINISHED, STATISTICS, PLOTS, RECIPES, LOGS)
OTHERS = (OUTDATED, FOLDER, CAMPAIGN, REPORT, f"{REPORT}{BESIDE}", OVERVIEW, SNAKEMAKE)
SETTINGS = (".numba_config.yaml", "matplotlibrc", "ucx.conf")  # libraries read these in the folder of a job


@dataclasses.dataclass(frozen=True, eq=False)
class Job:
    """One command of labkit; its files are relative to the campaign folder.

    Args:
        kind: specimen, consolidation or run.
        arguments: Arguments of the command, without its files.
        source: State or run file from which it starts.
        extensions: Hashes of the user-supplied files on which its result depends.
        digest: Hash of everything that determines its result, including the jobs on which it depends.
    """

    kind: str
    name: str
    arguments: tuple[str, ...]
    output: str
    source: str | None
    threads: int
    item: Item
    extensions: tuple[str, ...]
    digest: str

    @property
    def ranks(self) -> int:
        """Number of MPI ranks, 1 for an engine with threads."""
        return self.threads if ENGINES[self.item.engine].abilities.parallel == "ranks" else 1

    @property
    def recipe(self) -> str:
        """Path of the recipe file."""
        return f"{RECIPES}/{self.kind}.{self.name}.json"

    @property
    def inputs(self) -> list[str]:
        """Paths of the recipe and of the source, if there is one."""
        return [self.recipe, *filter(None, [self.source])]

    @property
    def log(self) -> str:
        """Path of the log file."""
        return f"{LOGS}/{self.kind}.{self.name}.log"

    @property
    def unfinished(self) -> str:
        """Path of the unfinished result, which differs for different parameters."""
        return f"{UNFINISHED}/{self.name}.{self.digest[:12]}.{self.ending}"

    @property
    def ending(self) -> str:
        """Extension of the job's output file."""
        return "run.nc" if self.kind == "run" else "state.nc"

    @property
    def command(self) -> list[str]:
        """The command line after `labkit`, as typed in the campaign folder."""
        first, *rest = self.arguments
        if self.kind == "run":
            return [first, rest[0], str(self.source), *rest[1:], "-o", self.unfinished]
        return [first, *([self.source] if self.source else []), *rest, "-o", self.unfinished]


@dataclasses.dataclass(frozen=True)
class Plan:
    """The jobs of a campaign, each after the jobs that it depends on."""

    campaign: Campaign
    specimens: tuple[Job, ...]
    consolidations: tuple[Job, ...]
    runs: tuple[Job, ...]

    @property
    def jobs(self) -> tuple[Job, ...]:
        """All jobs."""
        return (*self.specimens, *self.consolidations, *self.runs)

    @property
    def engines(self) -> list[str]:
        """Names of the engines that the jobs need."""
        return sorted({job.item.engine for job in self.jobs})


def plan_of(campaign: Campaign) -> Plan:
    """Plan a Campaign. Runs of a specimen that hold the same stress share one consolidation."""
    hashes = tuple(map(file_sha256, campaign.use))
    made = {item.name: _specimen_job(item, hashes) for item in campaign.specimens}
    consolidated: dict[str, Job] = {}
    for item in campaign.consolidated:
        scene = campaign.origin(item.source).scene
        consolidated[item.name] = _consolidation_job(item, {**made, **consolidated}[item.source], scene, hashes)
    runs: dict[str, Job] = {}
    for run in campaign.runs:
        start, origin = {**runs, **made, **consolidated}[run.specimen], campaign.origin(run.specimen)
        name, pressure = campaign.consolidation(run), run.path.start_pressure()
        if name is not None and pressure is not None:
            item = Consolidated(
                name, run.specimen, pressure, engine=run.engine, threads=run.threads, precision=run.precision
            )
            start = consolidated.setdefault(name, _consolidation_job(item, start, origin.scene, hashes))
        runs[run.name] = _run_job(run, start, origin, hashes)
    return Plan(campaign, tuple(made.values()), tuple(consolidated.values()), tuple(runs.values()))


def _specimen_job(item: Specimen, hashes: tuple[str, ...]) -> Job:
    recipe = _options(keys.options_of(Recipe), vars(item.recipe))
    arguments = ["specimen", *recipe, *_options(keys.options_of(Scene), vars(item.scene), vars(Scene()))]
    return _job("specimen", item, arguments, None, _needed(item, item.scene, hashes))


def _consolidation_job(item: Consolidated, source: Job, scene: Scene, hashes: tuple[str, ...]) -> Job:
    arguments = ["consolidate", f"--pressure={_text(item.pressure, 'Pa')}"]
    return _job("consolidation", item, arguments, source, _needed(item, scene, hashes))


def _run_job(item: PlannedRun, source: Job, origin: Specimen, hashes: tuple[str, ...]) -> Job:
    known = keys.options_of(type(item.path))
    arguments = [
        "run",
        item.path.name,
        *_options(known, dataclasses.asdict(item.path), {name: one.default for name, one in known.items()}),
        *_options(keys.options_of(Options), vars(item.options)),
        *_options(keys.changes_of_runs(), vars(item.scene(origin)), vars(origin.scene)),
    ]
    return _job("run", item, arguments, source, hashes)  # every run records user-defined statistics


def _needed(item: Specimen | Consolidated, scene: Scene, hashes: tuple[str, ...]) -> tuple[str, ...]:
    """Return the hashes of the user-supplied files if the contact law or the engine is user-defined."""
    kinds = (type(scene.contact_law), ENGINES[item.engine])
    return () if all(map(is_labkits, kinds)) else hashes


def _options(
    known: Mapping[str, Parameter], values: Mapping[str, object], defaults: Mapping[str, object] = {}
) -> list[str]:
    """Return command-line options for the values that are not None and differ from the defaults."""
    return [
        f"{option_name(name)}={_text(values[name], one.unit)}"
        for name, one in known.items()
        if values[name] is not None and (name not in defaults or values[name] != defaults[name])
    ]


def _text(value: object, unit: str) -> str:
    """Format a value as the text of an option, to the last digit; a pressure has its unit."""
    if isinstance(value, tuple) and value and isinstance(value[0], dict):
        return json.dumps(value)
    if isinstance(value, tuple):
        return ",".join(_text(one, unit) for one in value)
    if unit == "Pa" and isinstance(value, float):
        return with_unit(value, unit).replace(" ", "")
    return value if isinstance(value, str) else repr(value)


def _job(kind: str, item: Item, arguments: list[str], source: Job | None, extensions: tuple[str, ...]) -> Job:
    arguments = [*arguments, f"--engine={item.engine}", f"--{ENGINES[item.engine].abilities.parallel}={item.threads}"]
    arguments += [] if item.precision == "double" else [f"--precision={item.precision}"]
    determining = [deciding(arguments, item.engine), source.digest if source else None, *extensions]
    digest = hashlib.sha256(json.dumps(determining).encode()).hexdigest()
    output = f"{RUNS}/{item.name}.run.nc" if kind == "run" else f"{STATES}/{item.name}.state.nc"
    before = source.output if source else None
    return Job(kind, item.name, tuple(arguments), output, before, item.threads, item, extensions, digest)


def deciding(arguments: list[str], engine: str) -> list[str]:
    """Return the arguments that determine the result.

    The number of threads is left out for the fused engine, whose results are bit-identical for any number of threads.
    """
    return [one for one in arguments if engine != "fused" or not one.startswith("--threads=")]


def require_campaign_folder(plan: Plan, folder: Path, others: Sequence[str] = ()) -> None:
    """Raise InputError if a folder holds files that a campaign would replace or delete but that no campaign wrote.

    Also if it holds links, or settings of libraries, which would act on its jobs. `others` are names of further files
    that the campaign writes there.
    """
    require_no_links(folder, others)
    for name in SETTINGS:
        if (folder / name).exists():
            raise InputError(f"{folder / name} would change what the jobs do: delete it, or choose another --folder")
    recipes = list((folder / RECIPES).glob("*.json"))
    own = {Path(job.recipe).name for job in plan.jobs}  # even one that a full disk left empty
    foreign = [file for file in recipes if file.name not in own and not _is_recipe(file)]
    if not recipes:
        within = (file for name in FOLDERS for file in (folder / name).rglob("*") if file.is_file())
        named = (folder / name for name in (REPORT, OVERVIEW, *others))
        foreign = [*(file for file in named if file.exists()), *within]
    if foreign:
        raise InputError(f"{foreign[0]} is not from a campaign, and could be replaced: choose another --folder")


def require_no_links(folder: Path, others: Iterable[str] = ()) -> None:
    """Raise InputError if one of the files and folders of a campaign, or of `others`, is a symbolic link."""
    for name in (*FOLDERS, *OTHERS, *others):
        within = (Path(place, one) for place, folders, files in os.walk(folder / name) for one in (*folders, *files))
        for file in (folder / name, *within):
            if file.is_symlink():
                raise InputError(f"{file} is a link, and could lead anywhere: delete it, or choose another --folder")


def _is_recipe(file: Path) -> bool:
    try:
        recipe = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(recipe, dict) and {"command", "digest"} <= recipe.keys()


def write_recipes(plan: Plan, folder: str | os.PathLike[str]) -> None:
    """Make the folders, write new and changed recipes, and remove recipes of jobs that are no longer planned.

    Raises InputError if the folder holds links.
    """
    folder = Path(folder)
    require_no_links(folder)
    for name in FOLDERS:
        (folder / name).mkdir(parents=True, exist_ok=True)
    wanted = {job.recipe for job in plan.jobs}
    for job in plan.jobs:
        file, text = folder / job.recipe, recipe_text(job)
        if not file.exists() or file.read_bytes() != text.encode():
            _set_aside(folder, job)
            write_text(file, text)
    for file in (folder / RECIPES).glob("*.json"):
        if f"{RECIPES}/{file.name}" not in wanted:
            file.unlink()
    files = [file for name in FOLDERS for file in (folder / name).iterdir()]
    leave_the_future(files, min((os.stat(file).st_mtime_ns for file in files if file.exists()), default=None))


def leave_the_future(files: Iterable[str | os.PathLike[str]], earlier: int | None = None) -> None:
    """Give files dated later than now, because a clock was set back, the present time or an `earlier` one, ns.

    Otherwise Snakemake deletes what was made from them as outdated, and can never finish.
    """
    now = time.time_ns()
    time_ns = now if earlier is None else min(now, earlier)
    for file in files:
        with contextlib.suppress(FileNotFoundError):  # another job has moved it
            if os.stat(file).st_mtime_ns > now:
                os.utime(file, ns=(time_ns, time_ns))


def _set_aside(folder: Path, job: Job) -> None:
    """Move the results of a job with earlier parameters into the folder OUTDATED."""
    products = [f"{STATISTICS}/{job.name}.nc", f"{PLOTS}/{job.name}.png"] if job.kind == "run" else []
    for name in [job.output, *products]:
        if (folder / name).exists():
            (folder / OUTDATED).mkdir(exist_ok=True)
            (folder / name).replace(folder / OUTDATED / Path(name).name)


def recipe_text(job: Job) -> str:
    """Return everything that determines the result of a job, as JSON."""
    recipe: dict[str, object] = {"command": ["labkit", *deciding(job.command, job.item.engine)], "digest": job.digest}
    if job.extensions:
        recipe["extensions"] = list(job.extensions)
    return json.dumps(recipe, indent=1) + "\n"
