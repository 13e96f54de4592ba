"""Random commands and faults in one folder: `./lab fuzz --soak MINUTES`.

Each round starts one of the commands of `kills`, on fused, its ranks, YADE or LAMMPS, with spheres, clumps, bonds or
adhesion, or from an archive of the page, and does one thing of FAULTS to it, by seed. After every round each file must
be absent, or complete and match its hashes; no message may be a traceback; a run may not go back; a result must be that
of an undisturbed command, also if a file is damaged and not refused, except that an interrupted consolidation changes
its last bits; no process may be left; and a file of somebody else must be as it was. At the end every command must
succeed in the same folder.
"""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import functools
import json
import os
import random
import resource
import shlex
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import labkit as lk
from analysis.fuzz.inputs import GIVEN
from analysis.fuzz.kills import (
    LIMIT,
    Job,
    Undisturbed,
    jobs,
    names_in,
    prepare_folder,
    same_result,
    start_job,
    steps_in,
    undisturbed,
    wait_for_job,
)
from labkit.engines import yade_program
from labkit.files import hash_verdict, labkit_kind, open_netcdf
from labkit.process import lock_of

SIGNALS = ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP")  # to the command, to YADE or ranks, to one of these, or to all
STOPPED = ("stopped, continued", "stopped, SIGKILL", "stopped, SIGTERM")  # SIGSTOP first
FOREIGN = ("link as output", "link as lock", "read-only folder", "another user's folder")
FAULTS = ("nothing", *SIGNALS, *STOPPED, *FOREIGN, "two writers", "full disk", "damage")
SIZES = (0, 300_000)  # bytes that a file may have on a full disk
NOBODY = 65534
PRECIOUS = "precious"  # text of a file that no command may change
ENDED = {"SIGKILL": (-9,), "SIGTERM": (143, -15), "SIGINT": (130,), "SIGHUP": (129, -1)}  # -15: before labkit catches
REFUSED = ("full disk", "damage", "two writers", *FOREIGN)  # faults that may end with 2


@dataclasses.dataclass
class Round:
    """A command, the fault injected, its exit codes, the problems afterwards, and its duration, s."""

    words: Sequence[str]
    fault: str
    codes: list[int | None]
    problems: list[str]
    seconds: float = 0.0

    def to_json(self) -> str:
        """This round as a line."""
        return json.dumps(dataclasses.asdict(self))


def rounds(minutes: float, seed: int, known: Sequence[Round] = ()) -> Iterator[Round]:
    """Run rounds in one folder for the given time, then every command once more, undisturbed.

    known: the first rounds, done before; the rest of the time is that without them.
    """
    yield from known
    end = time.monotonic() + 60.0 * minutes - sum(one.seconds for one in known)
    with tempfile.TemporaryDirectory(prefix="labkit-soak-") as name:
        soak, number = Soak(Path(name)), len(known)
        while time.monotonic() < end:
            chance, begin = random.Random(f"{seed} {number}"), time.monotonic()
            one = soak.round(chance.choice(soak.jobs), chance.choice(FAULTS), chance)
            yield dataclasses.replace(one, seconds=time.monotonic() - begin)
            number += 1
        for job in soak.jobs:
            soak.clear(soak.place / job.output)
            yield soak.round(job, "nothing", random.Random(seed))
        left = [name for name in names_in(soak.place) if name.endswith((".tmp", ".lock", ".consolidation"))]
        yield Round(["end"], "nothing", [0], [f"left {name}" for name in left])


