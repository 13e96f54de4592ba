"""Random commands, kills, full disks and damaged files in one folder: `./lab fuzz --soak MINUTES`.

Each round starts one of the commands of `kills` in the folder and does one thing to it, by seed: nothing, SIGKILL or
SIGTERM after a random time, a disk that is full beyond a random size, or bits flipped in a file of the folder before
it starts. After every round each file must be absent, or complete and match its hashes, or, if it was damaged here, be
refused; and no message may be a traceback. At the end every command must succeed in the same folder.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import random
import resource
import shlex
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import labkit as lk
from analysis.fuzz.kills import LIMIT, Job, jobs, names_in, prepare_folder, start_job, wait_for_job
from labkit.io import labkit_kind, open_netcdf

FAULTS = ("nothing", "SIGKILL", "SIGTERM", "full disk", "damage")
LONGEST = 4.0  # s until a kill
SIZES = (0, 300_000)  # bytes that a file may have on a full disk
CODES = {  # -15: before labkit catches signals
    "nothing": (0, 1),
    "SIGKILL": (-9, 0, 1),
    "SIGTERM": (143, -15, 0, 1),
    "full disk": (0, 1, 2),
    "damage": (0, 1, 2),
}


@dataclasses.dataclass
class Round:
    """A command, the fault injected, its exit code, and the problems afterwards."""

    job: Job
    fault: str
    code: int | None
    problems: list[str]


def rounds(minutes: float, seed: int) -> Iterator[Round]:
    """Run rounds in one folder for the given time, then every command once more, undisturbed."""
    chance, end = random.Random(seed), time.monotonic() + 60.0 * minutes
    with tempfile.TemporaryDirectory(prefix="labkit-soak-") as name:
        folder = Path(name)
        prepare_folder(folder, "fused")
        shutil.rmtree(folder / "compiled")  # contains links to the inputs
        known = [_named(job, number) for number, job in enumerate(jobs("fused")) if job.kind != "campaign"]
        inputs = {file.name: file.read_bytes() for file in folder.iterdir()}
        while time.monotonic() < end:
            yield _round(folder, chance.choice(known), chance.choice(FAULTS), chance, inputs)
        for job in known:
            _clear(folder, job)
            yield _round(folder, job, "nothing", chance, inputs)
        left = [name for name in names_in(folder) if name.endswith((".tmp", ".lock", ".consolidation"))]
        yield Round(Job("end", ("soak",)), "nothing", 0, [f"left {name}" for name in left])


def _named(job: Job, number: int) -> Job:
    """The command with its own output."""
    return dataclasses.replace(job, words=(*job.words[:-1], f"{number}.{job.output}"))


def _round(folder: Path, job: Job, fault: str, chance: random.Random, inputs: dict[str, bytes]) -> Round:
    hurt = None
    if fault == "damage" and (files := sorted(names_in(folder))):
        hurt = folder / chance.choice(files)
        content = bytearray(hurt.read_bytes())
        if content:
            content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
        hurt.write_bytes(content)
    limit = chance.randint(*SIZES) if fault == "full disk" else None
    child = start_job(job, folder, before=(lambda: _fill(limit)) if limit is not None else None)
    sent = fault in ("SIGKILL", "SIGTERM")
    code = wait_for_job(child, chance.uniform(0.0, LONGEST) if sent else LIMIT)
    if code is None:
        os.kill(child, signal.SIGKILL if not sent else getattr(signal, fault))
        code = wait_for_job(child, LIMIT) if sent else None
    said = (folder / "said").read_text(errors="replace") if (folder / "said").exists() else ""
    problems = [f"ended with {code}: {said[-300:]}"] if code not in CODES[fault] else []
    if "Traceback" in said:
        problems.append(said[max(0, said.index("Traceback") - 200) :][:1000])
    for name in names_in(folder):
        problems += faults_of(folder / name, hurt)
    if hurt is not None:  # the file is an input again, or deleted
        hurt.write_bytes(inputs[hurt.name]) if hurt.name in inputs else hurt.unlink(missing_ok=True)
    return Round(job, fault, code, problems)


def _fill(size: int) -> None:
    """Stop this process from writing files larger than a size."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def faults_of(file: Path, hurt: Path | None) -> list[str]:
    """The faults of a file, one sentence each."""
    if not file.name.endswith(".nc") or file.name.startswith("."):
        return [f"{file.name} is empty"] * (file.is_file() and not file.stat().st_size and _is_output(file, hurt))
    try:
        kind = labkit_kind(file)
        if kind is None:
            raise lk.InputError(f"{file.name} is not a labkit file")
        with open_netcdf(file, kind):
            return []
    except lk.InputError as error:
        return [] if file == hurt else [str(error)]


def _is_output(file: Path, hurt: Path | None) -> bool:
    return file != hurt and file.name[:1].isdigit()


def _clear(folder: Path, job: Job) -> None:
    output = folder / job.output
    if output.is_dir():
        shutil.rmtree(output)
    with contextlib.suppress(FileNotFoundError, IsADirectoryError):
        output.unlink()


def told(one: Round) -> str:
    """A round with its problems, for the log."""
    return f"{shlex.join(one.job.words)} ({one.fault}) ended with {one.code}: {'; '.join(one.problems)}"
