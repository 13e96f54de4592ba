"""`./lab fuzz`: damaged and hostile input of every class, with new seeds, for some minutes or a number of cases."""

from __future__ import annotations

import argparse
import collections
import dataclasses
import functools
import gc
import importlib
import itertools
import json
import re
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hypothesis
import pandas
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from hypothesis.database import DirectoryBasedExampleDatabase

import labkit as lk
from analysis.fuzz import extremes, kills, soak
from analysis.fuzz.cases import GOOD, in_child, read_damaged, read_text_as_campaign, run_words
from analysis.fuzz.damage import command_lines, damaged, damaged_campaigns
from analysis.fuzz.inputs import READERS, make_inputs
from analysis.manifest import collect
from analysis.markdown import table
from analysis.places import results_folder
from labkit.cli.arguments import positive_int
from labkit.files import make_folder, write_with_provenance

IN_TURN = 20  # inputs of each kind, while there is time
IMPORTED = (
    "labkit.engines",
    "labkit.plugins.exchange",
    "labkit.results",
    "labkit.figures.plots",
    "matplotlib.pyplot",
    "pandas",
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of `./lab fuzz`."""
    parser.add_argument("--minutes", type=positive_int, default=5, metavar="N", help="time to take (default: 5)")
    parser.add_argument("--files", type=positive_int, metavar="N", help="number of damaged files of each kind")
    parser.add_argument("--kinds", default="", metavar="TEXT", help="only files of kinds whose name contains this")
    parser.add_argument("--options", type=positive_int, metavar="N", help="number of command lines")
    parser.add_argument("--campaigns", type=positive_int, metavar="N", help="number of campaign files")
    parser.add_argument("--extremes", action="store_true", help="run scenes far outside the usual range instead")
    parser.add_argument("--kills", type=positive_int, metavar="N", help="kill commands N times instead")
    parser.add_argument("--soak", type=positive_int, metavar="MINUTES", help="random commands and faults in one folder")
    parser.add_argument("--engine", choices=("fused", "yade"), default="fused", help="of --extremes and --kills")
    parser.add_argument("--seed", type=positive_int, metavar="N", help="first seed (default: from the clock)")
    parser.add_argument("-o", "--output", metavar="FOLDER", default=results_folder("fuzz"), help="folder of the table")


def main(options: argparse.Namespace, command: str) -> int:
    """Run the cases until done or Ctrl-C, print and write the counts, and keep failed cases; returns 1 if any failed.

    With kills or a soak and a seed, a repeated command continues where it was stopped.
    """
    seed = options.seed or int(time.time())
    command = command if options.seed or options.extremes else f"{command} --seed {seed}"
    folder = Path(make_folder(options.output, "-o"))
    for module in IMPORTED:  # modules that commands use are imported once, not in every process
        importlib.import_module(module)
    gc.freeze()
    if options.extremes:
        name, found = f"extremes_{options.engine}", _extremes(options.engine)
        wrong = found["outcome"].str.startswith(("WRONG", "TRACEBACK", "CRASH", "HANG")).any()
    elif options.kills or options.soak:
        name = f"kills_{options.engine}" if options.kills else "soak"
        found = (
            _kills(folder, options.engine, options.kills, seed) if options.kills else _soak(folder, options.soak, seed)
        )
        wrong = found["wrong"].any()
    else:
        kinds = re.sub("[^a-z0-9]+", "-", f" {options.kinds}".lower()).rstrip("-")
        name, found = f"counts{kinds}", _damages(options, folder / "failed", seed)
        wrong = not set(found.columns[1:-1]) <= set(GOOD)
    print(table(list(found.columns), found.astype(str).to_numpy().tolist(), range(1, found.shape[1])))
    write_with_provenance(folder / f"{name}.csv", found.to_csv(index=False), command=command)
    collect(folder)
    return int(wrong)


def _damages(options: argparse.Namespace, failed: Path, seed: int) -> pandas.DataFrame:
    """Read damaged and hostile input; a row per class, with the number of each outcome."""
    counts: collections.defaultdict[str, collections.Counter[str]] = collections.defaultdict(collections.Counter)
    wanted = {name: getattr(options, name) or 0 for name in ("files", "options", "campaigns")}
    end = time.monotonic() + 60.0 * options.minutes
    with tempfile.TemporaryDirectory(prefix="labkit-fuzz-") as name:
        classes = searches(Path(name), options.kinds)
        gc.freeze()
        for turn in itertools.count():
            for kind, number in wanted.items():
                for search in classes[kind]:
                    number = number if any(wanted.values()) else IN_TURN
                    counts[search.kind] += search.run(number, seed + turn, failed) if number else {}
            if any(wanted.values()) or time.monotonic() > end:
                break
    columns = sorted({outcome for known in counts.values() for outcome in known} | set(GOOD))
    rows = [[kind, *(known[one] for one in columns), known.total()] for kind, known in counts.items() if known]
    return pandas.DataFrame(rows, columns=["class", *columns, "cases"])


def _extremes(engine: str) -> pandas.DataFrame:
    """Run the scenes of labkit's limits; a row per scene, with its outcome."""
    rows = []
    for extreme, outcome, said in extremes.outcomes(engine):
        print(f"{extreme.name}: {outcome}", flush=True)
        rows.append((extreme.name, extreme.material, extreme.path, outcome, said))
    return pandas.DataFrame(rows, columns=["case", "material", "path", "outcome", "said"])


def _kills(folder: Path, engine: str, number: int, seed: int) -> pandas.DataFrame:
    """Kill commands; a row per command, with the numbers of kills and of chains in which something was wrong."""
    rows = []
    with Log(folder / f"unfinished_kills_{engine}.txt", seed) as log:
        before = [kills.Chain.from_json(text) for text in log.of("chain")]
        for done, chain in enumerate(kills.chains(engine, number, seed, before)):
            if done >= len(before):
                log.add("chain", chain.to_json())
            rows.append((chain.job.kind, 1, chain.kills, int(bool(chain.problems))))
            for problem in chain.problems:
                print(f"{' '.join(chain.job.words)}: {problem}", flush=True)
    return _sums(rows, ["command", "chains", "kills", "wrong"])


def _soak(folder: Path, minutes: int, seed: int) -> pandas.DataFrame:
    """Run commands in one folder and inject faults; a row per fault, with the number of commands that went wrong."""
    rows = []
    with Log(folder / "unfinished_soak.txt", seed) as log:
        before = [soak.Round(**json.loads(text)) for text in log.of("round")]
        for done, one in enumerate(soak.rounds(minutes, seed, before)):
            if done >= len(before):
                log.add("round", one.to_json())
            rows.append((one.fault, len(one.codes), int(bool(one.problems))))
            if one.problems:
                print(soak.told(one), flush=True)
    return _sums(rows, ["fault", "commands", "wrong"])


def _sums(rows: list[tuple[Any, ...]], columns: list[str]) -> pandas.DataFrame:
    return pandas.DataFrame(rows, columns=columns).groupby(columns[0], sort=False).sum().reset_index()


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
        """The outcomes of a class that are already known."""
        return [outcome for known, outcome in self.known if known == name]

    def add(self, name: str, outcome: str) -> None:
        """Keep an outcome."""
        print(name, outcome, file=self._handle, flush=True)


def searches(folder: Path, kinds: str) -> dict[str, list[Search]]:
    """Class -> its searches; `folder`: that of the undamaged inputs, `kinds`: parts of the names of kinds of files.

    Raises InputError if no kind has such a name.
    """
    make_inputs(folder)
    files = []
    for read, (name, function) in READERS.items():
        if kinds in read:
            outcome = functools.partial(read_damaged, read, function(folder / name))
            files.append(Search(read, damaged((folder / name).read_bytes()), outcome))
    if not files:
        raise lk.InputError(
            "is in no kind of file", field="kinds", value=kinds, allowed=f"part of {', '.join(READERS)}"
        )
    return {
        "files": files,
        "options": [Search("options", command_lines(), functools.partial(run_words, folder))],
        "campaigns": [Search("campaign files", damaged_campaigns(), read_text_as_campaign)],
    }


@dataclasses.dataclass(frozen=True)
class Search:
    """Inputs of a kind, and the function that gives the outcome of one; GOOD unless labkit has a bug."""

    kind: str
    inputs: st.SearchStrategy[Any]
    outcome: Callable[[Any], str]

    def run(self, number: int, seed: int, failed: Path) -> collections.Counter[str]:
        """Tries a number of inputs and returns how often each outcome occurred, up to the first that is not GOOD.

        That case is shrunk, printed, and kept in a file in the folder `failed`. hypothesis also keeps it there, and
        tries it first next time.
        """
        counts: collections.Counter[str] = collections.Counter()
        wrong: list[tuple[str, Any]] = []

        @settings(
            max_examples=number,
            deadline=None,
            derandomize=False,
            suppress_health_check=list(HealthCheck),
            database=DirectoryBasedExampleDatabase(failed / "examples" / self.kind),
            phases=(Phase.reuse, Phase.generate, Phase.shrink),
        )
        @hypothesis.seed(seed)
        @given(self.inputs)
        def check(made: Any) -> None:
            outcome = in_child(lambda: self.outcome(made))
            short = outcome if outcome in GOOD else " ".join(re.findall(r"^[A-Z ]+\b", outcome)) or outcome
            if not wrong:
                counts[short] += 1
            if short not in GOOD:
                wrong.append((outcome, made))
                raise Wrong(short)

        try:
            check()
        except Wrong:
            outcome, made = wrong[-1]  # the simplest
            failed.mkdir(parents=True, exist_ok=True)
            file = failed / f"{re.sub('[^a-z0-9]+', '-', self.kind.lower())}-{seed}"
            text = "\n".join(made) if isinstance(made, list) else made
            file.write_bytes(text if isinstance(text, bytes) else text.encode(errors="surrogatepass"))
            print(f"{self.kind}: {outcome}; kept in {file}", flush=True)
        return counts


class Wrong(Exception):
    """An unacceptable outcome."""
