"""Commands killed at random times and repeated until they end: `./lab fuzz --kills N`.

Each chain starts a command, kills it (SIGKILL) up to MOST times, then lets it end. After every kill the output must be
absent or readable, and no earlier than before. At the end it must equal, to the last bit, that of a command which was
not interrupted (the consolidation: its stresses), and no other file may be left.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import random
import shlex
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import labkit as lk
from analysis.fuzz.cases import be_quiet
from labkit.cli.dispatch import main as run_command
from labkit.dem import read_checkpoint
from labkit.io import file_sha256, labkit_kind

MOST = 5  # kills in a chain
LIMIT = 600.0  # s, for a command
SAME_STRESS = 5e-3  # of a consolidation that was interrupted
SPECIMEN = "s.state.nc"
INPUTS = (SPECIMEN, "r.run.nc", "camp.yaml")
P = "--pressure 400kPa"
PATHS = {  # path -> words
    "cv": "--strain 0.004",
    "cr": f"{P} --strain 0.004",
    "cp": f"{P} --strain 0.004",
    "c1": f"{P} --strain 0.004",
    "isoc": "--pressure 1500kPa",
    "isod": "--pressure 300kPa --rate 5",
    "cyclic_cp": f"{P} --reversals 0.002,-0.001,0.001",
    "true_triaxial": f"{P} --strain 0.004 --b 0.5",
    "plane_strain": f"{P} --strain 0.004",
    "oedometer": "--strain 0.004",
    "simple_shear": f"{P} --strain 0.008",
    "simple_shear_cv": "--strain 0.008",
    "stress_rotation": f"{P} --strain 0.004",
    "proportional": "--strain 0.004",
    "isotropic_reloading": "--pressures 800kPa,500kPa --strain 0.01",
    "oedometer_reloading": "--stresses 800kPa,500kPa --strain 0.02",
    "undrained_cycles": f"{P} --amplitude 20kPa --cycles 2",
    "drained_cycles": f"{P} --amplitude 20kPa --cycles 2",
    "strain_cycles": f"{P} --strain-amplitude 0.001 --cycles 2",
    "shear_cycles": f"{P} --strain-amplitude 0.001 --cycles 2",
}
OPTIONS = {  # engine -> options of the runs
    "fused": ("--threads 1", "--threads 2", "--threads 1 --precision mixed", "--threads 2 --precision mixed"),
    "yade": ("--threads 1",),
}
OF_YADE = ("cv", "cp", "isoc", "cyclic_cp", "simple_shear")  # paths; the others take too long there
OTHERS = {  # commands on the results of a run -> words with the output last
    "figure": "figure test r.run.nc -o out.png",
    "export": "export r.run.nc -o out.csv",
    "model": "model cv --void-ratio 0.67 --pressure 400kPa --strain 0.1 -o out.run.nc",
}


CAMPAIGN = """\
name: camp
settings: quick
engine: fused
specimens: {dense: {void_ratio: 0.64, grains: 120}}
runs: {cv: {path: cv, specimen: dense, strain: 0.01}, cp: {path: cp, specimen: dense, pressure: 400 kPa, strain: 0.01}}
"""


@dataclasses.dataclass(frozen=True)
class Job:
    """A command. kind: its class in the table; words: with the output, a file or a folder, at the end."""

    kind: str
    words: tuple[str, ...]

    @property
    def output(self) -> str:
        """Name of its output."""
        return self.words[-1]


def jobs(engine: str) -> list[Job]:
    """All commands that are killed on an engine."""
    made = [Job("specimen", _words(f"specimen --void-ratio 0.66 --grains 200 --engine {engine} -o out.state.nc"))]
    made.append(Job("consolidate", _words(f"consolidate {SPECIMEN} --pressure 1MPa --engine {engine} -o out.state.nc")))
    for options in OPTIONS[engine]:
        for name in PATHS if engine == "fused" else OF_YADE:
            run = f"run {name} {SPECIMEN} {PATHS[name]} --record-strain 1e-4 --save-every 2 --engine {engine} {options}"
            made.append(Job(f"run, {options.replace('--', '')}", _words(f"{run} -o out.run.nc")))
    if engine == "fused":
        made += [Job(name, _words(words)) for name, words in OTHERS.items()]
        made.append(Job("campaign", _words("campaign camp.yaml --cores 1 --folder camp")))
    return made


def _words(text: str) -> tuple[str, ...]:
    return tuple(shlex.split(text))


@dataclasses.dataclass
class Chain:
    """What happened to a command: number of kills that hit it, and what was wrong."""

    job: Job
    kills: int
    problems: list[str]


def chains(engine: str, kills: int, seed: int) -> Iterator[Chain]:
    """Chains of all commands in turn until that many kills have hit one."""
    chance, done = random.Random(seed), 0
    with tempfile.TemporaryDirectory(prefix="labkit-kills-") as name:
        folder = Path(name)
        _prepare(folder, engine)
        undisturbed: dict[Job, tuple[Path, float]] = {}
        known = jobs(engine)
        while done < kills:
            for job in known:
                if job not in undisturbed:
                    undisturbed[job] = _undisturbed(folder, job, len(undisturbed))
                chain = _chain(folder, job, *undisturbed[job], chance, min(MOST, kills - done))
                done += chain.kills
                yield chain
                if done >= kills:
                    return


def _prepare(folder: Path, engine: str) -> None:
    """A specimen and a complete run, which also load the compiled code."""
    state = lk.make_specimen(lk.Recipe(void_ratio=0.66, grains=200), lk.Scene(), progress=False)
    lk.write_state(folder / SPECIMEN, state)
    for precision in ("double", "mixed"):
        path = lk.paths.ConstantVolume(strain=0.002)
        lk.run(state, path, file=folder / f"{precision}.run.nc", progress=False, snapshots=2, precision=precision)
    shutil.copy(folder / "double.run.nc", folder / "r.run.nc")
    (folder / "camp.yaml").write_text(CAMPAIGN)


def _undisturbed(folder: Path, job: Job, number: int) -> tuple[Path, float]:
    """The output of a command without interruption, and the seconds that it takes."""
    place = _place(folder, f"undisturbed{number}")
    start = time.monotonic()
    code = _wait(_start(job, place), LIMIT)
    if code != 0:
        raise RuntimeError(f"{shlex.join(job.words)} ended with {code}: {(place / 'said').read_text()}")
    return place / job.output, time.monotonic() - start


def _place(folder: Path, name: str) -> Path:
    """A new folder with links to the inputs."""
    place = folder / name
    place.mkdir()
    for file in INPUTS:
        os.link(folder / file, place / file)
    return place


def _chain(folder: Path, job: Job, expected: Path, seconds: float, chance: random.Random, most: int) -> Chain:
    """Kill a command up to `most` times, then let it end, and compare its output."""
    place, chain, steps = _place(folder, "killed"), Chain(job, 0, []), -1
    output = place / job.output
    for _ in range(most):
        child = _start(job, place)
        code = _wait(child, chance.uniform(0.0, 0.8) * seconds)
        if code is not None:
            chain.problems += [f"exit code {code}: {(place / 'said').read_text()[-300:]}"] * (code != 0)
            break
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        chain.kills += 1
        reached = _steps(output)
        if reached < steps:
            chain.problems.append(f"lost: step {reached} after step {steps}")
        steps = reached
    code = _wait(_start(job, place), LIMIT)
    if code != 0:
        chain.problems.append(f"ended with {code}: {(place / 'said').read_text()[-300:]}")
    elif not _same(job, output, expected):
        chain.problems.append("another result")
    if left := sorted(_names(place) ^ _names(expected.parent)):
        chain.problems.append(f"left {left}")
    shutil.rmtree(place)
    return chain


def _names(folder: Path) -> set[str]:
    """Names of all files in a folder, except logs of Snakemake, which have the time in their names."""
    files = (file.relative_to(folder) for file in folder.rglob("*") if file.is_file())
    return {str(file) for file in files if ".snakemake" not in file.parts}


def _start(job: Job, place: Path) -> int:
    """Start a command in a forked process in a folder; its messages go to the file `said`. Returns its number."""
    child = os.fork()
    if child:
        return child
    os.chdir(place)
    be_quiet("said")
    with contextlib.suppress(BaseException):
        os._exit(run_command(list(job.words)))
    os._exit(99)


def _wait(child: int, seconds: float) -> int | None:
    """The exit code of a process; None if it still runs after some seconds."""
    end = time.monotonic() + seconds
    while True:
        number, status = os.waitpid(child, os.WNOHANG)
        if number:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > end:
            return None
        time.sleep(0.005)


def _steps(output: Path) -> int:
    """Steps that a run file holds; -1 without one. Raises InputError if it is damaged."""
    if not output.exists() or labkit_kind(output) != "run":
        return -1
    return read_checkpoint(output).step


def _same(job: Job, output: Path, expected: Path) -> bool:
    """True if an output equals the undisturbed one."""
    if output.is_dir():
        return all(_digest(file) == _digest(expected / file.relative_to(output)) for file in output.rglob("*.run.nc"))
    kind = labkit_kind(output)
    if kind == "state":
        found, wanted = lk.read_state(output), lk.read_state(expected)
        if job.kind != "consolidate":
            return found.digest() == wanted.digest()
        stresses = [lk.love_stress(state.snapshot()) for state in (found, wanted)]
        return bool(np.abs(stresses[0] - stresses[1]).max() < SAME_STRESS * np.abs(stresses[1]).max())
    if kind == "run":
        digests = [_digest(file) for file in (output, expected)]
        return digests[0] == digests[1]
    return file_sha256(output) == file_sha256(expected)


def _digest(file: Path) -> tuple[str, bool]:
    """data_sha256 of a run, which covers all records and snapshots, and whether it is complete."""
    run = lk.Run.open(file)
    try:
        return str(run.data.attrs["data_sha256"]), run.complete
    finally:
        run.data.close()
