"""Runs Snakemake on a campaign and finally reports what failed and why."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from labkit.engines.base import Progress, silent
from labkit.errors import InputError, notice
from labkit.files.atomic import name_file_in_errors, open_log
from labkit.plugins.campaigns import layout
from labkit.plugins.campaigns.file import Campaign, copy_campaign, to_write
from labkit.plugins.campaigns.plan import require_campaign_folder, write_plan
from labkit.process.children import start_child, without_current_folder
from labkit.process.extras import install_command
from labkit.process.interruption import is_being_written, only_writer, resumed_from

HERE = Path(__file__).resolve().parent
SNAKEFILE = HERE / "Snakefile"
PROFILES = HERE / "profiles"
LOG = f"{layout.LOGS}/snakemake.log"
PATIENCE = 20  # time for running jobs to write their checkpoints, s; batch systems kill after 30 s
FLAGS = "--nolock --ignore-incomplete --keep-going --rerun-triggers mtime --quiet rules"
HOMELESS = "--shared-fs-usage input-output persistence software-deployment sources storage-local-copies"


def require_snakemake(profile: str | None = None) -> None:
    """Raise InputError if Snakemake, or anything else that the profile needs, is not installed."""
    slurm = profile is not None and uses_slurm(profile)
    needed = ["snakemake"] + ["snakemake_executor_plugin_slurm"] * slurm
    if any(importlib.util.find_spec(name) is None for name in needed):
        raise InputError(f"Snakemake is not installed: install it with {install_command('campaign')}")
    if slurm and shutil.which("sbatch") is None:
        problem = "needs SLURM, but its command sbatch is not on the PATH of this computer"
        allowed = "it on a login node of the cluster, or leave it out to run the jobs here"
        raise InputError(problem, field="profile", value=profile, allowed=allowed)


def run_workflow(
    campaign: Campaign, text: str, folder: Path, cores: int, profile: str | None = None, progress: Progress = silent
) -> int:
    """Bring a campaign up to date in its folder, and return Snakemake's exit code.

    Raises InputError if another process is running a campaign in the folder, or if the folder holds files that no
    campaign has written, and Interrupted after Ctrl-C.

    Args:
        campaign: The jobs.
        text: Text of the campaign file.
        folder: Folder of the campaign.
        cores: Number of cores to use.
        profile: None for this computer, `slurm`, or the folder of a Snakemake profile.
        progress: Called with the progress.
    """
    require_snakemake(profile)
    require_campaign_folder(campaign, folder, list(to_write(campaign, text, folder)))
    folder.mkdir(parents=True, exist_ok=True)
    if is_being_written(folder / "campaign"):
        raise InputError(f"another campaign is running in {folder}: wait for it, or give another --folder")
    with only_writer(folder / "campaign"):
        copy_campaign(campaign, text, folder)
        for note in write_plan(campaign, folder):
            print(f"{folder}: {note}", flush=True)
        for job in campaign.jobs:  # so that the reason reported for a failure comes from this attempt
            if not (folder / layout.output_of(job)).exists():
                (folder / layout.log_of(job)).unlink(missing_ok=True)
        forget(folder / layout.SNAKEMAKE)
        environment = without_current_folder(os.environ)
        environment.pop("SNAKEMAKE_PROFILE", None)  # Snakemake would look for it in the folder first
        if profile is None:
            environment[layout.PROCESS] = str(os.getpid())
        return watch(snakemake_command(cores, profile), folder, progress, environment)


def forget(notes: Path) -> None:
    """Delete packages and pickles in Snakemake's folder: Snakemake would load them, and no campaign writes them."""
    for name in ("pip-deployments", "iocache"):
        shutil.rmtree(notes / name, ignore_errors=True)


