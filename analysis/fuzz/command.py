"""`./lab fuzz`: damaged and hostile input of every class, with new seeds, for some minutes or a number of cases."""

from __future__ import annotations

import argparse
import collections
import csv
import gc
import importlib
import io
import itertools
import re
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import labkit as lk
from analysis.fuzz import extremes, kills, soak
from analysis.fuzz.cases import GOOD, Case, campaign_cases, file_cases, in_child, in_children, option_cases
from analysis.fuzz.inputs import READERS, make_inputs
from analysis.markdown import table
from analysis.places import results_folder
from labkit.cli.arguments import positive_int
from labkit.io import make_folder, write_with_provenance

CLASSES = {"files": 250, "options": 1, "campaigns": 50}  # class -> cases in one process
MOST_KEPT = 5  # files of each class and outcome
IMPORTED = ("labkit.engines", "labkit.exchange", "labkit.runs", "labkit.figures.plots", "matplotlib.pyplot", "pandas")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of `./lab fuzz`."""
    parser.add_argument("--minutes", type=positive_int, default=5, metavar="N", help="time to take (default: 5)")
    parser.add_argument("--files", type=positive_int, metavar="N", help="damaged files of each kind, not the time")
    parser.add_argument("--kinds", default="", metavar="TEXT", help="only files of kinds whose name contains this")
    parser.add_argument("--options", type=positive_int, metavar="N", help="number of command lines")
    parser.add_argument("--campaigns", type=positive_int, metavar="N", help="number of campaign files")
    parser.add_argument("--extremes", action="store_true", help="run scenes far outside the usual instead")
    parser.add_argument("--kills", type=positive_int, metavar="N", help="kill commands N times instead")
    parser.add_argument("--soak", type=positive_int, metavar="MINUTES", help="random commands and faults in one folder")
    parser.add_argument("--engine", choices=("fused", "yade"), default="fused", help="of --extremes and --kills")
    parser.add_argument("--seed", type=positive_int, metavar="N", help="first seed (default: from the clock)")
    parser.add_argument("-o", "--output", metavar="FOLDER", default=results_folder("fuzz"), help="folder of the table")


def main(options: argparse.Namespace, command: str) -> int:
    """Run the cases until done or Ctrl-C, print and write the counts, and keep failed cases; returns 1 if any failed.

    With a number of cases and a seed, a repeated command continues where it was stopped.
    """
    seed = options.seed or int(time.time())
    command = command if options.seed or options.extremes else f"{command} --seed {seed}"
    folder = Path(make_folder(options.output, "-o"))
    if options.extremes:
        return _extremes(folder, options.engine, command)
    if options.kills:
        return _kills(folder, options.engine, options.kills, seed, command)
    if options.soak:
        return _soak(folder, options.soak, seed, command)
    counts: dict[str, collections.Counter[str]] = {}
    with tempfile.TemporaryDirectory(prefix="labkit-fuzz-") as name, Log(folder / "unfinished.txt", seed) as log:
        for case, outcome in _outcomes(Path(name), options, seed, log):
            known = counts.setdefault(case.kind, collections.Counter())
            short = outcome.split(" ")[0] if outcome not in ("OTHER NUMBERS",) else outcome
            known[short] += 1
            if short not in GOOD:
                print(f"{case.kind}, seed {case.seed}: {outcome}", flush=True)
                if known[short] <= MOST_KEPT:
                    _keep(folder / "failed", case)
    columns = sorted({outcome for known in counts.values() for outcome in known} | set(GOOD))
    rows = [[kind, *(known[one] for one in columns), known.total()] for kind, known in sorted(counts.items())]
    write_table(folder / "counts.csv", ["class", *columns, "cases"], rows, command)
    return int(any(one not in GOOD for one in columns))


def _extremes(folder: Path, engine: str, command: str) -> int:
    """Run the scenes of labkit's limits and write what came of them; 1 if one is wrong."""
    _import()
    rows: list[list[object]] = []
    for extreme, outcome, said in extremes.outcomes(engine):
        print(f"{extreme.name}: {outcome}", flush=True)
        rows.append([extreme.name, extreme.material, extreme.path, outcome, said])
    write_table(folder / f"extremes_{engine}.csv", ["case", "material", "path", "outcome", "said"], rows, command)
    return int(any(str(row[3]).startswith(("WRONG", "TRACEBACK", "CRASH", "HANG")) for row in rows))


