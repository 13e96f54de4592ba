"""Errors of the model over independent specimens, each test predicted by a calibration on the other paths."""

from __future__ import annotations

import numpy as np
import pandas

from analysis.model_evidence.calibrations import CALIBRATED, PATHS, TABLE_2, VARIANTS, Calibrations
from analysis.paper.ends import Runs
from analysis.paper.model_comparison import compare
from analysis.paper.specimens import specimen_of
from analysis.statistics import NOTHING, SIGNIFICANT, adjusted, cluster_mean, paired_difference
from labkit.model import Model

COMPLETE = 0.999  # share of the strain of a test
QUANTITIES = ("q_error", "p_error", "e_error_of_change")
TESTED = {CALIBRATED: TABLE_2} | {variant: CALIBRATED for variant in VARIANTS if variant != CALIBRATED}  # against
ALSO_TABLE_2 = {  # readings with the constants of Table 2
    "Table 2, C4 by distance": {"force_rate": "distance"},
    "Table 2, reported void ratio": {"line_void_ratio": "reported"},
}
TESTED |= dict.fromkeys(ALSO_TABLE_2, TABLE_2)


def test_errors(runs: Runs, calibrations: Calibrations) -> pandas.DataFrame:
    """Errors of every model in every test of the paper, a pandas.DataFrame with a row per test and model.

    The calibrated models are those fitted without the path of the test. Columns: run, specimen, path, model, q_error,
    p_error and e_error_of_change (analysis.paper.model_comparison.compare), reached, status.
    """
    tables = []
    for path in PATHS:
        own = {name: run for name, run in runs.items() if run.attrs["path"] == path}
        tables.append(errors_of_models(own, calibrations, path))
    table = pandas.concat(tables, ignore_index=True)
    table = table[table["model"] != "seed"]
    table.insert(1, "specimen", [specimen_of(str(run)) for run in table["run"]])
    return table


def errors_of_models(runs: Runs, calibrations: Calibrations, left_out: str) -> pandas.DataFrame:
    """The rows of `test_errors` for runs; the calibrated models are those fitted without the path `left_out`."""
    models = {TABLE_2: Model()} | {name: Model().reading(**readings) for name, readings in ALSO_TABLE_2.items()}
    models |= {variant: calibrations[variant, left_out] for variant in VARIANTS}
    table = compare(runs, {name: model.reading(beyond_e_cmax="flat") for name, model in models.items()})[0]
    return table.rename(columns={"parameters": "model"}).drop(columns=["calibrated_on", "e_error"])


def error_summary(errors: pandas.DataFrame) -> pandas.DataFrame:
    """Mean errors over specimens, a pandas.DataFrame with a row per path, quantity and model.

    A specimen counts once. `value` and `within` are the mean and its 95 % half-width. `against` names the model for
    comparison; `difference` and `difference_within` compare the errors on the same specimens, `p_value` comes from a
    paired t test, `corrected` is corrected for all rows (Holm), and the `verdict` is `better`, `worse` or `not
    resolved`. Tests that a model does not complete are left out; `completed` counts the others.
    """
    rows = []
    for path in dict.fromkeys(errors["path"]):
        own = errors[errors["path"] == path]
        for quantity in QUANTITIES:
            for model in dict.fromkeys(own["model"]):
                mine = own[own["model"] == model]
                if not np.isfinite(mine[quantity]).any():
                    continue
                found = cluster_mean(mine[quantity], mine["specimen"])
                completed = int((np.isfinite(mine[quantity]) & (mine["reached"] >= COMPLETE)).sum())
                against = TESTED.get(str(model), "")
                pair = paired_difference(own, quantity, "model", against, model) if against else NOTHING
                compared = against, pair.value, pair.within, pair.p_value
                row = path, quantity, model, len(mine), completed, found.n, found.value, found.within, *compared
                rows.append(row)
    columns = "path quantity model tests completed specimens value within against difference difference_within p_value"
    table = pandas.DataFrame(rows, columns=columns.split())
    table = judged(table, table["difference"] < 0.0)
    return table.assign(verdict=table["verdict"].where(table["against"] != "", ""))


def judged(table: pandas.DataFrame, better: pandas.Series) -> pandas.DataFrame:
    """The table with `corrected`, p_value for the number of rows (Holm), and `verdict`: better, worse, not resolved."""
    corrected = adjusted(table["p_value"].to_numpy(dtype=float))
    verdict = np.where(corrected <= SIGNIFICANT, np.where(better, "better", "worse"), "not resolved")
    return table.assign(corrected=corrected, verdict=verdict)


def combined(errors: pandas.DataFrame) -> pandas.DataFrame:
    """Each model against another over all paths and quantities at once, a pandas.DataFrame with a row per comparison.

    `ratio` is the ratio of the errors, the geometric mean over the quantities of a test, its tests and then the
    specimens, for tests that both complete; `low` and `high` bound its 95 % interval. `p_value` comes from a t test
    over specimens that the logarithm of the ratio is zero, `corrected` for the number of rows (Holm). `failed` counts
    tests that only `model` does not complete.
    """
    long = errors.melt(["run", "specimen", "path", "model", "reached"], QUANTITIES, "quantity", "error")
    long = long[np.isfinite(long["error"])]
    rows = []
    for model, other in TESTED.items():
        both = long[long["model"] == model].merge(
            long[long["model"] == other], on=["run", "specimen", "path", "quantity"], suffixes=("", "_other")
        )
        ratio = np.log(both["error"] / both["error_other"]).groupby([both["specimen"], both["run"]]).mean()
        found = cluster_mean(ratio.to_numpy(), ratio.index.get_level_values("specimen"))
        reached = errors.pivot_table(index="run", columns="model", values="reached")
        failed = int(((reached[model] < COMPLETE) & (reached[other] >= COMPLETE)).sum())
        interval = (float(np.exp(found.value + by)) for by in (0.0, -found.within, found.within))
        rows.append((model, other, len(ratio), found.n, *interval, found.p_value, failed))
    columns = "model against tests specimens ratio low high p_value failed".split()
    table = pandas.DataFrame(rows, columns=columns)
    return judged(table, table["ratio"] < 1.0)
