"""Statistics of a run, and the report of all: what comes after the runs. In the folder of a campaign."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

import labkit
from labkit.campaign.items import Run
from labkit.campaign.own_files import CAMPAIGN
from labkit.campaign.plan import FIGURES, REPORT, RUNS, STATISTICS, Job, Plan
from labkit.campaign.workflow import failures
from labkit.dem.limits import RECORDED, exceeded
from labkit.io.files import whole_file
from labkit.io.provenance import commit, data_sha256, libraries, machine, of_file, provenance, write_with_provenance
from labkit.io.schema import RECORD
from labkit.runs.critical import critical_states, is_shear
from labkit.runs.dataset import open_run
from labkit.runs.verify import SFF_PRESSURE

Numbers = dict[str, tuple[float, str, str]]  # name -> (value, units, long name)


def write_statistics(name: str) -> None:
    """Writes the numbers of a run: one value each, with units, and its parameters as attributes."""
    file = Path(RUNS) / f"{name}.run.nc"
    output = Path(STATISTICS) / f"{name}.nc"
    run = open_run(file)
    found = xr.Dataset(
        {
            key: ((), value, {"units": units, "long_name": long_name})
            for key, (value, units, long_name) in numbers(run).items()
        }
    )
    found["grains"] = (), run.sizes["grain"], {"units": "1", "long_name": "number of grains"}
    found.attrs = {
        "labkit_file": "statistics",
        "run": name,
        "run_data_sha256": run.attrs.get("data_sha256", ""),
        "path": run.attrs["path"],
        "engine": run.attrs["engine"],
        "outside_limits": "; ".join(map(str, exceeded({name: run[name].values for name in RECORDED}, run.lab.scene))),
        "provenance": provenance(inputs=[file], output=output, seed=run.attrs.get("seed")),
    }
    run.close()
    with whole_file(output) as temporary:
        found.to_netcdf(temporary, engine="netcdf4")
        with netCDF4.Dataset(temporary, "a") as written:
            written.data_sha256 = data_sha256(written)


def numbers(run: xr.Dataset) -> Numbers:
    """name -> (value, units, long name) of a run opened with labkit.open_run; its records are enough.

    What a run records beside labkit's own variables, a registered statistic, is there as its value at the end.
    """
    p, q = run.lab.mean_stress().values, run.lab.deviatoric_stress().values
    ratio = np.divide(q, p, out=np.full_like(q, np.nan), where=p > 0.0)
    error = run.lab.sff_error().values[p > SFF_PRESSURE]
    known = {
        "axial_strain_reached": (float(run["axial_strain"][-1]), "1", "axial strain at the end"),
        "initial_mean_stress": (float(p[0]), "Pa", "mean stress at the start"),
        "final_mean_stress": (float(p[-1]), "Pa", "mean stress at the end"),
        "peak_stress_ratio": (float(np.nanmax(ratio, initial=-np.inf)), "1", "largest q/p"),
        "initial_void_ratio": (float(run["void_ratio"][0]), "1", "void ratio at the start"),
        "final_void_ratio": (float(run["void_ratio"][-1]), "1", "void ratio at the end"),
        "initial_coordination_number": (float(run["coordination_number"][0]), "1", "coordination number at the start"),
        "final_coordination_number": (float(run["coordination_number"][-1]), "1", "coordination number at the end"),
        "largest_sff_error": (float(error.max()) if error.size else np.nan, "1", "error of C0 against Love, largest"),
        "steps": (float(run.attrs["steps"]), "1", "time steps"),
        "wall_time": (float(run.attrs["wall_time"]), "s", "time that the run took"),
    }
    if is_shear(run):
        end = critical_states({"run": run}).iloc[0]
        for key, long_name in CRITICAL.items():
            known[f"critical_{key}"] = float(end[key]), "1", long_name
    return {**known, **{f"final_{name}": _at_end(run[name]) for name in run.data_vars if _is_own(run[name])}}


def _is_own(variable: xr.DataArray) -> bool:
    """Whether it is a number of each record that labkit itself does not know."""
    return variable.dims == ("time",) and variable.name not in RECORD


def _at_end(variable: xr.DataArray) -> tuple[float, str, str]:
    known = variable.attrs
    return float(variable[-1]), known.get("units", "1"), f"{known.get('long_name', variable.name)}, at the end"


CRITICAL = {
    "M": "q/p over the last quarter of the strain",
    "Z": "coordination number there",
    "Lambda": "Lambda there",
    "A_zz": "contact anisotropy there",
    "F_zz": "anisotropy of normal forces there",
    "Ft_zz": "mobilisation there",
}


def write_report(plan: Plan) -> None:
    """Writes the page of the campaign: a row per run, what failed and why, and where it comes from."""
    rows = [row for job in plan.runs if (row := _row(job))]
    failed, waiting = failures(plan, ".")
    lines = [f"# Campaign {Path.cwd().name}", "", f"{len(rows)} of {len(plan.runs)} runs are finished.", ""]
    if failed:
        lines += ["## Failed", "", *(f"- {kind} `{name}`: {reason}" for kind, name, reason in failed), ""]
    if waiting:
        lines += [f"Not begun: {', '.join(waiting)}.", ""]
    if rows:
        lines += ["## Runs", "", *table(rows), ""]
        left = [f"- `{row['run']}`: {said}" for row in rows if (said := _attribute(row["run"], "outside_limits"))]
        lines += ["## Outside the limits", "", *left, ""] * bool(left)
        lines += ["## Figures", "", *(f"![{row['run']}]({FIGURES}/{row['run']}.png)" for row in rows), ""]
    lines += ["## Provenance", "", *_origin(rows)]
    write_with_provenance(REPORT, "\n".join(lines) + "\n", [Path(STATISTICS) / f"{row['run']}.nc" for row in rows])


def table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The lines of a Markdown table, with columns for the names of the first row."""
    cells = [list(rows[0]), ["---"] * len(rows[0]), *([_cell(value) for value in row.values()] for row in rows)]
    return [f"| {' | '.join(line)} |" for line in cells]


