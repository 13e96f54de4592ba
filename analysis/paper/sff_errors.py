"""Error of C0 against Love's stress in each test, split into its causes; in p, q and q/p also over specimens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas
import xarray as xr

from analysis.paper.ends import Runs
from analysis.paper.specimens import specimen_of
from analysis.statistics import adjusted, cluster_mean
from labkit.micro import mean_stress, relative_error
from labkit.results import SFF_PRESSURE, SFF_TOLERANCE
from labkit.sff import PARTS

BETTER = ("c0_volume", "fourth")  # forms that drop equal stress in all sizes, and also second order
RECORDED = "run path grains records worst worst_strain worst_p_MPa mean over snapshot_strain snapshot_error".split()
COLUMNS = (*RECORDED, *BETTER, *PARTS, "explanation")


def sff_errors(runs: Runs) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per monotonic test: the error of C0 over the records with p > 50 kPa.

    `worst` (at worst_strain and worst_p_MPa) and `mean` are Frobenius norms of the error divided by the norm of Love's
    stress, and `over` is the number of records above 2 %. The other columns are for the worst snapshot with contacts:
    `snapshot_error`, the error of the forms of labkit.sff that drop an assumption of C0, and the share of each part of
    the error budget. The shares add up to 1; a negative share reduces the error.
    """
    monotonic = {name: run for name, run in runs.items() if run.attrs["path"] != "cyclic_cp"}
    return pandas.DataFrame([_row(name, run) for name, run in monotonic.items()], columns=COLUMNS)


def _row(name: str, run: xr.Dataset) -> dict[str, Any]:
    p, error = run.lab.mean_stress().values, run.lab.sff_error().values
    judged = np.flatnonzero((p > SFF_PRESSURE) & np.isfinite(error))
    row: dict[str, Any] = {"run": name, "path": run.attrs["path"], "grains": run.sizes["grain"], "records": len(judged)}
    if not len(judged):
        return {**row, "explanation": "no record with p > 50 kPa"}
    worst = judged[np.argmax(error[judged])]
    over = int(np.sum(error[judged] > SFF_TOLERANCE))
    row |= {
        "worst": error[worst],
        "worst_strain": float(run["axial_strain"][worst]),
        "worst_p_MPa": p[worst] / 1e6,
        "mean": error[judged].mean(),
        "over": over,
    }
    statistics = _derived(run)
    if statistics is None:
        return {**row, "explanation": "no snapshot with contacts" if over else ""}
    budget = _budget(run, statistics)
    explanation = _explanation(budget) if over and "snapshot_error" in budget else ""
    return {**row, **budget, "explanation": explanation}


def _derived(run: xr.Dataset) -> xr.Dataset | None:
    """error_budget, stress_family and record along the snapshots, read from the file or computed from its contacts.

    None without either.
    """
    source = run.encoding.get("source")
    if source:
        try:
            with xr.open_dataset(source, group="derived") as stored:
                return stored[["error_budget", "stress_family", "record"]].load()
        except (OSError, KeyError):
            pass
    if not run.sizes.get("snapshot"):
        return None
    family = run.lab.sff_family(BETTER)
    return xr.Dataset({"error_budget": run.lab.error_budget(), "stress_family": family, "record": run["record"]})


def _budget(run: xr.Dataset, statistics: xr.Dataset) -> dict[str, float]:
    """Columns for the worst snapshot with p > 50 kPa."""
    love = run["stress"].values[statistics["record"].values.astype(int)].astype(float)
    total = statistics["error_budget"].values.sum(axis=statistics["error_budget"].get_axis_num("part"))
    error = np.where(mean_stress(love) > SFF_PRESSURE, relative_error(love + total, love), -1.0)
    if not len(error) or error.max() < 0.0:
        return {}
    k = int(np.argmax(error))
    parts = statistics["error_budget"].isel(snapshot=k)
    shares = {name: float(np.sum(parts.sel(part=name).values * total[k]) / np.sum(total[k] ** 2)) for name in PARTS}
    forms = {
        name: float(relative_error(statistics["stress_family"].isel(snapshot=k).sel(form=name).values, love[k]))
        for name in BETTER
    }
    strain = float(run["axial_strain"][int(statistics["record"][k])])
    return {"snapshot_strain": strain, "snapshot_error": float(error[k]), **forms, **shares}


def _explanation(budget: Mapping[str, float]) -> str:
    order = sorted(PARTS, key=lambda name: -budget[name])
    shares = [f"{PARTS[name]} {budget[name]:+.0%}" for name in order if abs(budget[name]) >= 0.1]
    return (
        f"shares of the error of {budget['snapshot_error']:.1%} at {budget['snapshot_strain']:.1%} strain: "
        + ", ".join(shares)
        + f"; error {budget['c0_volume']:.2%} without the assumption of equal stress in all sizes (form c0_volume), "
        f"{budget['fourth']:.2%} with fourth-order tensors as well (form fourth)"
    )


QUANTITIES = ("p", "q", "ratio")


def c0_errors(runs: Runs) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per test and quantity (p, q, ratio = q/p), over the records with p > 50 kPa.

    `bias` is the mean relative error with its sign, and `lowest` and `highest` are those of single records. q and q/p
    are judged where |q| >= 0.2 p; a test that is never sheared that far has no row for them.
    """
    rows = []
    for name, run in runs.items():
        judged = run.lab.mean_stress().values > SFF_PRESSURE
        errors = run.lab.sff_errors()
        for quantity in QUANTITIES:
            error = errors[quantity].values[judged].astype(float)
            error = error[np.isfinite(error)]
            if len(error):
                rms = float(np.sqrt(np.mean(error**2)))
                test = name, specimen_of(name), run.attrs["path"]
                rows.append((*test, quantity, len(error), error.mean(), rms, error.min(), error.max()))
    columns = ["run", "specimen", "path", "quantity", "records", "bias", "rms", "lowest", "highest"]
    return pandas.DataFrame(rows, columns=columns)


def c0_bias(errors: pandas.DataFrame) -> pandas.DataFrame:
    """Bias over independent specimens, a pandas.DataFrame with a row per path (and `shear`) and quantity.

    `errors` is the table of c0_errors. `bias` and `within` are the mean over specimens with its 95 % half-width,
    `p_value` comes from the t test that the bias is zero, `corrected` for the number of rows (Holm), `rms` is the mean
    of the tests' values, and `low` counts tests with a negative bias.
    """
    rows = []
    shear = errors[errors["path"].isin(("cv", "cr", "cp"))].assign(path="shear")
    for (path, quantity), group in pandas.concat([shear, errors]).groupby(["path", "quantity"], sort=False):
        found = cluster_mean(group["bias"], group["specimen"])
        rows.append(
            {
                "path": path,
                "quantity": quantity,
                "tests": len(group),
                **found.columns("bias"),
                "rms": group["rms"].mean(),
                "least_rms": group["rms"].min(),
                "most_rms": group["rms"].max(),
                "low": int((group["bias"] < 0.0).sum()),
            }
        )
    columns = ["path", "quantity", "tests", "specimens", "bias", "within", "p_value"]
    table = pandas.DataFrame(rows, columns=[*columns, "rms", "least_rms", "most_rms", "low"])
    table.insert(7, "corrected", adjusted(table["p_value"].to_numpy(dtype=float)))
    return table
