"""`./lab fuzz`: damaged and hostile input of every class, with new seeds, for some minutes or a number of cases."""

from __future__ import annotations

import argparse
import collections
import contextlib
import csv
import gc
import io
import itertools
import re
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from analysis.fuzz.cases import GOOD, Case, campaign_cases, file_cases, in_child, option_cases
from analysis.fuzz.inputs import READERS, make_inputs
from analysis.markdown import table
from analysis.places import results_folder
from labkit.cli.arguments import positive_int
from labkit.io import make_folder, write_with_provenance

CLASSES = ("files", "options", "campaigns")
MOST_KEPT = 5  # files of each class and outcome


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of `./lab fuzz`."""
    parser.add_argument("--minutes", type=positive_int, default=5, metavar="N", help="time to take (default: 5)")
    parser.add_argument("--files", type=positive_int, metavar="N", help="number of damaged files, instead of the time")
    parser.add_argument("--options", type=positive_int, metavar="N", help="number of command lines")
    parser.add_argument("--campaigns", type=positive_int, metavar="N", help="number of campaign files")
    parser.add_argument("--seed", type=positive_int, metavar="N", help="first seed (default: from the clock)")
    parser.add_argument("-o", "--output", metavar="FOLDER", default=results_folder("fuzz"), help="folder of the table")


def main(options: argparse.Namespace, command: str) -> int:
    """Run the cases until done or Ctrl-C, print and write the counts, keep what failed; 1 if something failed."""
    seed = options.seed or int(time.time())
    folder = make_folder(options.output, "-o")
    counts: dict[str, collections.Counter[str]] = {}
    with tempfile.TemporaryDirectory(prefix="labkit-fuzz-") as name, contextlib.suppress(KeyboardInterrupt):
        for case, outcome in _outcomes(Path(name), options, seed):
            known = counts.setdefault(case.kind, collections.Counter())
            short = outcome.split(" ")[0] if outcome not in ("OTHER NUMBERS",) else outcome
            known[short] += 1
            if short not in GOOD:
                print(f"{case.kind}, seed {case.seed}: {outcome}", flush=True)
                if known[short] <= MOST_KEPT:
                    _keep(folder / "failed", case)
    columns = sorted({outcome for known in counts.values() for outcome in known} | set(GOOD))
    rows = [[kind, *(known[one] for one in columns), known.total()] for kind, known in sorted(counts.items())]
    print(table(["class", *columns, "cases"], [list(map(str, row)) for row in rows], range(1, len(columns) + 2)))
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([["class", *columns, "cases"], *rows])
    write_with_provenance(
        folder / "counts.csv", text.getvalue(), command=command if options.seed else f"{command} --seed {seed}"
    )
    return int(any(one not in GOOD for one in columns))


def _outcomes(folder: Path, options: argparse.Namespace, seed: int) -> Iterator[tuple[Case, str]]:
    """Every case with its outcome."""
    make_inputs(folder)
    expected = {read: function(folder / name) for read, (name, function) in READERS.items()}
    gc.freeze()
    classes = {
        "files": file_cases(folder, expected, seed),
        "options": option_cases(folder, seed),
        "campaigns": campaign_cases(seed),
    }
    wanted = {name: getattr(options, name) for name in CLASSES}
    if any(wanted.values()):
        for name, number in wanted.items():
            yield from ((case, in_child(case)) for case in itertools.islice(classes[name], number or 0))
        return
    end = time.monotonic() + 60.0 * options.minutes
    for cases in zip(*classes.values(), strict=True):
        for case in cases:
            yield case, in_child(case)
        if time.monotonic() > end:
            return


def _keep(folder: Path, case: Case) -> None:
    """Write a failing input to a file, named after its class and seed."""
    folder.mkdir(parents=True, exist_ok=True)
    name = re.sub(r"[^a-z0-9]+", "-", case.kind.lower()).strip("-")
    (folder / f"{name}-{case.seed}").write_bytes(case.what())