def _cell(value: Any) -> str:
    """NaN is empty."""
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return "" if text == "nan" else text


def _row(job: Job) -> dict[str, Any] | None:
    file = Path(STATISTICS) / f"{job.name}.nc"
    if not (file.exists() and Path(job.output).exists()):
        return None
    with xr.open_dataset(file) as found:
        value = {name: float(found[name]) for name in found}
    run = job.item
    assert isinstance(run, Run)
    return {
        "run": run.name,
        "path": run.path.name,
        "engine": run.engine,
        "specimen": run.specimen,
        "grains": int(value["grains"]),
        "p0, kPa": value["initial_mean_stress"] / 1e3,
        "p, kPa": value["final_mean_stress"] / 1e3,
        "e0": value["initial_void_ratio"],
        "e": value["final_void_ratio"],
        "Z": value["final_coordination_number"],
        "peak q/p": value["peak_stress_ratio"],
        "M": value.get("critical_M", np.nan),
        "C0 error, %": 100.0 * value["largest_sff_error"],
        "time, s": value["wall_time"],
    }


def _attribute(name: str, attribute: str) -> str:
    with xr.open_dataset(Path(STATISTICS) / f"{name}.nc") as found:
        return found.attrs[attribute]


def _origin(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    here = machine()
    made = {
        (known["labkit_version"], known["commit"] or "installed", known["machine"]["name"])
        for row in rows
        if (known := of_file(Path(RUNS) / f"{row['run']}.run.nc"))
    }
    yield f"- campaign file: `{CAMPAIGN}`; every file says with `labkit info FILE` what made it"
    for version, code, name in sorted(made):
        yield f"- runs by labkit {version}, {code}, on {name}"
    code = commit() or "installed"
    yield f"- this page by labkit {labkit.__version__}, {code}, on {here['name']} ({here['processor']})"
    yield f"- {', '.join(f'{name} {version}' for name, version in libraries().items())}"