class Soak:
    """A folder with inputs, the commands that use them, and their undisturbed results.

    Args:
        folder: Folder of everything; the commands run in the folder `place` in it.
    """

    def __init__(self, folder: Path) -> None:
        """Make the inputs."""
        self.place, self._inputs, self._other = folder / "place", folder / "inputs", folder / "other"
        self._inputs.mkdir()
        prepare_folder(self._inputs, "fused")
        for words in GIVEN["soak"]["specimens"]:
            wait_for_job(start_job(Job("specimen", tuple(shlex.split(words))), self._inputs), LIMIT)
        (self._inputs / "said").unlink(missing_ok=True)
        self.place.mkdir()
        for file in self._inputs.glob("*.*"):
            shutil.copy2(file, self.place)
        yade = jobs("yade")[2:] if yade_program() else []
        own = [Job("run", (*shlex.split(words), "-o", "out.run.nc")) for words in GIVEN["soak"]["runs"]]
        others = [Job(words.split()[0], tuple(shlex.split(words))) for words in GIVEN["soak"]["others"]]
        known = [*jobs("fused"), *3 * yade, *2 * own, *others]  # the commands on YADE are few
        self.jobs = [named(job, number) for number, job in enumerate(known) if job.kind != "campaign"]
        self._good: dict[Job, Undisturbed] = {}
        self._rounded: set[Path] = set()  # outputs whose consolidation was interrupted: equal but for rounding errors

    def round(self, job: Job, fault: str, chance: random.Random) -> Round:
        """Run a command and do something to it; returns what became of it."""
        output, hurt = self.place / job.output, None
        if job not in self._good:
            self._good[job] = undisturbed(self._inputs, job, len(self._good))
        good = self._good[job]
        if fault in FOREIGN or chance.random() < 0.5:  # otherwise a run goes on where it was
            self.clear(output)
        if fault == "damage":
            hurt = self.damage(chance)
        goes_on = job.words[0] == "run" and hurt is None
        before = steps_in(output) if goes_on else -1
        if fault in FOREIGN:
            job = self.arrange(job, fault, chance)
        limit = chance.randint(*SIZES) if fault == "full disk" else None
        prepare: Callable[[], None] = be_ordinary if limit is None else functools.partial(fill, limit)
        children = [start_job(job, self.place, before=prepare)]
        family: set[int] = set()
        if fault == "two writers":
            time.sleep(chance.uniform(0.0, 1.5))
            children.append(start_job(job, self.place, before=prepare))
        elif fault in (*SIGNALS, *STOPPED):
            family = disturb(children[0], fault, chance, good.seconds)
        codes = [wait_for_job(child, LIMIT) for child in children]
        problems = self.problems(fault, codes)
        problems += [f"process {one} is left" for one in family if not has_ended(one)]
        for name in names_in(self.place):
            problems += faults_of(self.place / name, hurt)
        if fault in FOREIGN:
            problems += self.faults_of_others(job)
        elif not problems and (hurt is None or hurt.suffix == ".nc"):  # damage to a text may change a result
            if goes_on and steps_in(output) < before:
                problems.append(f"lost: step {steps_in(output)} after step {before}")
            if interim_of(output).exists():
                self._rounded.add(output)
            if 0 in codes and output not in self._rounded and not same_result(job, output, good.output):
                problems.append("another result")
        if hurt is not None:  # the file is an input again, or deleted
            known = self._inputs / hurt.name
            shutil.copy2(known, hurt) if known.exists() else hurt.unlink(missing_ok=True)
        if problems:
            self.clear(output)
        return Round(job.words, fault, codes, problems)

    def clear(self, output: Path) -> None:
        """Delete an output and its interrupted consolidation."""
        remove(output)
        remove(interim_of(output))
        self._rounded.discard(output)

    def problems(self, fault: str, codes: list[int | None]) -> list[str]:
        """What is wrong with the exit codes and the messages of commands."""
        said = (self.place / "said").read_text(errors="replace") if (self.place / "said").exists() else ""
        allowed = {0, 1, *ENDED.get(fault.rpartition(" ")[2], ()), *((2,) if fault in REFUSED else ())}
        found = [f"ended with {code}: {said[-300:]}" for code in codes if code not in allowed]
        if len(codes) == 2 and codes == [2, 2]:
            found.append("each of two writers refused")
        if "Traceback" in said:
            found.append(said[max(0, said.index("Traceback") - 200) :][:1000])
        return found

    def damage(self, chance: random.Random) -> Path:
        """Flip a bit, cut or empty a file of the folder, and return the file."""
        hurt = self.place / chance.choice(sorted(names_in(self.place)))
        content = bytearray(hurt.read_bytes())
        if content and chance.random() < 0.7:
            content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
        elif content:
            del content[chance.randrange(len(content)) :]
        hurt.write_bytes(content)
        return hurt

    def arrange(self, job: Job, fault: str, chance: random.Random) -> Job:
        """Put what belongs to somebody else in the way of an output, and return the command."""
        remove(self._other)
        self._other.mkdir()
        (self._other / "theirs").write_text(PRECIOUS)
        output = self.place / job.output
        if fault == "link as lock":
            lock_of(output).unlink(missing_ok=True)
            lock_of(output).symlink_to(self._other / "theirs")
        elif fault == "link as output":
            output.symlink_to(chance.choice([self._other / job.output, output, self._other, Path(os.devnull)]))
        else:
            mode = chance.choice([0o755, 0o777, 0o1777]) if fault != "read-only folder" else 0o555
            if os.getuid() == 0 and fault != "read-only folder":
                os.chown(self._other, NOBODY, NOBODY)
            self._other.chmod(mode)
            return dataclasses.replace(job, words=(*job.words[:-1], str(self._other / job.output)))
        return job

    def faults_of_others(self, job: Job) -> list[str]:
        """What a command has done to what belongs to somebody else, which is removed."""
        output = self.place / job.words[-1]
        text = (self._other / "theirs").read_text()
        found = [f"changed a file of somebody else: {text[:100]!r}"] * (text != PRECIOUS)
        found += [f"left {name}" for name in names_in(self._other) if name.endswith((".tmp", ".lock"))]
        for name in names_in(self._other):
            found += faults_of(self._other / name, None)
        for one in (output, lock_of(output)):
            if one.is_symlink():
                one.unlink()
        return found


