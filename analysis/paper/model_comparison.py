"""The constitutive model against the simulations: calibrated on some tests, compared with all; errors of q, p and e."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas
import xarray as xr

from analysis.paper.ends import Runs, main
from analysis.paper.model_runs import follow
from labkit.errors import InputError
from labkit.model import Fit, Model, Result, fit, observe
from labkit.paths import accumulated_strain

TABLE_2, OURS, SEED = "table_2", "ours", "seed"
LABELS = {TABLE_2: "Table 2", OURS: "our parameters", SEED: "another seed"}
CALIBRATED_ON = r"(cv|cp_500kPa|cr_1MPa)-(dense|medium|loose)|iso[cd]-.*"
CHECKED_ON = r"(cv|cv_other|cp_1MPa|cr_500kPa)-.*"  # those of these tests that do not match CALIBRATED_ON


def calibrate(runs: Runs) -> tuple[Fit | None, Fit | None]:
    """(Fit to the tests of CALIBRATED_ON, Fit to other tests), to show how much parameters depend on the choice.

    Either is None without such tests. The runs are those of analysis.paper.ends.in_memory.
    """
    own = main(runs)
    first = {name: run for name, run in own.items() if re.fullmatch(CALIBRATED_ON, name)}
    other = {name: run for name, run in own.items() if re.fullmatch(CHECKED_ON, name) and name not in first}
    return _fit(first), _fit(other)


def _fit(runs: Runs) -> Fit | None:
    observations = []
    for name, run in runs.items():
        try:
            observations.append(observe(name, run))
        except InputError:
            continue  # a test without contacts cannot be fitted
    return fit(observations) if observations else None


def parameters(found: Fit | None, other: Fit | None) -> pandas.DataFrame:
    """Parameters of Table 2 and ours, a pandas.DataFrame.

    Columns: parameter, table_2, ours, low and high (95 % interval of the fit), determined, table_2_inside, other_tests
    (the fit to other tests), other_inside. The two `_inside` columns are True if the value lies between low and high.

    `found`, `other`: results of calibrate(). The interval assumes that the model is correct and covers these tests
    only; the fit to other tests shows how far that assumption holds.
    """
    if found is None:
        return pandas.DataFrame(columns=list(PARAMETER_COLUMNS))
    rows = found.table.rename(columns={"fitted": "ours"}).set_index("parameter")
    rows["table_2_inside"] = (rows["low"] <= rows["table_2"]) & (rows["table_2"] <= rows["high"])
    if other is not None:
        second = other.table.set_index("parameter")
        rows["other_tests"] = second["fitted"].where(second["determined"])
        inside = (rows["low"] <= rows["other_tests"]) & (rows["other_tests"] <= rows["high"])
        rows["other_inside"] = inside.astype(object).where(rows["other_tests"].notna())
    return rows.reset_index().reindex(columns=list(PARAMETER_COLUMNS))


PARAMETER_COLUMNS = "parameter table_2 ours low high determined table_2_inside other_tests other_inside".split()


def models(found: Fit | None) -> dict[str, Model]:
    """Name -> Model with beyond_e_cmax = flat: Table 2 and, with a Fit, ours."""
    chosen = {TABLE_2: Model()} | ({OURS: found.model} if found else {})
    return {name: model.reading(beyond_e_cmax="flat") for name, model in chosen.items()}


def compare(runs: Runs, chosen: Mapping[str, Model]) -> pandas.DataFrame:
    """Runs the models (name -> Model) along every run and returns a pandas.DataFrame of their errors.

    Errors are root mean squares over the accumulated strain that both cover: `q_error` relative to the largest |q| of
    the simulation, `p_error` relative to its mean p, `e_error` is the absolute error of the nominal void ratio, and
    `e_error_of_change` is relative to the range of e in the simulation. They are NaN if the path prescribes the
    quantity. `reached` is the share of the run's strain that the model completes, and `status` says why it stops
    early. In rows with parameters `seed` the simulation of the first seed replaces the model; they show the error due
    to chance.
    """
    rows: list[dict[str, Any]] = []
    for name, run in runs.items():
        for label, model in chosen.items():
            result, status = _followed(run, model)
            used = bool(re.fullmatch(CALIBRATED_ON, name)) and label == OURS
            row = {"run": name, "path": run.attrs["path"], "parameters": label, "calibrated_on": used}
            rows.append(row | {"status": status, "reached": 0.0})
            if result:
                predicted = {"q": result.q, "p": result.p, "e": result.e}
                rows[-1] |= _errors(run, accumulated_strain(result.axial_strain), predicted)
        first = runs.get(re.sub(r"_more-s\d+$", "", name))
        if first is not None and first is not run:
            row = {"run": name, "path": run.attrs["path"], "parameters": SEED, "calibrated_on": False}
            strain = accumulated_strain(first["axial_strain"].values)
            rows.append({**row, **_errors(run, strain, _measured(first)), "status": ""})
    return pandas.DataFrame(rows, columns=list(ERROR_COLUMNS))


def _followed(run: xr.Dataset, model: Model) -> tuple[Result | None, str]:
    """(Result of the model along the path of a run, or None; why it stopped early, or an empty string)."""
    try:
        result = follow(run, model)
    except InputError as error:
        return None, str(error)
    return result, result.failure or ""


FAR_ENOUGH = 0.1  # share of the strain of a test; a model that stops earlier has no error
ERROR_COLUMNS = "run path parameters calibrated_on q_error p_error e_error e_error_of_change reached status".split()


def _measured(run: xr.Dataset) -> dict[str, np.ndarray]:
    return {
        "q": run.lab.deviatoric_stress().values,
        "p": run.lab.mean_stress().values,
        "e": run["void_ratio_nominal"].values,
    }


def _errors(run: xr.Dataset, strain: np.ndarray, predicted: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Errors of a prediction at the accumulated strains `strain`.

    NaN for quantities that the path prescribes, and for all if the prediction stops before FAR_ENOUGH.
    """
    along, measured = accumulated_strain(run["axial_strain"].values), _measured(run)
    both = along <= strain[-1] * (1.0 + 1e-9)
    off = {key: _rms(np.interp(along, strain, predicted[key])[both] - measured[key][both]) for key in measured}
    given = {"cv": "e", "cp": "p", "cyclic_cp": "p", "isoc": "qe", "isod": "qe"}.get(run.attrs["path"], "")
    reached = float(min(strain[-1] / along[-1], 1.0)) if along[-1] else 0.0
    off |= {key: np.nan for key in (given if reached >= FAR_ENOUGH else off)}
    return {
        "q_error": off["q"] / np.abs(measured["q"]).max(),
        "p_error": off["p"] / measured["p"].mean(),
        "e_error": off["e"],
        "e_error_of_change": off["e"] / max(np.ptp(measured["e"]), 1e-12),
        "reached": reached,
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def as_json(found: Fit) -> str:
    """The fitted parameters as JSON for `labkit model --parameters`."""
    return found.model.reading(beyond_e_cmax="error").to_json() + "\n"
