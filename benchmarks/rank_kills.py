"""Kills random ranks of a run at random moments, resumes it on another number of them, and compares with one thread.

    python -m benchmarks.rank_kills s.state.nc --kills 20 --seed 1 --strain 0.02

The runs save often: one that cannot save within 8 s after SIGTERM stops elsewhere, and continues with other bits
(labkit/simulation/stopping.py).
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.ranks import differences

GRACE = 5.0  # s after which no process may be left


def ranks_of(process: int) -> list[int]:
    """Return the numbers of a run's process and of all processes that it started."""
    listed = subprocess.run(["ps", "-eo", "pid=,ppid="], capture_output=True, text=True, check=True).stdout
    rows = [tuple(map(int, line.split())) for line in listed.splitlines()]
    family = [process]
    for parent in family:  # grows while it is read
        family += [number for number, its_parent in rows if its_parent == parent]
    return family


def run_and_kill(words: list[str], ranks: int, pick: random.Random) -> str | None:
    """Run a command and kill one of its processes at a random moment; return what was done, None if it ended first."""
    run = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while run.poll() is None and len(family := ranks_of(run.pid)) < ranks + (ranks > 1):
        time.sleep(0.1)  # the launcher is a process too
    time.sleep(pick.uniform(0.0, 10.0))
    family = ranks_of(run.pid)
    place, number = pick.randrange(len(family)), pick.choice([signal.SIGKILL, signal.SIGKILL, signal.SIGTERM])
    place *= number == signal.SIGKILL
    if run.poll() is not None:
        return None
    with contextlib.suppress(ProcessLookupError):
        os.kill(family[place], number)
    code = run.wait()
    end = time.monotonic() + GRACE
    while (left := sum(os.path.exists(f"/proc/{process}") for process in family)) and time.monotonic() < end:
        time.sleep(0.05)
    return f"{number.name} to process {place} of {len(family)}, exit {code}, {left} left after {GRACE:g} s"


def main() -> None:
    """Kill, resume and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("specimen")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--strain", default="0.02")
    asked = parser.parse_args()
    pick, done, ranks = random.Random(asked.seed), 0, 1
    with tempfile.TemporaryDirectory() as place:
        one, other = Path(place) / "one.run.nc", Path(place) / "other.run.nc"

        def words(file: Path, count: int) -> list[str]:
            run = f"run cv {asked.specimen} --strain {asked.strain} --rate 25 --snapshots 4"
            run += " --record-strain 0.0002 --save-every 1"
            return [sys.executable, "-m", "labkit.cli", *run.split(), "--ranks", str(count), "-o", str(file)]

        while done < asked.kills:
            ranks = pick.choice([n for n in (1, 2, 3, 4) if n != ranks])
            said = run_and_kill(words(other, ranks), ranks, pick)
            if said is None:
                break
            done += 1
            print(f"{done:3}: on {ranks} ranks {said}", flush=True)
        for file, count in ((other, 2), (one, 1)):
            subprocess.run(words(file, count), check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        count, odd = differences(one, other)
    print(f"{done} kills, seed {asked.seed}: {count - len(odd)} of {count} variables equal {' '.join(odd)}")


if __name__ == "__main__":
    main()
