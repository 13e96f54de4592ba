"""Commands killed at random times and repeated until they end: `./lab fuzz --kills N`.

Each chain starts a command, kills it (SIGKILL) up to MOST times, then lets it end. After every kill the output must be
absent or readable, and must not have gone back. At the end it must equal, to the last bit, that of an uninterrupted
command (for the consolidation: in its stresses), the exit code must be the same, and no other file may be left.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import json
import os
import random
import shlex
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import netCDF4
import numpy as np

import labkit as lk
from analysis.fuzz.cases import be_quiet
from analysis.fuzz.inputs import GIVEN
from labkit.cli.dispatch import main as run_command
from labkit.files import file_sha256, labkit_kind

MOST = 5  # kills in a chain
LIMIT = 600.0  # time limit of a command, s
SAME_STRESS = 5e-3  # stress tolerance of an interrupted consolidation
SPECIMEN, LARGE = "s.state.nc", "large.state.nc"
GRAINS = {SPECIMEN: 200, LARGE: 6500}  # above 6,000 grains fused uses two threads, or two ranks
PATHS: dict[str, str] = GIVEN["kills"]["paths"]  # path -> words
BRIEF: dict[str, str] = GIVEN["kills"]["brief"]  # path -> words, for the larger specimen
OF_YADE = ("cv", "cp", "isoc", "cyclic_cp", "simple_shear")  # paths run on YADE; the others take too long there
RUNS = {  # engine -> (options, specimen, paths)
    "fused": (
        ("--threads 1", f"{SPECIMEN} --record-strain 1e-4", PATHS),
        ("--threads 1 --precision mixed", f"{SPECIMEN} --record-strain 1e-4", PATHS),
        ("--threads 2", f"{LARGE} --record-strain 2e-5", BRIEF),
        ("--threads 2 --precision mixed", f"{LARGE} --record-strain 2e-5", BRIEF),
    ),
    "yade": (("--threads 1", f"{SPECIMEN} --record-strain 1e-4", {name: PATHS[name] for name in OF_YADE}),),
}
OTHERS: list[str] = GIVEN["kills"]["others"]  # commands on the results of a run, with the output last


@dataclasses.dataclass(frozen=True)
class Job:
    """A command: its class in the table (`kind`), and its `words`, which end with the output, a file or a folder."""

    kind: str
    words: tuple[str, ...]

    @property
    def output(self) -> str:
        """Name of its output."""
        return self.words[-1]


def jobs(engine: str) -> list[Job]:
    """The commands that are run on an engine, and killed."""
    made = [Job("specimen", _words(f"specimen --void-ratio 0.66 --grains 200 --engine {engine} -o out.state.nc"))]
    made.append(Job("consolidate", _words(f"consolidate {SPECIMEN} --pressure 1MPa --engine {engine} -o out.state.nc")))
    for options, specimen, paths in RUNS[engine]:
        for name, words in paths.items():
            run = f"run {name} {specimen} {words} --save-every 2 --engine {engine} {options} -o out.run.nc"
            made.append(Job(f"run, {options.replace('--', '')}", _words(run)))
    if engine == "fused":
        made += [Job(words.split()[0], _words(words)) for words in OTHERS]
        made.append(Job("campaign", _words("campaign camp.yaml --cores 1 --folder camp")))
    return made


def _words(text: str) -> tuple[str, ...]:
    return tuple(shlex.split(text))


@dataclasses.dataclass
class Chain:
    """The history of a command: the number of kills that hit it, and anything that was wrong."""

    job: Job
    kills: int
    problems: list[str]

    def to_json(self) -> str:
        """This chain as a line."""
        return json.dumps([self.job.kind, self.job.words, self.kills, self.problems])

    @classmethod
    def from_json(cls, text: str) -> Chain:
        """The chain of a line."""
        kind, words, kills, problems = json.loads(text)
        return cls(Job(kind, tuple(words)), kills, problems)


@dataclasses.dataclass(frozen=True)
class Undisturbed:
    """Run a command without interruption; returns its output, its exit code and its duration, s."""

    output: Path
    code: int
    seconds: float


def chains(engine: str, kills: int, seed: int, known: Sequence[Chain] = ()) -> Iterator[Chain]:
    """Chains of all commands in turn until that many kills have hit one; `known`: the first ones, done before."""
    done = sum(chain.kills for chain in known)
    with tempfile.TemporaryDirectory(prefix="labkit-kills-") as name:
        folder = Path(name)
        if done < kills:
            prepare_folder(folder, engine)
        known_good: dict[Job, Undisturbed] = {}
        for number, job in enumerate(itertools.cycle(jobs(engine))):
            if number < len(known):
                yield known[number]
                continue
            if done >= kills:
                return
            if job not in known_good:
                known_good[job] = undisturbed(folder, job, len(known_good))
            chain = _chain(folder, job, known_good[job], random.Random(f"{seed} {number}"), min(MOST, kills - done))
            done += chain.kills
            yield chain


def prepare_folder(folder: Path, engine: str) -> None:
    """Specimens and a complete run, which also load the compiled code."""
    for file in GRAINS.keys() & {word for job in jobs(engine) for word in job.words}:
        state = lk.make_specimen(lk.Recipe(void_ratio=0.66, grains=GRAINS[file]), lk.Scene(), progress=False)
        lk.write_state(folder / file, state)
    state, path = lk.read_state(folder / SPECIMEN), lk.paths.ConstantVolume(strain=0.002)
    lk.run(state, path, progress=False, snapshots=2, engine=lk.Fused(precision="mixed"))
    lk.run(state, path, file=folder / "r.run.nc", progress=False, record_strain=1e-4, snapshots=12)
    (folder / "camp.yaml").write_text(GIVEN["kills"]["campaign"])
    for job in jobs(engine):
        if job.kind == "model":
            wait_for_job(start_job(job, _place(folder, "compiled")), LIMIT)


def undisturbed(folder: Path, job: Job, number: int) -> Undisturbed:
    """Run a command in a new folder with links to the inputs in a folder. Raises RuntimeError if it fails."""
    if not job.kind.startswith("run"):  # quick commands are timed once all their imports have been read from the disk
        wait_for_job(start_job(job, _place(folder, f"first{number}")), LIMIT)
    place = _place(folder, f"undisturbed{number}")
    start = time.monotonic()
    code = wait_for_job(start_job(job, place), LIMIT)
    if code not in (0, 1) or not (place / job.output).exists():
        raise RuntimeError(f"{shlex.join(job.words)} ended with {code}: {(place / 'said').read_text()}")
    return Undisturbed(place / job.output, code, time.monotonic() - start)


def _place(folder: Path, name: str) -> Path:
    """A new folder with links to the inputs."""
    place = folder / name
    place.mkdir()
    for file in folder.iterdir():
        if file.is_file():
            os.link(file, place / file.name)
    return place


def _chain(folder: Path, job: Job, expected: Undisturbed, chance: random.Random, most: int) -> Chain:
    """Kill a command up to `most` times, then let it end, and compare its output."""
    place, chain, steps = _place(folder, "killed"), Chain(job, 0, []), -1
    output, said = place / job.output, place / "said"
    for _ in range(most):
        child = start_job(job, place)
        code = wait_for_job(child, chance.uniform(0.0, 0.6) * expected.seconds)
        if code is not None:
            break
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        chain.kills += 1
        reached = steps_in(output)
        if reached < steps:
            chain.problems.append(f"lost: step {reached} after step {steps}")
        steps = reached
    else:
        code = wait_for_job(start_job(job, place), LIMIT)
    if code != expected.code:
        chain.problems.append(f"ended with {code}: {said.read_text()[-300:]}")
    elif not same_result(job, output, expected.output):
        chain.problems.append("another result")
    if left := sorted(names_in(place) ^ names_in(expected.output.parent)):
        chain.problems.append(f"left {left}")
    shutil.rmtree(place)
    return chain


def names_in(folder: Path) -> set[str]:
    """Names of all files in a folder, except logs of Snakemake, which have the time in their names."""
    files = (file.relative_to(folder) for file in folder.rglob("*") if file.is_file())
    return {str(file) for file in files if ".snakemake" not in file.parts}


def start_job(job: Job, place: Path, before: Callable[[], None] | None = None) -> int:
    """Start a command in a forked process in a folder; its messages go to the file `said`. Returns its number.

    before: called first in the process.
    """
    ending = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    signal.pthread_sigmask(signal.SIG_BLOCK, ending)  # the child must not use the handlers of this process
    child = os.fork()
    if child:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ending)
        return child
    try:
        for number in ending:
            signal.signal(number, signal.SIG_DFL if number != signal.SIGINT else signal.default_int_handler)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ending)
        os.chdir(place)
        if before is not None:
            before()
        be_quiet("said")
        os._exit(run_command(list(job.words)))
    finally:  # never return to the contexts of this process, which remove the folder
        os._exit(99)


def wait_for_job(child: int, seconds: float) -> int | None:
    """The exit code of a process; None if it still runs after some seconds."""
    end = time.monotonic() + seconds
    while True:
        number, status = os.waitpid(child, os.WNOHANG)
        if number:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > end:
            return None
        time.sleep(0.005)


def steps_in(output: Path) -> int:
    """Steps that a run file holds; -1 without one. Raises InputError if it is damaged."""
    if not output.exists() or labkit_kind(output) != "run":
        return -1
    return lk.read_state(output).step


def same_result(job: Job, output: Path, expected: Path) -> bool:
    """True if an output equals the undisturbed one."""
    if job.kind == "consolidate":
        found, wanted = (lk.love_stress(lk.read_state(file).snapshot()) for file in (output, expected))
        return bool(np.abs(found - wanted).max() < SAME_STRESS * np.abs(wanted).max())
    if output.is_dir():
        names = sorted(names_in(expected))
        if job.kind == "campaign":  # the statistics and the report contain the wall time of the run
            names = [name for name in names if name.endswith((".state.nc", ".run.nc"))]
        return all(_content(output / name) == _content(expected / name) for name in names)
    return _content(output) == _content(expected)


def _content(file: Path) -> object:
    """Return the part of a file that must be the same: data of labkit's files, pixels of a picture, or all bytes."""
    kind = labkit_kind(file)
    if kind == "state":
        return lk.read_state(file).digest()
    if kind is not None:
        with netCDF4.Dataset(file) as dataset:
            return dataset.data_sha256, kind == "run" and dataset.complete
    if file.suffix == ".png":
        return plt.imread(file).tobytes()
    return file_sha256(file)
