"""The constitutive model against the simulations: calibrated on some tests, followed along all, errors of q, p, e."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
import pandas
import xarray as xr

import labkit as lk
from analysis import markdown
from analysis.netcdf import characters
from analysis.paper.ends import Runs, main
from analysis.paper.model_runs import follow
from labkit.dem import travelled
from labkit.errors import InputError
from labkit.io import RECORD, provenance_json, whole_file
from labkit.model import MODEL_ENGINE, Fit, Model, fit, observe, records

TABLE_2, OURS, SEED = "table_2", "ours", "seed"
WORDS = {TABLE_2: "Table 2", OURS: "our parameters", SEED: "another seed"}
CALIBRATED_ON = r"(cv|cp_500kPa|cr_1MPa)-(dense|medium|loose)|iso[cd]-.*"
CHECKED_ON = r"(cv|cv_other|cp_1MPa|cr_500kPa)-.*"  # of these, those that are not in CALIBRATED_ON
NOT_CALIBRATED = r"cyclic-.*|cp_start-.*"
STORED = (
    "axial_strain",
    "stress",
    "void_ratio",
    "coordination_number",
    "mean_normalised_force",
    "contact_anisotropy",
    "normal_force_anisotropy",
    "mobilisation",
)
KINDS = {"cv": "CV", "cr": "CR", "cp": "CP", "isoc": "ISOC", "isod": "ISOD", "cyclic_cp": "cyclic CP"}
FAILS = 1.5  # times the error of q: from there the void ratio is said to fail


def calibrate(runs: Runs) -> tuple[Fit | None, Fit | None]:
    """(Fit to the tests of CALIBRATED_ON, Fit to as many others, which tells how far parameters depend on the choice).

    Either is None if there are no such tests. `runs`: of analysis.paper.ends.in_memory.
    """
    own = main(runs)
    first = {name: run for name, run in own.items() if re.fullmatch(CALIBRATED_ON, name)}
    other = {name: run for name, run in own.items() if re.fullmatch(CHECKED_ON, name) and name not in first}
    return _fit(first), _fit(other)


def _fit(runs):
    observations = []
    for name, run in runs.items():
        try:
            observations.append(observe(name, run))
        except InputError:
            continue  # a test that lost its contacts at once has nothing to fit
    return fit(observations) if observations else None


def parameters(found: Fit | None, other: Fit | None) -> pandas.DataFrame:
    """Table 2 beside ours, a pandas.DataFrame: parameter, table_2, ours, low and high (95 %, of the fit), determined,
    table_2_inside, other_tests (the same fitted to other tests), other_inside: whether that is within low and high.

    `found`, `other`: of calibrate(). The interval holds for the model being true and for these tests; what other tests
    give tells how far that is so.
    """
    if found is None:
        return pandas.DataFrame(columns=PARAMETER_COLUMNS)
    rows = found.table.rename(columns={"fitted": "ours"}).set_index("parameter")
    rows["table_2_inside"] = (rows["low"] <= rows["table_2"]) & (rows["table_2"] <= rows["high"])
    if other is not None:
        second = other.table.set_index("parameter")
        rows["other_tests"] = second["fitted"].where(second["determined"])
        inside = (rows["low"] <= rows["other_tests"]) & (rows["other_tests"] <= rows["high"])
        rows["other_inside"] = inside.astype(object).where(rows["other_tests"].notna())
    return rows.reset_index().reindex(columns=PARAMETER_COLUMNS)


PARAMETER_COLUMNS = (
    "parameter",
    "table_2",
    "ours",
    "low",
    "high",
    "determined",
    "table_2_inside",
    "other_tests",
    "other_inside",
)


def models(found: Fit | None) -> dict[str, Model]:
    """Name -> Model with the reading beyond_e_cmax = flat: Table 2 and, if there is a Fit, ours."""
    chosen = {TABLE_2: Model()} | ({OURS: found.model} if found else {})
    return {name: model.reading(beyond_e_cmax="flat") for name, model in chosen.items()}


def compare(runs: Runs, chosen: Mapping[str, Model]) -> tuple[pandas.DataFrame, xr.Dataset]:
    """The models (name -> Model) along every run: (pandas.DataFrame of errors, xarray.Dataset of the model's records).

    Errors are root mean squares over the strain that both have travelled. q_error: over the largest |q| of the
    simulation; p_error: over its mean p; e_error: of the nominal void ratio as it is; e_error_of_change: over the range
    of e in the simulation. NaN where a path prescribes the quantity. reached: share of the strain of the run that the
    model goes; status: why it ends there. Rows of parameters `seed` have the simulation of the first seed in the place
    of the model: what chance alone makes.
    """
    rows, results = [], {}
    for name, run in runs.items():
        for label, model in chosen.items():
            result, status = _followed(run, model)
            used = bool(re.fullmatch(CALIBRATED_ON, name)) and label == OURS
            row = {"run": name, "path": run.attrs["path"], "parameters": label, "calibrated_on": used}
            rows.append(row | {"status": status, "reached": 0.0})
            if result:
                rows[-1] |= _errors(run, *_of_result(result))
                results[name, label] = result
        first = runs.get(re.sub(r"_more-s\d+$", "", name))
        if first is not None and first is not run:
            row = {"run": name, "path": run.attrs["path"], "parameters": SEED, "calibrated_on": False}
            gone = travelled(first["axial_strain"].values)
            rows.append({**row, **_errors(run, gone, _measured(first)), "status": ""})
    return pandas.DataFrame(rows, columns=ERROR_COLUMNS), _dataset(results)


def _followed(run, model):
    """(Result of the model along the path of a run, or None; why it ended early, or an empty text)."""
    try:
        result = follow(run, model)
    except InputError as error:
        return None, str(error)
    return result, result.failure or ""


FAR_ENOUGH = 0.1  # of the strain of a test: a model that ends before has no error
ERROR_COLUMNS = (
    "run",
    "path",
    "parameters",
    "calibrated_on",
    "q_error",
    "p_error",
    "e_error",
    "e_error_of_change",
    "reached",
    "status",
)


def _of_result(result):
    """(strain travelled, q, p and e) of the model."""
    return travelled(result.axial_strain), {"q": result.q, "p": result.p, "e": result.e}


def _measured(run):
    return {
        "q": run.lab.deviatoric_stress().values,
        "p": run.lab.mean_stress().values,
        "e": run["void_ratio_nominal"].values,
    }


def _errors(run, gone, predicted):
    """The errors of a prediction after the strains `gone`; NaN for what the path gives, and for all if it ends soon."""
    way, measured = travelled(run["axial_strain"].values), _measured(run)
    both = way <= gone[-1] * (1.0 + 1e-9)
    off = {key: _rms(np.interp(way, gone, predicted[key])[both] - measured[key][both]) for key in measured}
    given = {"cv": "e", "cp": "p", "cyclic_cp": "p", "isoc": "qe", "isod": "qe"}.get(run.attrs["path"], "")
    reached = float(min(gone[-1] / way[-1], 1.0)) if way[-1] else 0.0
    off |= {key: np.nan for key in (given if reached >= FAR_ENOUGH else off)}
    return {
        "q_error": off["q"] / np.abs(measured["q"]).max(),
        "p_error": off["p"] / measured["p"].mean(),
        "e_error": off["e"],
        "e_error_of_change": off["e"] / max(np.ptp(measured["e"]), 1e-12),
        "reached": reached,
    }


def _rms(values):
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def _dataset(results):
    """All Results as one Dataset (run, parameters, record), STORED; shorter ones end in NaN."""
    names = list(dict.fromkeys(name for name, _ in results))
    labels = list(dict.fromkeys(label for _, label in results))
    longest = max((len(result) for result in results.values()), default=0)
    columns = {}
    for key in STORED:
        inner = RECORD[key].dimensions[1:]
        values = np.full((len(names), len(labels), longest, *(3 for _ in inner)), np.nan, dtype="f4")
        for (name, label), result in results.items():
            values[names.index(name), labels.index(label), : len(result)] = records(result)[key]
        words = {"units": RECORD[key].units, "long_name": RECORD[key].long_name}
        columns[key] = (("run", "parameters", "record", *inner), values, words)
    path = ("run", [next(r.path.name for (n, _), r in results.items() if n == name) for name in names])
    attributes = {
        "Conventions": "CF-1.10",
        "labkit_version": lk.__version__,
        "title": "the constitutive model along the tests of the campaign",
    }
    return xr.Dataset(columns, {"run": names, "parameters": labels, "path": path}, attributes)


def write_model(
    file: str | Path, data: xr.Dataset, command: str | None = None, inputs: Iterable[str | Path] = ()
) -> None:
    """Writes the Dataset of compare(), whole or not at all."""
    with whole_file(file) as temporary:
        data = data.assign_attrs(provenance=provenance_json(command, inputs, file))
        coding = {key: {"zlib": True, "complevel": 4} for key in STORED}
        data.to_netcdf(temporary, encoding=coding | characters(data))


def open_model(file: str | Path) -> dict[str, dict[str, xr.Dataset]]:
    """name of a run -> (`table_2` or `ours` -> the model along its path), as labkit.open_run would give it.

    `file`: model.nc. The stress of C0 is the stress of the model, and its only void ratio is the nominal one.
    """
    with xr.open_dataset(file) as data:
        data = data.load()
    return {
        str(name): {
            str(label): run
            for label in data["parameters"].values
            for run in [_as_run(data.sel(run=name, parameters=label))]
            if run.sizes["time"]
        }
        for name in data["run"].values
    }


def _as_run(test):
    path = str(test["path"].values)
    run = test.drop_vars(["run", "parameters", "path"]).rename(record="time").dropna("time", subset=["axial_strain"])
    run = run.assign(stress_sff=run["stress"], void_ratio_nominal=run["void_ratio"])
    return run.assign_attrs(engine=MODEL_ENGINE, path=path).set_coords("axial_strain")


def summary(errors: pandas.DataFrame, table: Callable[..., str] = markdown.table) -> str:
    """What the comparison says, as Markdown: medians by kind of test, where the model fails, the errors per test.

    `errors`: of compare(), or read from model_errors.csv; `table`: makes a table of a header and rows of text.
    """
    kinds = errors.assign(kind=errors["path"].map(KINDS))
    rows = []
    for kind in dict.fromkeys(KINDS.values()):
        for label, words in WORDS.items():
            own = kinds[(kinds["kind"] == kind) & (kinds["parameters"] == label)]
            if len(own):
                rows.append(
                    [
                        kind,
                        words,
                        str(len(own)),
                        *(_percent(own[key].median()) for key in SHOWN),
                        f"{own['reached'].min():.0%}",
                    ]
                )
    header = ("tests", "parameters", "number", "q", "p", "e, of its change", "reached, at least")
    parts = [
        "Median errors (RMS over the strain): of q over the largest q, of p over the mean p, of e over its change.",
        table(header, rows),
        "\n".join(failures(errors)),
        _per_test(errors, table),
    ]
    used = errors["run"][errors["calibrated_on"].astype(bool)]
    if len(used):
        parts.insert(0, f"Our parameters are fitted to {', '.join(used)}; all other tests are predictions with them.")
    return "\n\n".join(part for part in parts if part)


SHOWN = ("q_error", "p_error", "e_error_of_change")


def failures(errors: pandas.DataFrame) -> list[str]:
    """Sentences on what the paper says of its own model: that the void ratio fails in stress-controlled and cyclic
    tests. Seen: its error, over its change, is more than FAILS times the error of q over the largest q.
    """
    found = []
    for words, paths in (("stress-controlled tests (CR, CP)", ("cr", "cp")), ("cyclic tests", ("cyclic_cp",))):
        for label in (TABLE_2, OURS):
            own = errors[errors["path"].isin(paths) & (errors["parameters"] == label)]
            e, q = own["e_error_of_change"].median(), own["q_error"].median()
            if not np.isfinite(e):
                continue
            seen = "seen" if e > FAILS * q else "not seen"
            found.append(
                f"- Void ratio in {words}, {WORDS[label]}: off by {e:.0%} of its change, q by {q:.0%} of its largest "
                f"value: the paper's failure is {seen}."
            )
    early = errors[errors["status"].fillna("").ne("") & (errors["reached"] < 1.0)]
    for row in early.itertuples():
        found.append(
            f"- {row.run}, {WORDS[row.parameters]}: the model ends after {row.reached:.0%} of the strain "
            f"({row.status})."
        )
    return found


def _per_test(errors, table):
    wide = errors.pivot(index="run", columns="parameters", values=[*SHOWN, "reached"])
    present = [label for label in (TABLE_2, OURS) if label in errors["parameters"].values]
    rows = [
        [
            name,
            *(
                _percent(wide.loc[name, (key, label)], wide.loc[name, ("reached", label)])
                for key in SHOWN
                for label in present
            ),
        ]
        for name in dict.fromkeys(errors["run"])
    ]
    names = {"q_error": "q", "p_error": "p", "e_error_of_change": "e"}
    header = ["test", *(f"{names[key]}, {WORDS[label]}" for key in SHOWN for label in present)]
    return table(header, rows) if rows else ""


def _percent(value, reached=1.0):
    return f"{value:.1%}" if np.isfinite(value) else "given" if reached >= FAR_ENOUGH else "ended"


def as_json(found: Fit) -> str:
    """What `labkit model --parameters` reads."""
    return found.model.reading(beyond_e_cmax="error").to_json() + "\n"
