"""Cases of damaged and hostile input, in forked processes, so that a crash or a hang is an outcome like any other."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
import json
import math
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import labkit as lk
from analysis.fuzz.damage import DAMAGES, DAMAGES_OF_TEXT, damaged
from analysis.fuzz.inputs import OLD, READERS, TEXTS, hostile_words, read_mutated_campaign
from labkit.cli.dispatch import main as run_command

LIMIT = 60.0  # s, after which a case hangs
GOOD = ("same", "used", "refused", "failed")  # outcomes that are as they should be


@dataclasses.dataclass(frozen=True)
class Case:
    """One input: its class (`kind`), the `seed` that makes it again, and `what` to keep if it fails, a file or text."""

    kind: str
    seed: int
    outcome: Callable[[], str]
    what: Callable[[], bytes]


def file_cases(files: Path, expected: dict[str, str], seed: int, kinds: Sequence[str]) -> Iterator[Case]:
    """Damaged files of these kinds (keys of READERS) in turn, without end."""
    contents = {name: (files / name).read_bytes() for name, _ in READERS.values()}
    for number in range(seed, sys.maxsize):
        for read in kinds:
            name = READERS[read][0]
            damages = list(DAMAGES_OF_TEXT if name in TEXTS else DAMAGES)
            damage = damages[number % len(damages)]
            made = functools.partial(damaged, contents[name], damage, number)
            outcome = functools.partial(_read_damaged, read, made, expected[read])
            yield Case(f"{read}: {damage}", number, outcome, made)


def _read_damaged(read: str, made: Callable[[], bytes], expected: str) -> str:
    name, function = READERS[read]
    content = made()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_bytes(content)
        return _outcome(lambda: _compared(function(file), expected, read))


def _compared(found: str, expected: str, read: str) -> str:
    if found == expected:
        return "used" if found == "used" else "same"
    return "used" if read in OLD else "OTHER NUMBERS"


def option_cases(files: Path, seed: int) -> Iterator[Case]:
    """Command lines with hostile values, without end."""
    for number in range(seed, sys.maxsize):
        words = hostile_words(number)
        text = functools.partial("\n".join(words).encode, errors="surrogateescape")
        yield Case(f"options: {words[0]}", number, functools.partial(_command, files, words), text)


def _command(files: Path, words: list[str]) -> str:
    with tempfile.TemporaryDirectory() as folder:
        for name in ("s.state.nc", "r.run.nc"):
            shutil.copy2(files / name, folder)
        os.chdir(folder)
        before = _listing(folder)
        outcome = _outcome(lambda: {0: "used", 2: "refused"}.get(_exit_code(words), "failed"))
        os.chdir("/")
        after = _listing(folder)
        if outcome == "refused" and set(after) - set(before):
            return f"LEFT FILES {sorted(set(after) - set(before))[:2]}"
        changed = [name for name in before if after.get(name) != before[name]]
        return f"INPUT CHANGED {changed[0]}" if changed else outcome


def _exit_code(words: list[str]) -> int:
    try:
        return run_command(words)
    except SystemExit as ended:
        return int(ended.code or 0)


def _listing(folder: str) -> dict[str, tuple[int, int]]:
    """Name -> (size, time of change) of all files."""
    return {str(file): (file.stat().st_size, file.stat().st_mtime_ns) for file in Path(folder).rglob("*")}


def campaign_cases(seed: int) -> Iterator[Case]:
    """Random campaign files, without end."""
    for number in range(seed, sys.maxsize):
        yield Case("campaign files", number, functools.partial(_campaign, number), f"seed {number}".encode)


def _campaign(seed: int) -> str:
    with tempfile.TemporaryDirectory() as folder:
        outcome = _outcome(lambda: read_mutated_campaign(Path(folder), seed))
        left = sorted(file.name for file in Path(folder).iterdir() if file.name != "c.yaml")
        return f"LEFT FILES {left[:2]}" if left else outcome


def _outcome(do: Callable[[], str]) -> str:
    try:
        return do()
    except lk.InputError as error:
        return "refused" if str(error).strip() else "NO MESSAGE"
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return f"TRACEBACK {type(error).__name__}: {error} ({Path(place.filename).name}, {place.lineno})"[:300]


def in_child(case: Case, limit: float = LIMIT) -> str:
    """The outcome of one case in a forked process."""
    return next(in_children([case], 1, limit))


def in_children(cases: Iterable[Case], together: int, limit: float = LIMIT) -> Iterator[str]:
    """The outcomes of cases in forked processes, several `together` in one as long as nothing happens to it.

    HANG if a case takes longer than `limit` s; CRASH if its process does not survive it.
    """
    remaining = iter(cases)
    while left := list(itertools.islice(remaining, together)):
        while left:
            for outcome in _in_child(tuple(left), limit):
                yield outcome
                left.pop(0)


def _in_child(cases: Sequence[Case], limit: float) -> Iterator[str]:
    """Outcomes of cases in one forked process, up to the first that ends it."""
    receive, send = os.pipe()
    longest = math.ceil(limit) * len(cases)
    child = os.fork()
    if child == 0:
        be_quiet()
        resource.setrlimit(resource.RLIMIT_CPU, (longest, longest))  # also when its parent is gone
        with contextlib.suppress(BaseException), open(send, "w", encoding="utf-8", errors="replace") as lines:
            for case in cases:
                print(json.dumps(case.outcome()), file=lines, flush=True)
        os._exit(0)
    os.close(send)
    with open(receive, "rb", buffering=0) as lines:
        for _ in cases:
            ready, _, _ = select.select([lines], [], [], limit)
            line = lines.readline() if ready else b""
            if not line:
                if not ready:
                    os.kill(child, signal.SIGKILL)
                code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
                yield f"CRASH {code}" if ready else "HANG"
                return
            yield str(json.loads(line))
    os.waitpid(child, 0)


def be_quiet(file: str = os.devnull) -> None:
    """Send the output of this process to a file."""
    null = os.open(file, os.O_RDWR | os.O_CREAT | os.O_TRUNC)
    for number in (0, 1, 2):
        os.dup2(null, number)
    sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)
