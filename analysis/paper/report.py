"""`./lab report`: what is in results/paper and beside it as one page to look at.

Every number is read from a data file. What is not there yet is said with the command that makes it.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

import pandas

from analysis import markdown
from analysis.paper import pieces
from analysis.paper.model_comparison import summary
from analysis.paper.origins import origins
from analysis.paper.pieces import join
from analysis.paper.web_page import write_page
from analysis.places import results_folder
from analysis.speed_error.errors import errors
from analysis.speed_error.settings import settings
from analysis.speed_error.table import open_study
from labkit.errors import InputError
from labkit.io import require_writable, write_provenance

TABLES = "./lab paper"  # commands that make what is missing
FIGURES = "./lab notebooks"
STUDY = "./lab speed-error"
CASES = "./lab hard-cases"
BENCH, STOCK = "speed_error/engines.csv", "stock YADE script, 1 thread"
STUDIED = ("study.nc", "settings.csv")
HOUR, DAY = 3600.0, 86400.0  # s


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of `./lab report`."""
    parser.add_argument(
        "folder", nargs="?", default=results_folder("paper"), help="of ./lab paper (default: results/paper)"
    )
    parser.add_argument("-o", "--output", help="HTML file (default: report.html in the folder)")


def main(options: argparse.Namespace, command: str) -> None:
    """Writes the page of a folder."""
    output = options.output or str(Path(options.folder) / "report.html")
    report(options.folder, output, command)
    print(f"page: {output}")


def report(folder: str | Path, output: str | Path, command: str) -> None:
    """Writes the page of the folder of `./lab paper` to `output`, an HTML file, and its provenance beside it;
    `command`: what made it. Raises InputError without the folder or without pandoc.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder: make it with {TABLES} CAMPAIGN -o {folder}")
    require_writable(output)
    sections = (
        fidelity,
        gallery,
        critical_state,
        figures,
        statistics,
        love,
        model,
        engines,
        speed_error,
        hard_cases,
        cost,
    )
    text = join(HEAD, SUBJECT, *(section(folder) for section in sections))
    files = shown_files(folder)
    write_page(join(text, origins(folder, files, output, command, TABLES)), folder, output)
    write_provenance(output, files, command)


HEAD = """---
title: Granular soil in a virtual laboratory
subtitle: "The tests of He, Wu & Wang (2019) at full size: figures, numbers and what they cost"
lang: en
---"""

SUBJECT = r"""## What this is

He, Wu & Wang (2019) describe granular soil by the fabric of its contacts and by normalised contact forces. Five
statistics (the coordination number $Z$, the mean normalised force $\Lambda$, the anisotropies $A$ of contacts and $F$
of normal forces, the mobilisation $F^t$) and the void ratio $e$ make the stress, Eq. C0:

$$\sigma = \frac{E Z \Lambda}{1+e}\left[\frac{I}{3} + \frac{2}{15}A + \frac{2}{15}F + \frac{2}{105}\,
\mathrm{tr}(FA)\,I + \frac{8}{105}\,\mathrm{sym}(FA) + F^t\right]$$

Here their tests are repeated by simulations of grains, Love's stress of the contacts is compared with C0 at every
record, and the constitutive model (C1 to C5) with both. Compression is positive, $z$ axial."""


def fidelity(folder: Path) -> str:
    """The numbers beside the paper's, and the causes that were tested."""
    words = (
        "The numbers of the paper, beside ours with their 95 % interval: [in agreement]{.key .inside}, or "
        "[not]{.key .outside}, with what was tested to explain it."
    )
    numbers = pieces.csv_table(folder / "fidelity.csv", "ours and the paper's", TABLES)
    causes = pieces.csv_table(folder / "fidelity_causes.csv", "causes that were tested", TABLES, fold=True)
    return join("## Ours and the paper's numbers", words, verdicts(folder / "fidelity.csv"), numbers, causes)


def verdicts(file: Path) -> str:
    """How many rows have which verdict in the column `agrees`, in words; empty without it."""
    frame = pandas.read_csv(file) if file.is_file() else pandas.DataFrame()
    counts = frame["agrees"].value_counts() if "agrees" in frame else {}
    return f"Agreement: {', '.join(f'{verdict} {n}' for verdict, n in counts.items())}." if len(counts) else ""


