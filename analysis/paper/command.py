"""`./lab paper`: from the campaign to results/paper, or again from its own thin run files."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator
from pathlib import Path

import pandas

from analysis.paper import runs, sources
from analysis.paper.condense import condense
from analysis.paper.ends import Runs
from analysis.paper.notebooks import execute, notebook_files
from analysis.paper.origins import threads_of
from analysis.paper.report import report
from analysis.paper.tables import write_tables
from analysis.places import STUDIES, results_folder
from labkit.campaign import CAMPAIGN, RUNS, plan_of, read_campaign, run_workflow, tell
from labkit.cli.arguments import positive_int
from labkit.dem import Progress
from labkit.engines import find_yade
from labkit.errors import InputError
from labkit.io import make_folder, reporter, write_with_provenance
from labkit.runs import snapshots
from labkit.visuals import draw_grains, plots

TESTS = Path(__file__).with_name("paper.yaml")
PICTURED = "cv-dense"  # at its start and end


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of `./lab paper`."""
    parser.add_argument(
        "campaign",
        nargs="?",
        help="folder of the campaign: it is begun there, or goes on (default: "
        "none, everything is made of the thin run files in the output)",
    )
    parser.add_argument("--as-is", action="store_true", help="run nothing, take what is finished in the folder")
    parser.add_argument(
        "--cores", type=positive_int, default=os.cpu_count() or 1, help="of this computer (default: all)"
    )
    parser.add_argument(
        "-o", "--output", default=results_folder("paper"), help="folder of the results (default: results/paper)"
    )


def main(options: argparse.Namespace, command: str) -> int:
    """Runs the campaign where one is given, and makes everything of its runs; 1 if a run failed."""
    code = 0
    if options.campaign and not options.as_is:
        find_yade()
        code = simulate(options.campaign, options.cores, reporter("campaign"))
    for file in paper(options.campaign, options.output, command, reporter("paper")):
        print(file)
    return int(code != 0)


def simulate(folder: str | Path, cores: int, progress: Progress) -> int:
    """Brings the campaign in `folder` up to date: its own file there, or the paper's; the exit code of a campaign."""
    folder = Path(folder)
    file = folder / CAMPAIGN if (folder / CAMPAIGN).exists() else TESTS
    text = file.read_text(encoding="utf-8")
    plan = plan_of(read_campaign(file))
    return tell(plan, folder, run_workflow(plan, text, folder, cores, progress=progress))


def paper(campaign: str | Path | None, output: str | Path, command: str, progress: Progress) -> Iterator[Path]:
    """Condenses the finished runs of the folder `campaign`, if one is given, and makes all tables, figures and the
    report of the thin files in `output`; yields the files that were written.
    """
    output = make_folder(output, "--output")
    (output / "runs").mkdir(exist_ok=True)
    if campaign:
        for k, file in enumerate(files := finished(campaign)):
            progress(k / len(files), f"run {k + 1} of {len(files)}")
            condense(file, output / "runs" / file.name, command)
        progress(1.0, "runs condensed")
    found = runs(output)
    text = cost_table(found).to_csv(index=False, float_format="%.6g")
    write_with_provenance(output / "campaign.csv", text, sources(found), command)
    yield output / "campaign.csv"
    study = output.parent / "speed_error" / "study.nc"
    yield from write_tables(found, output, study if study.exists() else None, command)
    if PICTURED in found and found[PICTURED].sizes["snapshot"]:
        file = found[PICTURED].encoding["source"]
        plots.save(draw_grains(snapshots(file, [0, -1])), output / "gallery.png", [file], command)
        yield output / "gallery.png"
    for notebook in notebook_files(STUDIES):
        execute(notebook, output, output)
        yield notebook
    report(output, output / "report.html", command)
    yield output / "report.html"


def finished(campaign: str | Path) -> list[Path]:
    """The run files of the campaign in a folder that are there. Raises InputError for none."""
    files = sorted((Path(campaign) / RUNS).glob("*.run.nc"))
    if not files:
        raise InputError(f"{campaign} holds no finished runs: give the folder of a campaign of ./lab paper")
    return files


def cost_table(found: Runs) -> pandas.DataFrame:
    """A row per run: what it took, and its contact law as its file names it.

    wall_time in s, of whatever else the computer did too, on so many threads.
    """
    return pandas.DataFrame(
        [
            {
                "run": name,
                "path": run.attrs["path"],
                "engine": run.attrs["engine"],
                "law": json.loads(run.attrs["scene"])["law"],
                "threads": threads_of(run.attrs),
                "grains": run.sizes["grain"],
                "records": run.sizes["time"],
                "steps": int(run.attrs["steps"]),
                "grain_steps": int(run.attrs["steps"]) * run.sizes["grain"],
                "wall_time": float(run.attrs["wall_time"]),
            }
            for name, run in found.items()
        ]
    )
