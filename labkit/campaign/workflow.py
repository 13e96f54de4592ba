"""Starts Snakemake on a campaign and says at the end what failed and why."""

from __future__ import annotations

import contextlib
import importlib.util
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from labkit.campaign.own_files import copy_campaign
from labkit.campaign.plan import FIGURES, LOGS, REPORT, STATISTICS, Plan, write_recipes
from labkit.dem.engine import Progress, silent
from labkit.engines import die_with_parent
from labkit.errors import InputError, Interrupted
from labkit.io.interruption import only_writer

HERE = Path(__file__).resolve().parent
SNAKEFILE = HERE / "Snakefile"
PROFILES = HERE / "profiles"
LOG = f"{LOGS}/snakemake.log"


def require_snakemake(profile: str | None = None) -> None:
    """Raises InputError with the way to get Snakemake, and SLURM's executor, unless they are there."""
    needed = ["snakemake"] + ["snakemake_executor_plugin_slurm"] * (profile == "slurm")
    if any(importlib.util.find_spec(name) is None for name in needed):
        raise InputError("Snakemake is not installed here: pip install 'labkit[campaign]' brings it")
    if profile is not None:
        profile_folder(profile)


def run_workflow(
    plan: Plan, text: str, folder: Path, cores: int, profile: str | None = None, progress: Progress = silent
) -> int:
    """Brings the campaign of that text up to date in its folder; returns Snakemake's exit code.

    `profile`: None for this computer, `slurm`, or the folder of a profile of Snakemake. Raises InputError when another
    process works in the folder.
    """
    require_snakemake(profile)
    folder.mkdir(parents=True, exist_ok=True)
    with alone_in(folder):
        write_recipes(plan, folder)
        copy_campaign(plan.campaign, text, folder)
        for job in plan.jobs:  # what is said of a failure must be of this time
            if not (folder / job.output).exists():
                (folder / job.log).unlink(missing_ok=True)
        return _watched(command(cores, profile), folder, progress)


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Raises InputError when another campaign is under way in the folder."""
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(only_writer(folder / "campaign"))
        except InputError:
            said = f"another campaign is under way in {folder}: wait for it, or give another --folder"
            raise InputError(said) from None
        yield


def _watched(words: Sequence[str], folder: Path, progress: Progress) -> int:
    """Runs Snakemake, tells `progress` how far it is and keeps what it says in its log; its exit code."""
    with open(folder / LOG, "w") as log:
        child = subprocess.Popen(
            words,
            cwd=folder,
            preexec_fn=die_with_parent,
            text=True,
            errors="replace",
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        try:
            for line in child.stdout or ():
                log.write(line)
                log.flush()
                done = re.match(r"(\d+) of (\d+) steps", line)
                if done:
                    progress(int(done[1]) / int(done[2]), f"{done[1]} of {done[2]} jobs done")
            return child.wait()
        except KeyboardInterrupt:  # the terminal sent it to the jobs too: they write their checkpoints
            child.wait()
            raise Interrupted(f"interrupted; the same command goes on from there ({folder})", 130) from None


def command(cores: int, profile: str | None) -> list[str]:
    """Snakemake's command line, for the folder of the campaign.

    Our own lock keeps a second one out and is gone with a killed process, as Snakemake's is not. A job moves its output
    into place as a whole, so that what Snakemake takes for incomplete after a kill is not.
    """
    arguments = [
        "--snakefile",
        str(SNAKEFILE),
        "--nolock",
        "--ignore-incomplete",
        "--keep-going",
        "--rerun-triggers",
        "mtime",
        "--quiet",
        "rules",
    ]
    if profile is None:
        arguments += ["--cores", str(cores)]
    else:
        arguments += ["--profile", str(profile_folder(profile))]
    return [sys.executable, "-m", "snakemake", *arguments]


def profile_folder(profile: str) -> Path:
    """The folder of a profile of Snakemake: one of labkit's by its name, or the user's own. Raises InputError."""
    for folder in (PROFILES / profile, Path(profile).resolve()):
        if (folder / "config.yaml").is_file():
            return folder
    known = ", ".join(sorted(file.name for file in PROFILES.iterdir()))
    raise InputError("is not a folder with a config.yaml", field="profile", value=profile, allowed=f"one, or {known}")


def tell(plan: Plan, folder: Path, code: int) -> int:
    """Says how the campaign stands after Snakemake's exit code; the exit code of the command."""
    failed, waiting = failures(plan, folder)
    for kind, name, reason in failed:
        print(f"labkit: {kind} {name} failed: {reason}", file=sys.stderr)
    if waiting:
        print(f"labkit: not begun{' because of these' * bool(failed)}: {', '.join(waiting)}", file=sys.stderr)
    there = sum((folder / job.output).exists() for job in plan.runs)
    print(f"{folder}: {there} of {len(plan.runs)} runs are finished; see {folder / REPORT}")
    if code and not failed:
        print(f"labkit: Snakemake ended with exit status {code}: see {folder / LOG}", file=sys.stderr)
    return 1 if failed or code else 0


def failures(plan: Plan, folder: str | Path) -> tuple[list[tuple[str, str, str]], list[str]]:
    """What is not there: (kind, name, reason) of the jobs that failed, names of those that were not begun."""
    folder = Path(folder)
    failed, waiting = [], []
    for job in plan.jobs:
        if (folder / job.output).exists():
            continue
        if (folder / job.log).exists():
            failed.append((job.kind, job.name, reason(folder / job.log)))
        else:
            waiting.append(job.name)
    for job in plan.runs:
        for kind, file in (("statistics", f"{STATISTICS}/{job.name}.nc"), ("figure", f"{FIGURES}/{job.name}.png")):
            if (folder / job.output).exists() and not (folder / file).exists():
                failed.append((kind, job.name, f"see {LOG}"))
    return failed, waiting


def reason(log: Path) -> str:
    """What a job said last, without labkit's name."""
    lines = log.read_text(errors="replace").strip().splitlines()
    said = [line for line in lines if line.startswith("labkit: ")]
    if said:
        return said[-1].removeprefix("labkit: ")
    return f"ended without a message, killed perhaps: see {log.name} in {LOGS}/"
