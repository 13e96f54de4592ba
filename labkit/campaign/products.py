"""Statistics, figure and report: what comes after the runs.

`python -m labkit.campaign.products statistics NAME`, `figure NAME` or `report`, in the folder of a campaign.
"""

from __future__ import annotations

import sys
from pathlib import Path

import netCDF4
import numpy as np
import pandas
import xarray as xr

import labkit
from labkit.visuals import markdown
from labkit.visuals import plots
from labkit.campaign.file import read_campaign
from labkit.campaign.plan import CAMPAIGN, FIGURES, REPORT, RUNS, STATISTICS, plan_of
from labkit.campaign.workflow import failures
from labkit.runs.critical import SHEAR, critical_states
from labkit.engines.yade_process import die_with_parent
from labkit.errors import InputError, PhysicsError, fail
from labkit.io.files import whole_file
from labkit.dem.limits import RECORDED, exceeded
from labkit.io.provenance import commit, data_sha256, libraries, machine, of_file, provenance, write_told
from labkit.runs.verify import SFF_PRESSURE


def statistics(name):
    """Writes the numbers of a run: one value each, with units, and its parameters as attributes."""
    file = Path(RUNS) / f"{name}.run.nc"
    output = Path(STATISTICS) / f"{name}.nc"
    run = labkit.open_run(file)
    found = xr.Dataset({key: ((), value, {"units": units, "long_name": words})
                        for key, (value, units, words) in numbers(run).items()})  # fmt: skip
    found["grains"] = (), run.sizes["grain"], {"units": "1", "long_name": "number of grains"}
    found.attrs = {
        "labkit_file": "statistics", "run": name, "run_data_sha256": run.attrs.get("data_sha256", ""),
        "path": run.attrs["path"], "engine": run.attrs["engine"],
        "outside_limits": " ".join(exceeded({name: run[name].values for name in RECORDED})),
        "provenance": provenance(inputs=[file], output=output, seed=run.attrs.get("seed")),
    }  # fmt: skip
    run.close()
    with whole_file(output) as temporary:
        found.to_netcdf(temporary, engine="netcdf4")
        with netCDF4.Dataset(temporary, "a") as written:
            written.data_sha256 = data_sha256(written)


def numbers(run):
    """name -> (value, units, words) of a run opened with labkit.open_run; its records are enough."""
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
    if run.attrs["path"] in SHEAR:
        end = critical_states({"run": run}).iloc[0]
        for key, words in CRITICAL.items():
            known[f"critical_{key}"] = float(end[key]), "1", words
    return known


CRITICAL = {
    "M": "q/p over the last quarter of the strain", "Z": "coordination number there", "Lambda": "Lambda there",
    "A_zz": "contact anisotropy there", "F_zz": "anisotropy of normal forces there", "Ft_zz": "mobilisation there",
}  # fmt: skip


def figure(name):
    """Draws Love's stress and C0 along a run."""
    file = Path(RUNS) / f"{name}.run.nc"
    plots.save(plots.sff_against_love({name: labkit.open_run(file)}), Path(FIGURES) / f"{name}.png", [file])


def report():
    """Writes the page of the campaign: a row per run, what failed and why, and where it comes from."""
    plan = plan_of(read_campaign(CAMPAIGN))
    folder = Path.cwd().name
    rows = [row for job in plan.runs if (row := _row(job))]
    failed, waiting = failures(plan, ".")
    lines = [f"# Campaign {folder}", "", f"{len(rows)} of {len(plan.runs)} runs are finished.", ""]
    if failed:
        lines += ["## Failed", "", *(f"- {kind} `{name}`: {reason}" for kind, name, reason in failed), ""]
    if waiting:
        lines += [f"Not begun: {', '.join(waiting)}.", ""]
    if rows:
        table = pandas.DataFrame(rows)
        lines += ["## Runs", "", markdown.table(table.columns, _cells(table)), ""]
        left = [f"- `{row['run']}`: {words}" for row in rows if (words := _attribute(row["run"], "outside_limits"))]
        lines += ["## Outside the limits", "", *left, ""] * bool(left)
        lines += ["## Figures", "", *(f"![{row['run']}]({FIGURES}/{row['run']}.png)" for row in rows), ""]
    lines += ["## Provenance", "", *_origin(rows)]
    write_told(REPORT, "\n".join(lines) + "\n", [Path(STATISTICS) / f"{row['run']}.nc" for row in rows])


def _row(job):
    file = Path(STATISTICS) / f"{job.name}.nc"
    if not (file.exists() and Path(job.output).exists()):
        return None
    with xr.open_dataset(file) as found:
        value = {name: float(found[name]) for name in found}
    return {
        "run": job.name, "path": job.item.path, "engine": job.item.engine, "specimen": job.item.specimen,
        "grains": int(value["grains"]), "p0, kPa": value["initial_mean_stress"] / 1e3,
        "p, kPa": value["final_mean_stress"] / 1e3, "e0": value["initial_void_ratio"], "e": value["final_void_ratio"],
        "Z": value["final_coordination_number"], "peak q/p": value["peak_stress_ratio"],
        "M": value.get("critical_M", np.nan), "C0 error, %": 100.0 * value["largest_sff_error"],
        "time, s": value["wall_time"],
    }  # fmt: skip


def _attribute(name, attribute):
    with xr.open_dataset(Path(STATISTICS) / f"{name}.nc") as found:
        return found.attrs[attribute]


def _cells(table):
    """The rows of a table as text; what is no number is empty."""
    cells = [[f"{x:.4g}" if isinstance(x, float) else str(x) for x in row] for row in table.itertuples(index=False)]
    return [["" if x == "nan" else x for x in row] for row in cells]


def _origin(rows):
    here = machine()
    made = {(known["labkit_version"], known["commit"] or "installed", known["machine"]["name"])
            for row in rows if (known := of_file(Path(RUNS) / f"{row['run']}.run.nc"))}  # fmt: skip
    yield f"- campaign file: `{CAMPAIGN}`; every file says with `labkit info FILE` what made it"
    for version, code, name in sorted(made):
        yield f"- runs by labkit {version}, {code}, on {name}"
    code = commit() or "installed"
    yield f"- this page by labkit {labkit.__version__}, {code}, on {here['name']} ({here['processor']})"
    yield f"- {', '.join(f'{name} {version}' for name, version in libraries().items())}"


def main(what, *names):
    die_with_parent()
    try:
        {"statistics": statistics, "figure": figure, "report": report}[what](*names)
    except InputError as error:
        return fail(error, 2)
    except PhysicsError as error:
        return fail(error, 1)
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
