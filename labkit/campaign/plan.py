"""The jobs of a campaign: commands of labkit with the files that they read and write, in folders of the campaign.

    specimens/    state files, made or consolidated     runs/         run files, finished ones only
    unfinished/   what a run has so far                  statistics/   a netCDF file with a row per run
    figures/      of each run                            recipes/      a JSON file per job: what decides its result
    logs/         what each job said                     report.md     all runs in one page, with provenance

A recipe is written only when it changes, so that whoever compares times of files repeats what depends on it alone.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path

from labkit.campaign.file import Campaign, Consolidated, Run, Specimen

STATES, RUNS, UNFINISHED, STATISTICS, FIGURES = "specimens", "runs", "unfinished", "statistics", "figures"
OUTDATED = "outdated"  # what was made with other parameters
RECIPES, LOGS, REPORT = "recipes", "logs", "report.md"
CAMPAIGN = "campaign.yaml"  # a copy of the file
FOLDERS = (STATES, RUNS, UNFINISHED, STATISTICS, FIGURES, RECIPES, LOGS)


@dataclasses.dataclass(frozen=True)
class Job:
    """One command. `kind`: specimen, consolidation or run. `words`: the command without its files; `source`: the
    state file that it starts from. Files are relative to the folder of the campaign."""

    kind: str
    name: str
    words: tuple[str, ...]
    output: str
    source: str | None
    threads: int
    item: Specimen | Consolidated | Run
    digest: str  # of all that decides the result, the jobs before it among them

    @property
    def recipe(self):
        return f"{RECIPES}/{self.kind}.{self.name}.json"

    @property
    def log(self):
        return f"{LOGS}/{self.kind}.{self.name}.log"

    @property
    def unfinished(self):
        """Where it writes until it is finished: a name of its own for other parameters."""
        return f"{UNFINISHED}/{self.name}.{self.digest[:12]}.{self.ending}"

    @property
    def ending(self):
        return "run.nc" if self.kind == "run" else "state.nc"

    @property
    def command(self):
        """The words of labkit, as a person would type them in the folder."""
        first, *rest = self.words
        if self.kind == "run":
            return [first, rest[0], self.source, *rest[1:], "-o", self.unfinished]
        return [first, *([self.source] if self.source else []), *rest, "-o", self.unfinished]


@dataclasses.dataclass(frozen=True)
class Plan:
    """The jobs of a campaign in an order in which they could be done."""

    campaign: Campaign
    specimens: tuple[Job, ...]
    consolidations: tuple[Job, ...]
    runs: tuple[Job, ...]

    @property
    def jobs(self):
        return (*self.specimens, *self.consolidations, *self.runs)


def plan_of(campaign):
    """The Plan of a Campaign. Runs that hold the same stress share one consolidation of their specimen."""
    made = {item.name: _specimen_job(item) for item in campaign.specimens}
    consolidated = {}
    for item in campaign.consolidated:
        consolidated[item.name] = _consolidation_job(item, {**made, **consolidated}[item.source])
    runs = []
    for run in campaign.runs:
        start = {**made, **consolidated}[run.specimen]
        if name := campaign.consolidation(run):
            item = Consolidated(name, run.specimen, run.pressure, run.engine, run.threads)
            start = consolidated.setdefault(name, _consolidation_job(item, start))
        runs.append(_run_job(run, start))
    return Plan(campaign, tuple(made.values()), tuple(consolidated.values()), tuple(runs))


def _specimen_job(item):
    words = ["specimen", f"--void-ratio={item.void_ratio!r}", f"--step1-friction={item.step1_friction!r}",
             f"--step1-rolling-friction={item.step1_rolling_friction!r}", f"--seed={item.seed}", f"--law={item.law}",
             *_options(item, "side", "grains", "time_step_factor", "settings", "engine", "threads")]  # fmt: skip
    return _job("specimen", item, words, None)


def _consolidation_job(item, source):
    words = ["consolidate", f"--pressure={item.pressure!r}", *_options(item, "engine", "threads")]
    return _job("consolidation", item, words, source)


def _run_job(item, source):
    words = ["run", item.path, *_options(item, "pressure", "strain", "rate", "record_strain", "snapshots",
             "law", "time_step_factor", "settings", "engine", "threads")]  # fmt: skip
    if item.reversals:
        words.append("--reversals=" + ",".join(repr(value) for value in item.reversals))
    return _job("run", item, words, source)


def _options(item, *names):
    values = {name: getattr(item, name) for name in names}
    return [f"--{name.replace('_', '-')}={value}" for name, value in values.items() if value is not None]


def _job(kind, item, words, source):
    # The engine fused gives the same bits on any number of threads.
    decides = [word for word in words if not word.startswith("--threads=") or item.engine == "yade"]
    digest = hashlib.sha256(json.dumps([decides, source.digest if source else None]).encode()).hexdigest()
    output = f"{RUNS}/{item.name}.run.nc" if kind == "run" else f"{STATES}/{item.name}.state.nc"
    return Job(kind, item.name, tuple(words), output, source.output if source else None, item.threads, item, digest)


def write_recipes(plan, folder):
    """Makes the folders and writes the recipes that are not there or differ; removes those of jobs that are gone."""
    folder = Path(folder)
    for name in FOLDERS:
        (folder / name).mkdir(parents=True, exist_ok=True)
    wanted = {job.recipe for job in plan.jobs}
    for job in plan.jobs:
        file, text = folder / job.recipe, recipe_text(job)
        if not file.exists() or file.read_text() != text:
            _set_aside(folder, job)
            file.write_text(text)
    for file in (folder / RECIPES).glob("*.json"):
        if f"{RECIPES}/{file.name}" not in wanted:
            file.unlink()


def _set_aside(folder, job):
    """Moves what a job of that name made with other parameters into the folder OUTDATED: it is no result any more."""
    products = [f"{STATISTICS}/{job.name}.nc", f"{FIGURES}/{job.name}.png"] if job.kind == "run" else []
    for name in [job.output, *products]:
        if (folder / name).exists():
            (folder / OUTDATED).mkdir(exist_ok=True)
            (folder / name).replace(folder / OUTDATED / Path(name).name)


def recipe_text(job):
    words = [word for word in job.command if not word.startswith("--threads=") or job.item.engine == "yade"]
    known = {"command": ["labkit", *words], "digest": job.digest}
    return json.dumps(known, indent=1) + "\n"
