"""`./lab paper`: runs the campaign and builds results/paper, or rebuilds it from the reduced run files stored there."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import pandas

from analysis.paper import runs, sources
from analysis.paper.condense import condense
from analysis.paper.contacts import write_contacts
from analysis.paper.drawn import draw_all
from analysis.paper.ends import Runs
from analysis.paper.origins import threads_of
from analysis.paper.report import report
from analysis.paper.tables import write_tables
from analysis.study import STEPS, Study
from labkit.engines import Progress, find_yade
from labkit.files import write_with_provenance
from labkit.process import reporter

TABLES, FIGURES = 0.4, 0.9  # fractions of the progress at which these steps are finished


class Paper(Study):
    """The paper's tests at full size."""

    data = "runs"
    tests = "paper.yaml"

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        (folder / self.data).mkdir(exist_ok=True)
        if "campaign" in options.steps and not options.as_is:
            find_yade()
        return super().prepare(options, folder, command)

    def gather(self, runs: Sequence[Path], file: Path, command: str) -> None:
        progress = reporter("reducing")
        for k, run in enumerate(runs):
            progress(k / len(runs), f"run {k + 1} of {len(runs)}")
            condense(run, file / run.name, command)
        write_contacts(runs, file.parent, command)

    def write(self, folder: Path, command: str, progress: Progress, steps: Sequence[str] = STEPS) -> list[Path]:
        progress(0.0, "reading the runs")
        stored, files = runs(folder), list[Path]()
        if "tables" in steps:
            text = cost_table(stored).to_csv(index=False, float_format="%.6g")
            write_with_provenance(folder / "campaign.csv", text, sources(stored), command)
            study = folder.parent / "speed_error" / "study.nc"
            known = study if study.exists() else None
            done = write_tables(stored, folder, known, command, lambda share, text: progress(TABLES * share, text))
            files += [folder / "campaign.csv", *done]
        if "figures" in steps:
            rest = FIGURES - TABLES
            files += draw_all(stored, folder, lambda share, text: progress(TABLES + rest * share, text))
        if "page" in steps:
            progress(FIGURES, "writing the report")
            report(folder, folder / "report.html", command)
            files.append(folder / "report.html")
        progress(1.0, "done")
        return files


STUDY = Paper()


def cost_table(runs: Runs) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per run: its cost, and its contact law as named in its file.

    wall_time: s, with the number of threads used, including the effect of other load on the computer.
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
