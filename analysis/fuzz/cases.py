"""The outcome of one damaged or hostile input, found in a forked process so that it may be a crash or a hang."""

from __future__ import annotations

import contextlib
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path

import labkit as lk
from analysis.fuzz.inputs import READERS
from labkit.cli.dispatch import main as run_command
from labkit.plugins.campaigns import read_campaign

LIMIT = 60.0  # s after which a case counts as a hang
GOOD = ("same", "used", "refused", "failed")  # acceptable outcomes


def read_damaged(read: str, expected: str, content: bytes) -> str:
    """Outcome of reading a damaged file of a kind, a key of READERS. `expected`: the result of the undamaged file."""
    name, function = READERS[read]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_bytes(content)

        def compared() -> str:
            found = function(file)
            return "OTHER NUMBERS" if found != expected else "used" if found == "used" else "same"

        return _outcome(compared)


def run_words(files: Path, words: list[str]) -> str:
    """Outcome of a command line in a folder with a state and a run from the folder `files`."""
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


def read_text_as_campaign(text: str) -> str:
    """Outcome of reading a campaign file with this text."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "c.yaml"
        file.write_text(text, encoding="utf-8", errors="surrogatepass")
        outcome = _outcome(lambda: "used" if read_campaign(file) else "")
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


def in_child(outcome: Callable[[], str], limit: float = LIMIT) -> str:
    """The outcome of a case in a forked process.

    HANG if it takes longer than `limit` s; CRASH if its process does not survive it.
    """
    receive, send = os.pipe()
    child = os.fork()
    if child == 0:
        be_quiet()
        resource.setrlimit(resource.RLIMIT_CPU, (int(limit) + 1, int(limit) + 1))  # even when its parent has ended
        with contextlib.suppress(BaseException):
            os.write(send, outcome().encode(errors="replace"))
        os._exit(0)
    os.close(send)
    with open(receive, "rb") as answer:
        ended = bool(select.select([answer], [], [], limit)[0])
        if not ended:
            os.kill(child, signal.SIGKILL)
        text = answer.read().decode()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return (text or f"CRASH {code}") if ended else "HANG"


def be_quiet(file: str = os.devnull) -> None:
    """Send the output of this process to a file."""
    null = os.open(file, os.O_RDWR | os.O_CREAT | os.O_TRUNC)
    for number in (0, 1, 2):
        os.dup2(null, number)
    sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)
