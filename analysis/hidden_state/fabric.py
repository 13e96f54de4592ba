"""Four tests that only fabric can tell apart: grains, labkit's model, the two forms in it, and peers."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas
from scipy.stats import t

from analysis.hidden_state.contest import vector_of
from analysis.hidden_state.law import Constants
from analysis.hidden_state.loading import HELD_OUT
from analysis.hidden_state.table import Test
from analysis.peers.laws import PEERS
from analysis.places import results_folder
from labkit.micro import mean_stress
from labkit.model import Adaptive, ConstitutiveLaw, Model, Point, RateLaw
from labkit.paths import make_path

BEFORE = {"pre+": 1, "pre-": -1, "control": 0}
DIRECTIONS = {"compression": 1, "extension": -1}
STRAIN = 0.03
JUDGED_SEEDS = (*HELD_OUT, 5, 6)
LEAST = 1e-3  # least p/p_0 that is told apart from zero
ALIKE = 0.004  # largest difference of e between pre+ and pre-
GRAINS = "grains"
THERE = np.array([-0.5, -0.5, 1.0, 0.0, 0.0, 0.0])


def of_grains(tests: Sequence[Test]) -> pandas.DataFrame:
    """A row per test: labels, e, Z, A:n, F:n, F^t:n at the start (n: compression), least p/p_0 and |q| at the end."""
    rows = []
    n = THERE / np.linalg.norm(THERE)
    for test in tests:
        before, _, direction = test.name.partition(" ")
        if before not in BEFORE or direction not in DIRECTIONS:
            continue
        p = test["stress"][:, :3].mean(axis=1)
        fabric = {f"{name}_zz": test[name][0] @ n / np.sqrt(1.5) for name in ("A", "F", "Ft")}
        row = {"density": test.density, "seed": test.seed, "before": before, "direction": direction}
        row |= {"e": test["e"][0], "Z": test["Z"][0], **fabric, "model": GRAINS}
        rows.append(row | {"least": max(float((p / p[0]).min()), LEAST), "q_end": float(test["stress"][-1] @ THERE)})
    return pandas.DataFrame(rows)


def own_models() -> dict[str, Model]:
    """The stored models, beyond e_cmax too."""
    results = Path(results_folder())
    files = {"calibrated": results / "paper" / "calibrated.json", "better": results / "model_benchmark" / "better.json"}
    models = {name: Model.from_json(file.read_text(encoding="utf-8")) for name, file in files.items()}
    return {name: model.reading(beyond_e_cmax="flat") for name, model in models.items()}


def peer_laws() -> dict[str, RateLaw]:
    """The peers with the parameters of the benchmark."""
    file = Path(results_folder("model_benchmark")) / "peers.json"
    stored = json.loads(file.read_text(encoding="utf-8"))
    kinds = {kind.name: kind for kind in PEERS}
    return {name: kinds.get(name, kinds["acst"])(**values) for name, values in stored.items()}


def predictions(tests: Sequence[Test], laws: Mapping[str, ConstitutiveLaw], constants: Constants) -> pandas.DataFrame:
    """The rows of the grains, and the labels, e and `least` of each law; NaN if a law is undefined there."""
    grains = of_grains(tests)
    by_name = {(test.density, test.seed, test.name): test for test in tests}
    rows = [grains]
    for row in grains.to_dict("records"):
        test = by_name[row["density"], row["seed"], f"{row['before']} {row['direction']}"]
        sign = DIRECTIONS[row["direction"]]
        path = make_path("cv", {"strain": STRAIN * sign}).starting_at(float(test["stress"][0, :3].mean()))
        for name, law in laws.items():
            y = vector_of(name, law, test, constants)
            vectors = Point(law, path, y, Adaptive(), STRAIN / 60.0).result(None).vector
            p = mean_stress(np.array([law.stress(vector) for vector in vectors]))
            labels = {key: row[key] for key in ("density", "seed", "before", "direction", "e")}
            rows.append(pandas.DataFrame([labels | {"model": name, "least": max(float((p / p[0]).min()), LEAST)}]))
    return pandas.concat(rows, ignore_index=True)


def contrasts(table: pandas.DataFrame) -> pandas.DataFrame:
    """Mean of ln(least) along the pre-shear less that against it, a row per density, seed and model."""
    own = table[table["before"] != "control"].copy()
    along = own["before"].map(BEFORE) == own["direction"].map(DIRECTIONS)
    own["side"], own["ln"] = np.where(along, "along", "against"), np.log(own["least"])
    keys = ["density", "seed", "model"]
    sides = own.groupby([*keys, "side"], sort=False)["ln"].mean().unstack()
    spread = own.groupby([*keys], sort=False)["e"].agg(np.ptp)
    made = pandas.DataFrame({"contrast": sides["along"] - sides["against"], "e_difference": spread})
    return made.reset_index()


def judged_fabric(table: pandas.DataFrame) -> pandas.DataFrame:
    """Error of the least p/p_0 and contrast, a row per density and model; seeds JUDGED_SEEDS.

    Columns: error (root mean square over the four tests, mean over specimens), contrast, contrast_within (95 %, t),
    sign (share of specimens whose contrast has the sign of the grains'), specimens.
    """
    own = table[table["seed"].isin(JUDGED_SEEDS) & (table["before"] != "control")]
    keys = ["density", "seed", "before", "direction"]
    truth = own[own["model"] == GRAINS].set_index(keys)["least"]
    off = own.assign(off=own["least"] - truth.reindex(pandas.MultiIndex.from_frame(own[keys])).to_numpy())
    error = off.groupby(["density", "model", "seed"], sort=False)["off"].apply(lambda x: np.sqrt((x**2).mean()))
    difference = contrasts(own).set_index(["density", "model", "seed"])["contrast"]
    rows = []
    for (density, model), errors in error.groupby(level=[0, 1], sort=False):
        mine = difference[density, model]
        of_grains = difference[density, GRAINS].reindex(mine.index)
        count = len(mine)
        within = t.ppf(0.975, count - 1) * mine.std() / np.sqrt(count) if count > 1 else np.nan
        agree = float((np.sign(mine) == np.sign(of_grains)).mean())
        rows.append((density, model, errors.mean(), mine.mean(), within, agree, count))
    return pandas.DataFrame(rows, columns="density model error contrast contrast_within sign specimens".split())
