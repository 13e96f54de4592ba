"""`./lab model-benchmark`: gathers the stored tests, scores all models on them, and writes results/model_benchmark."""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas
import xarray as xr

from analysis.model_benchmark import peers
from analysis.model_benchmark.attractors import end_states, measured_constants
from analysis.model_benchmark.dilatancy import constants, dilatancy, dilatancy_errors, dilatancy_figure
from analysis.model_benchmark.envelopes import envelope_errors, envelopes_figure, responses, write_probes
from analysis.model_benchmark.fabric import fabric_constants
from analysis.model_benchmark.figures import attractors_figure, curves_figure, errors_figure
from analysis.model_benchmark.peers import ACST, LI_DAFALIAS, fitted_peers, moved_constants
from analysis.model_benchmark.rates import better_model, rate_errors, replacements
from analysis.model_benchmark.score import Contestant, repeated, score, training_part
from analysis.model_benchmark.tables import AGAINST, first_wrong, judged_part, ratios, summary
from analysis.model_benchmark.tests import write_tests
from analysis.paper.model_runs import models
from analysis.places import results_folder
from analysis.study import STEPS, Figures, StoredTables, Study, Tables, Values
from labkit.model import MEASURED, Model, critical_section

ALIKE = {"judged": "summary", "against_calibrated": "ratios"}  # name on the page -> table
AMENDED, LODE, AMENDED_LODE, BETTER = "amended", "calibrated, Lode", "amended, Lode", "better"


def own_models(folder: Path, data: xr.Dataset | None = None) -> dict[str, Model]:
    """labkit's models by name: Table 2, calibrated, amended, the last two with Lode dependence, and better.

    The better one is read from a folder, or fitted to data.
    """
    results = Path(results_folder())
    stored = json.loads((results / "model_evidence" / "calibrations.json").read_text(encoding="utf-8"))
    amended = Model.from_json(json.dumps(stored[AMENDED]["cyclic_cp"]))
    chosen = models(results / "paper") | {AMENDED: amended}
    with_lode = {LODE: chosen[AGAINST], AMENDED_LODE: amended}
    chosen |= {name: dataclasses.replace(model, lode=MEASURED) for name, model in with_lode.items()}
    return chosen | {BETTER: better_model(chosen[AMENDED_LODE], data, folder / "better.json")}


class ModelBenchmark(Study):
    """Constitutive models on all stored tests."""

    data = "tests.nc"
    steps = ("gather", "probes", *STEPS[2:])
    peers, probes = "peers.json", "probes.nc"

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        if "gather" in options.steps:
            write_tests(folder / self.data, self.home / "split.csv", command)
        if "probes" in options.steps:
            write_probes(folder / self.probes, command)
        self.folder = folder
        return 0

    def read(self, file: Path) -> xr.Dataset:
        self.folder = file.parent
        return xr.load_dataset(file)

    def tables(self, data: xr.Dataset) -> Tables:
        own, training = own_models(self.folder, data), training_part(data)
        laws = fitted_peers(data, self.folder / self.peers, self.progress)  # fitted if they are not stored
        contestants = [Contestant(name, law) for name, law in (own | laws).items()]
        scores = score(data, contestants, self.progress)
        scores = pandas.concat([scores, repeated(data)], ignore_index=True)
        ends = end_states(data.astype("f8"))
        on_axis = {name: model for name, model in own.items() if name not in (LODE, AMENDED_LODE)}
        windows = dilatancy(data, {name: model.reading(beyond_e_cmax="flat") for name, model in on_axis.items()})
        envelopes = responses(xr.load_dataset(self.folder / self.probes), contestants)
        everything = measured_constants(ends)
        constants = measured_constants(ends[ends["part"] == "training"]).assign(
            used=list(dataclasses.asdict(MEASURED).values()),
            all=everything["value"],
            all_within=everything["within"],
            all_packings=everything["packings"],
        )
        judged = judged_part(scores)
        of_peers = judged["model"].isin(laws)
        return {
            "ends": ends,
            "constants": constants,
            "scores": scores,
            "summary": summary(scores),
            "ratios": ratios(scores),
            "against_better": ratios(judged[of_peers | (judged["model"] == BETTER)], BETTER),
            "with_fabric": ratios(judged[judged["model"].isin([ACST, LI_DAFALIAS])], LI_DAFALIAS),
            "moved": moved_constants(laws, [training.sel(run=name) for name in training["run"].values]),
            "fabric": fabric_constants(training),
            "first_wrong": first_wrong(scores),
            "sections": sections(ends, own),
            "rates": rate_errors({name: own[name] for name in (AGAINST, AMENDED_LODE, BETTER)}, training),
            "replacements": replacements(next(c for c in contestants if c.name == BETTER), data),
            "dilatancy": windows,
            "dilatancy_errors": dilatancy_errors(windows),
            "envelopes": envelopes,
            "envelope_errors": envelope_errors(envelopes),
        }

    def figures(self, data: xr.Dataset, tables: StoredTables) -> Figures:
        own = own_models(self.folder)
        shown = {name: own[name] for name in (AGAINST, LODE, BETTER)}
        drawn = [Contestant(name, model) for name, model in shown.items()]
        return {
            "attractors": attractors_figure(tables["ends"], shown),
            "errors": errors_figure(tables["scores"], tables["summary"], own),
            "curves": curves_figure(data, drawn),
            "dilatancy": dilatancy_figure(tables["dilatancy"]),
            "envelopes": envelopes_figure(tables["envelopes"]),
        }

    def numbers(self, tables: StoredTables) -> Values:
        M, N = constants(tables["dilatancy"])
        keys = ["group", "drive", "model"]
        found = {name: tables[name].set_index(keys) for name in ("against_better", "with_fabric")}
        found |= {name: judged_part(tables[table]).set_index(keys) for name, table in ALIKE.items()}
        found = {name: table.sort_index() for name, table in found.items()}
        return {"M": M, "N": N, "peers": peers, **found}


def sections(ends: pandas.DataFrame, models: Mapping[str, Model]) -> pandas.DataFrame:
    """q/p at the critical state of the models over that in compression, at the Lode angles of stress in the grains.

    Rows: group (and b) of the tests; columns: theta of the stress, grains, and the models.
    """
    compression = ends.loc[ends["group"] == "compression", "M"].mean()
    rows = []
    for name, own in ends[ends["group"] != "compression"].groupby(ends["run"].str.partition("-")[0]):
        theta = float(own["stress_theta"].mean())
        row: dict[str, object] = {"test": name, "theta": theta, "grains": own["M"].mean() / compression}
        for label, model in models.items():
            ratio, reached = critical_section(np.linspace(0.0, 60.0, 241), model, float(own["e"].mean()))
            row[label] = float(np.interp(theta, reached, ratio / ratio[0]))
        rows.append(row)
    return pandas.DataFrame(rows)


STUDY = ModelBenchmark()
