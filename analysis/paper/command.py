"""`./lab paper`: runs the campaign and builds results/paper, or rebuilds it from the reduced run files stored there."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import pandas

from analysis.campaigns import add_campaign_options, finished, simulate
from analysis.paper import runs, sources
from analysis.paper.condense import condense
from analysis.paper.drawn import draw_all
from analysis.paper.ends import Runs
from analysis.paper.origins import threads_of
from analysis.paper.report import report
from analysis.paper.tables import write_tables
from labkit.engines import Progress, find_yade
from labkit.figures import draw_grains, plots
from labkit.io import make_folder, reporter, write_with_provenance
from labkit.runs import snapshots

TESTS = Path(__file__).with_name("paper.yaml")
PICTURED = "cv-dense"  # run shown in gallery.png, at its start and end
CONDENSED, TABLES, FIGURES = 0.3, 0.5, 0.95  # fractions of the progress at which these steps are finished


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab paper`."""
    add_campaign_options(parser, "paper", "everything is rebuilt from the reduced run files in the output folder")


def main(options: argparse.Namespace, command: str) -> int:
    """Runs the campaign if one is given and writes all results from its runs; returns 1 if a run failed."""
    code = 0
    if options.campaign and not options.as_is:
        find_yade()
        code = simulate(options.campaign, options.cores, reporter("campaign"), TESTS)
    for file in paper(options.campaign, options.output, command, reporter("paper")):
        print(file)
    return int(code != 0)


def paper(campaign: str | Path | None, output: str | Path, command: str, progress: Progress) -> Iterator[Path]:
    """Writes all tables, figures and the report from the reduced run files in `output`; yields the files written.

    If a `campaign` folder is given, its finished runs are reduced first. `progress`: called with (fraction, text).
    """
    folder = Path(make_folder(output, "--output"))
    (folder / "runs").mkdir(exist_ok=True)
    if campaign:
        for k, file in enumerate(files := finished(campaign)):
            progress(CONDENSED * k / len(files), f"reducing run {k + 1} of {len(files)}")
            condense(file, folder / "runs" / file.name, command)
    start = CONDENSED if campaign else 0.0
    progress(start, "reading the runs")
    stored = runs(folder)
    text = cost_table(stored).to_csv(index=False, float_format="%.6g")
    write_with_provenance(folder / "campaign.csv", text, sources(stored), command)
    yield folder / "campaign.csv"

    def tables(fraction: float, text: str) -> None:
        progress(start + (TABLES - start) * fraction, text)

    study = folder.parent / "speed_error" / "study.nc"
    yield from write_tables(stored, folder, study if study.exists() else None, command, tables)
    if PICTURED in stored and stored[PICTURED].sizes["snapshot"]:
        progress(TABLES, "drawing the grains")
        source = stored[PICTURED].encoding["source"]
        plots.save(draw_grains(snapshots(source, [0, -1])), folder / "gallery.png", [source], command)
        yield folder / "gallery.png"

    def drawn(fraction: float, text: str) -> None:
        progress(TABLES + (FIGURES - TABLES) * fraction, text)

    yield from draw_all(stored, folder, drawn)
    progress(FIGURES, "writing the report")
    report(folder, folder / "report.html", command)
    progress(1.0, "done")
    yield folder / "report.html"


def cost_table(runs: Runs) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per run: its cost, and its contact law as named in its file.

    wall_time: s, with the number of threads used, including the effect of any other load on the computer.
    """
    rows = []
    for name, run in runs.items():
        law, threads = json.loads(run.attrs["scene"])["law"], threads_of(run.attrs)
        grains, steps, wall_time = run.sizes["grain"], int(run.attrs["steps"]), float(run.attrs["wall_time"])
        kind = name, run.attrs["path"], run.attrs["engine"], law
        rows.append((*kind, threads, grains, run.sizes["time"], steps, steps * grains, wall_time))
    return pandas.DataFrame(
        rows, columns="run path engine law threads grains records steps grain_steps wall_time".split()
    )