def gallery(folder: Path) -> str:
    """The picture of the grains."""
    return join("## The grains", pieces.pictures("gallery", folder, FIGURES))


def critical_state(folder: Path) -> str:
    """The ends of the shear tests and the lines through them."""
    one = pieces.csv_table(folder / "one_critical_line.csv", "whether the ends of all paths lie on one line", TABLES)
    lines = pieces.csv_table(folder / "critical_lines.csv", "fitted critical state lines", TABLES)
    ends = pieces.csv_table(folder / "critical_states.csv", "ends of the shear tests", TABLES, fold=True)
    beyond = pieces.csv_table(
        folder / "critical_extrapolated.csv", "ends extrapolated to endless strain", TABLES, fold=True
    )
    return join(
        "## Critical state",
        pieces.pictures("critical", folder, FIGURES),
        "### The lines",
        lines,
        "### One line for all paths",
        one,
        ends,
        beyond,
    )


def figures(folder: Path) -> str:
    """The paper's figures."""
    there = [name for name in pieces.names_of("figures") if (folder / name).is_file()]
    titles = {name: re.match(r"[^.]+\. [^.]+", pieces.caption(name))[0] for name in there}
    index = " · ".join(f"[{title}](#{pieces.anchor(name)})" for name, title in titles.items())
    words = "Simulations are solid, C0 is dashed, the model dotted (Table 2) and dash-dotted (calibrated on the tests)."
    unknown = [file.name for file in sorted(folder.glob("*.png")) if file.name not in pieces.CAPTIONS.index]
    known = pieces.pictures("figures", folder, FIGURES)
    return join("## The paper's figures", words, index, known, *map(pieces.picture, unknown))


def statistics(folder: Path) -> str:
    """The pictures of the statistics."""
    return join("## The statistics and what they add to the strength", pieces.pictures("statistics", folder, FIGURES))


def love(folder: Path) -> str:
    """The errors of C0."""
    words = "Relative error of C0 in each test, over the records with p > 50 kPa."
    return join("## C0 against Love", words, pieces.csv_table(folder / "sff.csv", "errors of C0", TABLES))


def model(folder: Path) -> str:
    """The errors and parameters of the model."""
    file = folder / "model_errors.csv"
    words = summary(pandas.read_csv(file), boxed) if file.is_file() else ""
    all_errors = pieces.csv_table(file, "errors of q, p and e", TABLES, fold=True)
    parameters = pieces.csv_table(folder / "parameters.csv", "parameters of Table 2 and ours", TABLES, fold=True)
    return join("## The model against the simulations", words, all_errors, parameters)