def watch(command_line: Sequence[str], folder: Path, progress: Progress, environment: Mapping[str, str]) -> int:
    """Run Snakemake, report its progress and write its output to the log; returns its exit code.

    Snakemake and its jobs form a process group, so Ctrl-C reaches each of them exactly once.
    """
    with resumed_from(folder), name_file_in_errors(folder / LOG), open_log(folder / LOG) as log:
        child = start_child(
            command_line,
            cwd=folder,
            env=environment,
            process_group=0,
            text=True,
            errors="replace",
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
        except KeyboardInterrupt:
            notice("stopping; running jobs write their checkpoints")
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGINT)  # running jobs write their checkpoints
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.communicate(timeout=PATIENCE)
            if child.poll() is None:  # a batch system would soon kill everything, including this process
                os.killpg(child.pid, signal.SIGKILL)
                child.communicate()
            raise


def snakemake_command(cores: int, profile: str | None) -> list[str]:
    """Return Snakemake's command line, to be run in the campaign folder, from which it reads no settings.

    labkit's own lock keeps a second campaign out and, unlike Snakemake's, disappears if the process is killed. Jobs
    move their outputs into place atomically, so outputs that Snakemake considers incomplete after a kill are complete.
    """
    # HOMELESS: Snakemake stores no sources in the home folder, which some containers cannot write
    where = ["--profile", str(profile_folder(profile))] if profile else [*HOMELESS.split(), "--cores", str(cores)]
    program = [sys.executable, "-P", "-m", "snakemake", "--snakefile", str(SNAKEFILE)]
    return [*program, "--workflow-profile", "none", *FLAGS.split(), *where]


def uses_slurm(profile: str) -> bool:
    """Return True if a profile submits its jobs to SLURM. Raises InputError for an unknown profile."""
    text = (profile_folder(profile) / "config.yaml").read_text(encoding="utf-8", errors="replace")
    return re.search(r"""^executor:\s*["']?slurm\b""", text, re.MULTILINE) is not None


def profile_folder(profile: str) -> Path:
    """Return the folder of a Snakemake profile: one of labkit's, by name, or a user's. Raises InputError for others."""
    for folder in (PROFILES / profile, Path(os.path.realpath(profile))):
        if (folder / "config.yaml").is_file():
            return folder
    profiles = ", ".join(sorted(file.name for file in PROFILES.iterdir()))
    raise InputError(
        "is not a folder with a config.yaml", field="profile", value=profile, allowed=f"such a folder, or {profiles}"
    )


def tell(folder: Path, code: int) -> int:
    """Report the status of the campaign after Snakemake ended with `code`; returns the exit code of the command."""
    rows = layout.read_plan(folder)
    failed, waiting = failures(rows, folder)
    for kind, name, why in failed:
        notice(f"{kind} {name} failed: {why}")
    if waiting:
        because = " because of these failures" * bool(failed)
        notice(f"not started{because}: {', '.join(waiting)}")
    runs = [row for row in rows if row.kind == "run"]
    finished = sum((folder / layout.output_of(row)).exists() for row in runs)
    print(f"{folder}: {finished} of {len(runs)} runs are finished; see {folder / layout.REPORT}")
    if code and not failed:
        notice(f"Snakemake ended with exit status {code}: see {folder / LOG}")
    return 1 if failed or code else 0


def failures(rows: Sequence[layout.Row], folder: layout.Name) -> tuple[list[tuple[str, str, str]], list[str]]:
    """Return (kind, name, reason) of the jobs that failed, and names of those that were not started."""
    folder = Path(folder)
    failed: list[tuple[str, str, str]] = []
    waiting: list[str] = []
    for row in rows:
        if not (folder / layout.output_of(row)).exists():
            if (folder / layout.log_of(row)).exists():
                failed.append((row.kind, row.name, reason(folder / layout.log_of(row))))
            else:
                waiting.append(row.name)
            continue
        for kind, file in zip(("statistics", "figure"), layout.products_of(row), strict=False):
            if not (folder / file).exists():
                failed.append((kind, row.name, f"see {LOG}"))
    return failed, waiting


def reason(log: Path) -> str:
    """Return the last message of a job, without the prefix `labkit: `."""
    lines = log.read_text(errors="replace").strip().splitlines()
    messages = [line for line in lines if line.startswith("labkit: ") and not line.startswith("labkit: the cache")]
    if messages:
        return messages[-1].removeprefix("labkit: ")
    return f"ended without a message, perhaps killed: see {log.name} in {layout.LOGS}/"