def _kills(folder: Path, engine: str, number: int, seed: int, command: str) -> int:
    """Kill commands and write how often, and what was lost; 1 if anything was."""
    _import()
    counts: dict[str, collections.Counter[str]] = {}
    with Log(folder / f"unfinished_kills_{engine}.txt", seed) as log:
        before = [kills.Chain.from_json(text) for text in log.of("chain")]
        for done, chain in enumerate(kills.chains(engine, number, seed, before)):
            if done >= len(before):
                log.add("chain", chain.to_json())
            known = counts.setdefault(chain.job.kind, collections.Counter())
            known.update(chains=1, kills=chain.kills, wrong=int(bool(chain.problems)))
            for problem in chain.problems:
                print(f"{' '.join(chain.job.words)}: {problem}", flush=True)
    columns = ["command", "chains", "kills", "wrong"]
    rows: list[list[object]] = [[kind, *(known[name] for name in columns[1:])] for kind, known in counts.items()]
    write_table(folder / f"kills_{engine}.csv", columns, rows, command)
    return int(any(row[3] for row in rows))


def _soak(folder: Path, minutes: int, seed: int, command: str) -> int:
    """Soak one folder in commands and faults, and write the counts; 1 if anything was wrong."""
    _import()
    counts: dict[str, collections.Counter[str]] = {}
    for one in soak.rounds(minutes, seed):
        counts.setdefault(one.fault, collections.Counter()).update(commands=1, wrong=int(bool(one.problems)))
        if one.problems:
            print(soak.told(one), flush=True)
    columns = ["fault", "commands", "wrong"]
    rows: list[list[object]] = [[fault, *(known[name] for name in columns[1:])] for fault, known in counts.items()]
    write_table(folder / "soak.csv", columns, rows, command)
    return int(any(row[2] for row in rows))


def write_table(file: Path, columns: list[str], rows: list[list[object]], command: str) -> None:
    """Print a table and write it as CSV."""
    print(table(columns, [list(map(str, row)) for row in rows], range(1, len(columns))))
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([columns, *rows])
    write_with_provenance(file, text.getvalue(), command=command)


class Log:
    """The outcomes so far of a command with numbers of cases, in a file that is deleted when it has ended."""

    def __init__(self, file: Path, seed: int) -> None:
        """Read the outcomes of a command with the same seed, if it was stopped before."""
        self.file, self.first = file, f"seed {seed}, labkit {lk.__version__}"
        lines = file.read_text().splitlines() if file.exists() else []
        self.known = [line.split(" ", 1) for line in lines[1:]] if lines[:1] == [self.first] else []

    def __enter__(self) -> Log:
        self._handle = self.file.open("w")
        print(self.first, *(" ".join(line) for line in self.known), sep="\n", file=self._handle, flush=True)
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        self._handle.close()
        if kind is None:
            self.file.unlink()

    def of(self, name: str) -> list[str]:
        """Outcomes of a class that are known already."""
        return [outcome for known, outcome in self.known if known == name]

    def add(self, name: str, outcome: str) -> None:
        """Keep an outcome."""
        print(name, outcome, file=self._handle, flush=True)


def _outcomes(folder: Path, options: argparse.Namespace, seed: int, log: Log) -> Iterator[tuple[Case, str]]:
    """Every case with its outcome."""
    make_inputs(folder)
    expected = {read: function(folder / name) for read, (name, function) in READERS.items()}
    gc.freeze()
    kinds = [read for read in READERS if options.kinds in read]
    if not kinds:
        raise lk.InputError(
            "is in no kind of file", field="kinds", value=options.kinds, allowed=f"part of {', '.join(READERS)}"
        )
    classes = {
        "files": file_cases(folder, expected, seed, kinds),
        "options": option_cases(folder, seed),
        "campaigns": campaign_cases(seed),
    }
    wanted = {name: getattr(options, name) or 0 for name in CLASSES}
    wanted["files"] *= len(kinds)
    if any(wanted.values()):
        for name, together in CLASSES.items():
            if name == "options":
                _import()
            cases: Iterator[Case] = itertools.islice(classes[name], wanted[name])
            known = log.of(name)[: wanted[name]]
            for outcome in known:
                yield next(cases), outcome
            cases, given = itertools.tee(cases)
            for case, outcome in zip(cases, in_children(given, together), strict=True):
                log.add(name, outcome)
                yield case, outcome
        return
    _import()
    end = time.monotonic() + 60.0 * options.minutes
    for one_of_each in zip(*classes.values(), strict=True):
        for case in one_of_each:
            yield case, in_child(case)
        if time.monotonic() > end:
            return


def _import() -> None:
    """Import what commands use once, not in every process."""
    for module in IMPORTED:
        importlib.import_module(module)
    gc.freeze()


def _keep(folder: Path, case: Case) -> None:
    """Write a failing input to a file, named after its class and seed."""
    folder.mkdir(parents=True, exist_ok=True)
    name = re.sub(r"[^a-z0-9]+", "-", case.kind.lower()).strip("-")
    (folder / f"{name}-{case.seed}").write_bytes(case.what())