def boxed(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in a box."""
    return pieces.box(markdown.table(header, rows), "table")


def engines(folder: Path) -> str:
    """The same tests on both engines."""
    words = "Tests of the same specimens. off: relative difference from YADE."
    table = pieces.csv_table(folder / "engines.csv", "ends of the tests on both engines", TABLES)
    return join("## YADE and the engine fused", pieces.pictures("engines", folder, FIGURES), words, table)


def speed_error(folder: Path) -> str:
    """The recommended settings, from the data of the study, and its pictures."""
    page = folder.parent / "speed_error/README.md"
    words = f"All measurements stand in [results/speed_error](../speed_error/{page.name}) of the repository."
    settings = recommended_settings(folder.parent / "speed_error")
    drawn = pieces.pictures("speed_error", folder, STUDY)
    return join(
        "## Speed against error",
        settings or pieces.missing("recommended settings", STUDY),
        drawn,
        words if page.is_file() else "",
    )


def recommended_settings(study: Path) -> str:
    """Words and table of the settings along CP, from study.nc and settings.csv; empty without them."""
    if not all((study / name).is_file() for name in STUDIED):
        return ""
    timed = pandas.read_csv(study / "settings.csv")
    with open_study(study / "study.nc") as data:
        words, header, rows = settings(data, errors(data, timed), timed, "cp")
    return join(words, pieces.box(markdown.table(header, rows), "recommended settings"))


def hard_cases(folder: Path) -> str:
    """The verdicts of the hard cases."""
    file = folder.parent / "hard_cases/hard_cases.csv"
    if not file.is_file():
        return join("## Hard cases", pieces.missing(file.name, CASES))
    cases = pandas.read_csv(file)
    counts = pandas.crosstab(cases["engine"], cases["verdict"]).reset_index()
    verdicts = cases.pivot(index="case", columns="engine", values="verdict").reindex(cases["case"].unique())
    words = (
        "Scenes at which a simulation of grains may go wrong. None may end in a silent wrong answer: what comes out is "
        "correct, or the run says which limit it left, or labkit gives up with a clear error. Number of cases:"
    )
    return join(
        "## Hard cases",
        words,
        pieces.table(counts, "verdicts"),
        pieces.table(verdicts.reset_index(), "every case", fold=True),
        pieces.pictures("hard_cases", folder, CASES),
    )


def cost(folder: Path) -> str:
    """What the campaign took, and what a stock YADE script would have taken for as many grain-steps."""
    heading, file, bench = "## What the campaign cost", folder / "campaign.csv", folder.parent / BENCH
    if not file.is_file():
        return join(heading, pieces.missing(file.name, TABLES))
    runs, stock = pandas.read_csv(file, dtype_backend="numpy_nullable"), stock_speed(bench)
    sums = costs(runs, stock)
    total = sums.iloc[-1]
    words = (
        f"{total['runs']} runs, {markdown.number(total['grain-steps'], 3)} grain-steps, "
        f"{markdown.number(total['core time, h'], 3)} core hours: {markdown.number(total['core time, h'] / 2, 3)} "
        "hours on two cores, beside whatever else the computer did."
    )
    if stock:
        words += (
            f" A stock YADE script on one thread makes {markdown.number(stock, 3)} grain-steps a second "
            f"(`results/{BENCH}`): {markdown.number(total['stock YADE, h'] * HOUR / DAY / 2, 3)} days for all these "
            "on two cores, two simulations side by side."
        )
    return join(
        heading,
        words,
        "" if stock else pieces.missing(bench.name, STUDY),
        pieces.table(sums, "cost by engine"),
        pieces.table(runs, "every run", fold=True),
    )


def costs(runs: pandas.DataFrame, stock: float | None) -> pandas.DataFrame:
    """Sums over the runs of campaign.csv by engine, and over all in the last row; a pandas.DataFrame. `stock`:
    grain-steps a second of a stock YADE script on one thread, or None.
    """
    runs = runs.assign(
        engine=runs["engine"].astype(str),
        **{
            "runs": 1,
            "grain-steps": runs["steps"].astype(float) * runs["grains"].astype(float),
            "wall time, h": runs["wall_time"].astype(float) / HOUR,
        },
    )
    runs["core time, h"] = runs["wall time, h"] * runs["threads"].astype(float)
    if stock:
        runs["stock YADE, h"] = runs["grain-steps"] / stock / HOUR
    shown = ["runs", "grain-steps", "wall time, h", "core time, h", *["stock YADE, h"] * (stock is not None)]
    sums = runs.groupby("engine", sort=False)[shown].sum()
    return pandas.concat([sums, sums.sum().to_frame("all").T.astype(sums.dtypes)]).reset_index(names="engine")


def stock_speed(file: Path) -> float | None:
    """Grain-steps per second of a stock YADE script on one thread, with the most grains in the table of engines of
    `./lab speed-error`; None if there is none.
    """
    if not file.is_file():
        return None
    table = pandas.read_csv(file)
    stock = table[table["engine"] == STOCK]
    return float(stock.loc[stock["grains"].idxmax(), "grain_steps_per_second"]) if len(stock) else None


def shown_files(folder: Path) -> list[Path]:
    """The data files and pictures behind the page, sorted."""
    shown = {folder / name for name in pieces.CAPTIONS.index} | set(folder.glob("*.png"))
    beside = [folder.parent / "hard_cases/hard_cases.csv", folder.parent / BENCH]
    beside += [folder.parent / "speed_error" / name for name in STUDIED]
    return sorted(file for file in {*shown, *folder.glob("*.csv"), *beside} if file.is_file())
