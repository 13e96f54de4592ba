"""`labkit paper`: from the campaign to results/paper, or again from its own thin run files."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pandas

from labkit.visuals import plots
from labkit.campaign import workflow
from labkit.campaign.command import ours, tell
from labkit.campaign.file import read_campaign
from labkit.campaign.plan import CAMPAIGN, RUNS, plan_of
from labkit.errors import InputError
from labkit.io.files import make_folder
from labkit.runs.dataset import snapshots
from labkit.paper import runs, sources
from labkit.paper.condense import condense
from labkit.paper.notebooks import execute, notebook_files
from labkit.paper.report import report
from labkit.paper.tables import write_tables
from labkit.visuals.picture import picture
from labkit.io.provenance import write_told

PICTURED = "cv-dense"  # at its start and end
NOTEBOOKS = Path(__file__).resolve().parents[2] / "analysis"


def simulate(folder, cores, progress):
    """Brings the campaign in `folder` up to date: its own file there, or the paper's; the exit code of a campaign."""
    folder = Path(folder)
    file = folder / CAMPAIGN if (folder / CAMPAIGN).exists() else ours("paper")
    text = file.read_text(encoding="utf-8")
    plan = plan_of(read_campaign(file))
    return tell(plan, folder, workflow.run_workflow(plan, text, folder, cores, progress=progress))


def paper(campaign, output, command, progress):
    """Condenses the finished runs of the folder `campaign`, if one is given, and makes all tables, figures and the
    report of the thin files in `output`; yields the files that were written."""
    output = make_folder(output, "--output")
    (output / "runs").mkdir(exist_ok=True)
    if campaign:
        for k, file in enumerate(files := finished(campaign)):
            progress(k / len(files), f"run {k + 1} of {len(files)}")
            condense(file, output / "runs" / file.name, command)
        progress(1.0, "runs condensed")
    found = runs(output)
    text = cost_table(found).to_csv(index=False, float_format="%.6g")
    write_told(output / "campaign.csv", text, sources(found), command)
    yield output / "campaign.csv"
    study = output.parent / "speed_error" / "study.nc"
    yield from write_tables(found, output, study if study.exists() else None)
    if PICTURED in found and found[PICTURED].sizes["snapshot"]:
        file = found[PICTURED].encoding["source"]
        plots.save(picture(snapshots(file, [0, -1])), output / "gallery.png", [file], command)
        yield output / "gallery.png"
    if NOTEBOOKS.is_dir():  # a package that is installed has none
        for notebook in notebook_files(NOTEBOOKS):
            execute(notebook, output, output)
            yield notebook
    report(output, output / "report.html", command)
    yield output / "report.html"


def finished(campaign):
    """The run files of the campaign in a folder that are there. Raises InputError for none."""
    files = sorted((Path(campaign) / RUNS).glob("*.run.nc"))
    if not files:
        raise InputError(f"{campaign} holds no finished runs: give the folder of labkit campaign paper")
    return files


def cost_table(found):
    """A row per run: what it took. wall_time in s, of whatever else the machine did too, on so many threads."""
    return pandas.DataFrame([
        {"run": name, "path": run.attrs["path"], "engine": run.attrs["engine"], "law": run.lab.scene.law,
         "threads": threads_of(run), "grains": run.sizes["grain"], "records": run.sizes["time"],
         "steps": int(run.attrs["steps"]),
         "grain_steps": int(run.attrs["steps"]) * run.sizes["grain"], "wall_time": float(run.attrs["wall_time"])}
        for name, run in found.items()
    ])  # fmt: skip


def threads_of(run):
    """The threads of the command that made a run; 1 where none are told."""
    command = json.loads(run.attrs.get("source_provenance", "{}")).get("command", "")
    told = re.search(r"--threads[= ](\d+)", command)
    return int(told[1]) if told else 1
