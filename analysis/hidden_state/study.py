"""`./lab hidden-state`: runs the tests and the twins, or uses the stored ones, and writes results/hidden_state."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path

import pandas

from analysis.hidden_state import contest, cycles, equal, law
from analysis.hidden_state.fabric import contrasts, judged_fabric, own_models, peer_laws, predictions
from analysis.hidden_state.figures import contest_figure, fabric_figure, law_figure, state_figure
from analysis.hidden_state.loading import work
from analysis.hidden_state.nearest import compared, differences, pairs_of, ranking
from analysis.hidden_state.table import Test, gather, read, states_of
from analysis.hidden_state.twins import make_pairs
from analysis.study import Figures, StoredTables, Study, Tables, Values
from labkit.files import write_with_provenance
from labkit.model import ConstitutiveLaw

HELD = ("small", "large", "loops", "compression", "extension", "turn", "again")  # tests at held p, of the law


PARTS = ("states", "twins", "forms", "memory", "laws", "fabric", "undrained")


class HiddenState(Study):
    """Is (e, Z, Lambda, A, F, F^t) a state, and which law follows reversals and rotation?"""

    data = "records.nc"
    pairs, cycles = "pairs.jsonl", "cycles.jsonl"
    parts: Sequence[str] = PARTS
    steps = ("run", "gather", "twins", "cycles", "tables", "figures", "page")

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        text = f"folder in which the tests are run, resumably (default: none; use {self.data} in the output folder)"
        parser.add_argument("folder", nargs="?", type=Path, help=text)
        text = "tables that the step `tables` computes (default: all); `memory`, the fit of peers, takes longest"
        parser.add_argument("--tables", choices=PARTS, nargs="+", default=PARTS, help=text)
        self.add_output(parser)

    def only_redraws(self, options: argparse.Namespace) -> bool:
        return options.folder is None

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a cell of 1,000 grains is small
            if "run" in options.steps:
                options.folder.mkdir(parents=True, exist_ok=True)
                _show(work(options.folder))
            if "gather" in options.steps:
                gather(options.folder, folder / self.data, command)
            if "twins" in options.steps:
                _show(make_pairs(folder / self.data, folder / self.pairs))
            if "cycles" in options.steps:
                _show(cycles.tests(folder / self.cycles))
        return 0

    def read(self, file: Path) -> list[Test]:
        self.folder = file.parent
        return read(file)

    def main(self, options: argparse.Namespace, command: str) -> int:
        self.parts, self.command = options.tables, command
        return super().main(options, command)

    def tables(self, data: list[Test]) -> Tables:
        fit = law.stiffness_fit(law.slopes(data))
        constants = law.measured(data, law.chosen_stiffness(fit))
        made: Tables = {}
        if "states" in self.parts:
            made |= of_states(data)
        if "twins" in self.parts:
            pairs = equal.read_pairs(self.folder / self.pairs)
            made |= {"twins": equal.reached(pairs), "twin_rates": equal.compared_rates(pairs)}
            made["twin_ranking"] = equal.ranked(pairs)
        if "forms" in self.parts:
            forms = contest.with_forms(own_models()["calibrated"], constants)
            write_with_provenance(
                self.folder / "two_forms.json", forms.to_json(), [self.folder / self.data], self.command
            )
            made |= of_forms(data, constants) | {"slopes": law.slopes(data), "stiffness": fit}
        if "memory" in self.parts:
            made["memory"] = contest.fitted_memory(data, peer_laws(), constants)
        if {"laws", "fabric", "undrained"} & {*self.parts}:
            memory = made["memory"] if "memory" in made else StoredTables(self.folder)["memory"]
            laws = contest.contestants(own_models(), peer_laws(), memory, constants)
            made |= self._of_laws(data, laws, constants)
        return made

    def _of_laws(self, data: list[Test], laws: dict[str, ConstitutiveLaw], constants: law.Constants) -> Tables:
        made: Tables = {}
        if "fabric" in self.parts:
            fabric = predictions(data, laws, constants)
            made |= {"fabric": fabric, "contrasts": contrasts(fabric), "judged_fabric": judged_fabric(fabric)}
        if "laws" in self.parts:
            followed = contest.contest(data, laws, constants, self.progress)
            own = (*own_models(), contest.FORMS)
            peers = [name for name in laws if name not in own]
            made |= {"contest": contest.by_packing(followed), "gains": contest.gains(followed)}
            made["against_peers"] = contest.against_peers(followed, own, peers)
        if "undrained" in self.parts:
            counts = cycles.counted(equal.read_pairs(self.folder / self.cycles), laws, constants)
            made |= {"cycles": counts, "cycle_errors": cycles.errors_of_cycles(counts)}
        return made

    def figures(self, data: list[Test], tables: StoredTables) -> Figures:
        return {
            "state": state_figure(tables),
            "law": law_figure(tables),
            "fabric": fabric_figure(tables["fabric"]),
            "contest": contest_figure(tables),
        }

    def numbers(self, tables: StoredTables) -> Values:
        rates = tables["rates"].query("density == 'all'").set_index("rate")
        tests, of_dilatancy = tables["tests"], tables["of_D"]
        return {
            "rate": rates,
            "memory": tables["ranking"].query("memory == 'yes'"),
            "twin_rate": tables["twin_rates"].set_index(["rate", "density"]),
            "remembering": tables["twin_ranking"].query("memory == 'yes'"),
            "contest": contest.summary(tables["contest"]),
            "enough_pairs": equal.ENOUGH_PAIRS,
            "near": equal.NEAR,
            "most_cycles": cycles.MOST,
            "undrained": pandas.DataFrame(equal.read_pairs(tables.folder / self.cycles)),
            "of_F": wide(tables["of_F"], "error"),
            "of_D": wide(of_dilatancy, "D").assign(scatter=wide(of_dilatancy, "D_std")["C4"]),
            "of_volume": wide(of_dilatancy, "volume"),
            "goals": tables["goals"].replace({True: "yes", False: "no"}),
            "packings": tests.groupby(["density", "seed"]).ngroups,
            "judged": tables["judged_fabric"].set_index(["density", "model"]),
            "fast": tests.query("inertial > 1e-3"),
            "ended": tests[tests["ended"].notna() & (tests["ended"] != "")],
            "seeds": tests.groupby(["test", "density"])["seed"].nunique().unstack().reset_index(),
        }

    def sources(self, folder: Path) -> Sequence[str | Path]:
        return [folder / name for name in (self.data, self.pairs, self.cycles) if (folder / name).exists()]


def of_states(data: list[Test]) -> Tables:
    """The tables of nearest states, and a row per test."""
    rows = states_of(data)
    made = differences(rows, pairs_of(rows))
    each = [compared(own, str(density)) for density, own in made.groupby("density", sort=False)]
    tests = [(test.name, test.density, test.seed, len(test), test.inertial, test.ended) for test in data]
    return {
        "rates": pandas.concat([compared(made), *each], ignore_index=True),
        "ranking": ranking(rows, made),
        "tests": pandas.DataFrame(tests, columns="test density seed records inertial ended".split()),
    }


def of_forms(data: list[Test], constants: law.Constants) -> Tables:
    """The tables of the two forms in the state of the grains."""
    shown = [test for test in data if test.name.startswith(HELD) and not test.name.startswith("pre")]
    models = own_models()
    rates = {
        law.FORM_OF_F: law.stiff(constants, clipped_range=True),
        "C3 with K(Z)": law.stiff(constants, clipped_range=False),
        "C3, calibrated": law.c3(models["calibrated"]),
        "C3, better": law.c3(models["better"]),
    }
    errors = law.errors_of_F(shown, rates)
    dilatancy = law.Dilatancy(data, constants).errors(shown)
    return {
        "constants": constants.table(),
        "of_F": law.judged(errors, ["error"]),
        "of_D": law.judged(dilatancy, ["D", "D_std", "volume"]),
        "goals": law.goals(errors, dilatancy),
    }


def wide(table: pandas.DataFrame, value: str) -> pandas.DataFrame:
    """A value on the held-out packings, a row per density and group and a column per form."""
    held = table[table["part"] == "held out"]
    table = held.pivot_table(value, ["group", "density"], "form", sort=False).reset_index()
    return table.rename(columns={law.BOLD: "unclipped", law.CLIPPED: "clipped"})


def _show(done: Iterable[str]) -> None:
    """Print a line for each part that is done; what is done is not computed again after Ctrl-C."""
    for line in done:
        print(line, flush=True)


STUDY = HiddenState()