def named(job: Job, number: int) -> Job:
    """The command with its own output."""
    return dataclasses.replace(job, words=(*job.words[:-1], f"{number}.{job.output}"))


def interim_of(output: Path) -> Path:
    """The file of an interrupted consolidation of a command with an output."""
    return output.with_name(f".{output.name}.consolidation")


def disturb(child: int, fault: str, chance: random.Random, usual: float) -> set[int]:
    """Send signals to a command, to the processes that it started, or to all; returns those processes.

    usual: duration of the undisturbed command, s.
    """
    if wait_for_start(child, chance.uniform(0.2 * (fault == "SIGINT"), max(0.3, 0.9 * usual))):
        return set()
    family = started_by(child)
    others = sorted(family)
    hit = chance.choice([[child], others, [child, *others], others and [chance.choice(others)]]) or [child]
    *stopped, last = fault.split(", ")
    if stopped:
        send(hit, "SIGSTOP")
        time.sleep(chance.uniform(0.1, 2.0))
    if last.startswith("SIG"):
        send(hit, last)
    if stopped:
        send(hit, "SIGCONT")
    return family


def wait_for_start(child: int, seconds: float) -> bool:
    """Wait some seconds; returns True if the process has ended before, and leaves its exit code to others."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT):
            return True
        time.sleep(0.005)
    return False


def send(processes: Sequence[int], name: str) -> None:
    """Send a signal to processes, some of which may have ended."""
    for process in processes:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, getattr(signal, name))


def started_by(process: int) -> set[int]:
    """The processes that a process and its children have started."""
    found: set[int] = set()
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{process}/task").iterdir():
            found |= {int(one) for one in (task / "children").read_text().split()}
    return found.union(*map(started_by, found))


def has_ended(process: int) -> bool:
    """True if a process ends within 30 s."""
    end = time.monotonic() + 30.0
    while time.monotonic() < end:
        try:
            if Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except OSError:
            return True
        time.sleep(0.05)
    return False


def be_ordinary() -> None:
    """Let the modes of files hold for this process even if it is root's (Linux)."""
    with contextlib.suppress(AttributeError):
        ctypes.CDLL(None).capset((ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)())


def fill(size: int) -> None:
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
            differs = file != hurt and hash_verdict(file) == "differs"
            return [f"{file.name}: other data than those of its hash"] * differs
    except lk.InputError as error:
        return [] if file == hurt else [str(error)]


def _is_output(file: Path, hurt: Path | None) -> bool:
    return file != hurt and file.name[:1].isdigit()


def remove(path: Path) -> None:
    """Delete a file, a link or a folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        path.chmod(0o700)
        shutil.rmtree(path)
    path.unlink(missing_ok=True)


def told(one: Round) -> str:
    """A round with its problems, for the log."""
    return f"{shlex.join(one.words)} ({one.fault}) ended with {one.codes}: {'; '.join(one.problems)}"
