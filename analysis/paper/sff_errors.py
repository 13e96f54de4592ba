"""How close C0 is to Love's stress in every monotonic test, and what the error is made of where it is largest."""

from __future__ import annotations

import numpy as np
import pandas
import xarray as xr

from analysis.paper.ends import Runs
from labkit.micro import mean_stress, relative_error
from labkit.runs import SFF_PRESSURE, SFF_TOLERANCE
from labkit.sff import PARTS

BETTER = ("c0_volume", "fourth")  # forms without C0's assumptions: of equal stress of all sizes; and of second order
COLUMNS = (
    "run",
    "path",
    "grains",
    "records",
    "worst",
    "worst_strain",
    "worst_p_MPa",
    "mean",
    "over",
    "snapshot_strain",
    "snapshot_error",
    *BETTER,
    *PARTS,
    "explanation",
)


def sff_errors(runs: Runs) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per monotonic test: the error of C0 over the records with p > 50 kPa.

    worst (at worst_strain and worst_p_MPa), mean: Frobenius norm over that of Love; over: records over 2 %. At the
    worst of the snapshots whose contacts are known: snapshot_error, the error of the forms of labkit.sff that leave an
    assumption of C0 out, and the share of each part of its budget in the error; the shares add up to 1,
    a negative one takes off from the error.
    """
    monotonic = {name: run for name, run in runs.items() if run.attrs["path"] != "cyclic_cp"}
    return pandas.DataFrame([_row(name, run) for name, run in monotonic.items()], columns=COLUMNS)


def _row(name, run):
    p, error = run.lab.mean_stress().values, run.lab.sff_error().values
    judged = np.flatnonzero((p > SFF_PRESSURE) & np.isfinite(error))
    row = {"run": name, "path": run.attrs["path"], "grains": run.sizes["grain"], "records": len(judged)}
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
    told = _derived(run)
    if told is None:
        return {**row, "explanation": "the contacts of no snapshot are known" if over else ""}
    found = _budget(run, told)
    words = _words(found) if over and "snapshot_error" in found else ""
    return {**row, **found, "explanation": words}


def _derived(run):
    """error_budget, stress_family and record along the snapshots: those that the file holds, or from its contacts;
    None without either.
    """
    source = run.encoding.get("source")
    if source:
        try:
            with xr.open_dataset(source, group="derived") as told:
                return told[["error_budget", "stress_family", "record"]].load()
        except (OSError, KeyError):
            pass
    if not run.sizes.get("snapshot"):
        return None
    family = run.lab.sff_family(BETTER)
    return xr.Dataset({"error_budget": run.lab.error_budget(), "stress_family": family, "record": run["record"]})


def _budget(run, told):
    """The columns of the worst snapshot with p > 50 kPa."""
    love = run["stress"].values[told["record"].values.astype(int)].astype(float)
    total = told["error_budget"].values.sum(axis=told["error_budget"].get_axis_num("part"))
    error = np.where(mean_stress(love) > SFF_PRESSURE, relative_error(love + total, love), -1.0)
    if not len(error) or error.max() < 0.0:
        return {}
    k = int(np.argmax(error))
    parts = told["error_budget"].isel(snapshot=k)
    shares = {name: float(np.sum(parts.sel(part=name).values * total[k]) / np.sum(total[k] ** 2)) for name in PARTS}
    forms = {
        name: float(relative_error(told["stress_family"].isel(snapshot=k).sel(form=name).values, love[k]))
        for name in BETTER
    }
    strain = float(run["axial_strain"][int(told["record"][k])])
    return {"snapshot_strain": strain, "snapshot_error": float(error[k]), **forms, **shares}


def _words(found):
    order = sorted(PARTS, key=lambda name: -found[name])
    adding = [f"{PARTS[name]} {found[name]:+.0%}" for name in order if abs(found[name]) >= 0.1]
    return (
        f"at {found['snapshot_strain']:.1%} strain the error of {found['snapshot_error']:.1%} is "
        + ", ".join(adding)
        + f"; {found['c0_volume']:.2%} without the assumption of equal stress (c0_volume), "
        f"{found['fourth']:.2%} with fourth orders too"
    )
