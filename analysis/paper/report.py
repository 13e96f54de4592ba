"""`./lab report`: results/paper and related results as one HTML page.

Every number is read from a data file. For anything missing the page names the command that writes it.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

import pandas

from analysis import markdown
from analysis.paper import number_table, pieces
from analysis.paper.cost import BENCH, cost
from analysis.paper.model_summary import summary as model_summary
from analysis.paper.origins import origins
from analysis.paper.pieces import join
from analysis.paper.run_names import run_names
from analysis.paper.summary import summary
from analysis.paper.web_page import write_page
from analysis.places import results_folder
from analysis.speed_error.errors import errors
from analysis.speed_error.settings import settings
from analysis.speed_error.table import open_study
from labkit.errors import InputError
from labkit.io import require_writable, write_provenance

TABLES = "./lab paper"  # commands that write missing files
STUDY = "./lab speed-error"
CASES = "./lab hard-cases"
FAR = "./lab critical-state"
WORTH = "./lab model-evidence"
STUDIED = ("study.nc", "settings.csv")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab report`."""
    parser.add_argument(
        "folder",
        nargs="?",
        default=results_folder("paper"),
        help="output folder of ./lab paper (default: results/paper)",
    )
    parser.add_argument("-o", "--output", help="HTML file (default: report.html in the folder)")


def main(options: argparse.Namespace, command: str) -> None:
    """Writes the report of a folder."""
    output = options.output or str(Path(options.folder) / "report.html")
    report(options.folder, output, command)
    print(f"page: {output}")


def report(folder: str | Path, output: str | Path, command: str) -> None:
    """Writes the report of a folder of `./lab paper` to the HTML file `output`, with a provenance file next to it.

    `command`: the command to record. Raises InputError without the folder or without pandoc.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder: create it with {TABLES} CAMPAIGN -o {folder}")
    require_writable(output)
    sections = (
        fidelity,
        gallery,
        critical_state,
        large_strain,
        figures,
        statistics,
        love,
        model,
        engines,
        speed_error,
        hard_cases,
    )
    text = join(HEAD, summary(folder), SUBJECT, run_names(folder, TABLES), *(section(folder) for section in sections))
    text = join(text, cost(folder, TABLES, STUDY))
    files = shown_files(folder)
    write_page(join(text, origins(folder, files, output, command, TABLES)), folder, output)
    write_provenance(output, files, command)


HEAD = """---
title: Granular soil in a virtual laboratory
subtitle: "The tests of He, Wu & Wang (2019) at full size: figures, numbers and what they cost"
lang: en
---"""

SUBJECT = r"""## About this page {#about}

He, Wu & Wang (2019) describe granular soil by the fabric of its contacts and by normalised contact forces. The stress
follows from the void ratio $e$ and five statistics (the coordination number $Z$, the mean normalised force $\Lambda$,
the anisotropies $A$ of the contacts and $F$ of the normal forces, and the mobilisation $F^t$) by Eq. C0:

$$\sigma = \frac{E Z \Lambda}{1+e}\left[\frac{I}{3} + \frac{2}{15}A + \frac{2}{15}F + \frac{2}{105}\,
\mathrm{tr}(FA)\,I + \frac{8}{105}\,\mathrm{sym}(FA) + F^t\right]$$

This page reports discrete element simulations of their tests. At every record, Love's stress (computed from all
contacts) is compared with C0; the constitutive model (Eqs. C1 to C5) is compared with both. Compression is positive and
$z$ is the axial direction."""


def fidelity(folder: Path) -> str:
    """The paper's numbers and ours, and the causes that were tested."""
    heading, file = "## The paper's numbers and ours {#numbers}", folder / "fidelity.csv"
    causes = pieces.csv_table(folder / "fidelity_causes.csv", "tested causes of differences", TABLES, fold=True)
    if not file.is_file():
        return join(heading, pieces.missing(file.name, TABLES), causes)
    numbers = pandas.read_csv(file)
    verdicts = numbers["agrees"].astype(str).tolist()
    marks = [{"yes": "inside", "no": "outside"}.get(verdict, "") for verdict in verdicts]
    cells = [[markdown.literal(cell) for cell in row] for row in number_table.rows(numbers)]
    shown = markdown.table(number_table.HEADER, markdown.marked(cells, marks), number_table.RIGHT)
    explained = [[markdown.literal(text) for text in pair] for pair in number_table.explanations(numbers)]
    tested = (
        "### Numbers that do not agree",
        number_table.EXPLAINED,
        pieces.box(markdown.table(("number", "explanation"), explained), "numbers that do not agree", "prose"),
    )
    colours = "Rows in [green]{.key .inside} agree, rows in [orange]{.key .outside} do not."
    return join(
        heading,
        f"{number_table.count(numbers)} {colours}",
        number_table.RULE,
        pieces.box(shown, "the paper's numbers and ours"),
        *(tested if explained else ()),
        causes,
    )


def gallery(folder: Path) -> str:
    """Picture of the grains."""
    return join("## The grains {#grains}", pieces.pictures("gallery", folder, TABLES))


def critical_state(folder: Path) -> str:
    """End states of the shear tests and the lines through them."""
    one = pieces.csv_table(folder / "one_critical_line.csv", "offsets of the paths from one line", TABLES)
    drifts = pieces.csv_table(folder / "stationarity.csv", "slopes at the ends of the tests", TABLES)
    linear = pieces.csv_table(folder / "components.csv", "M, A, F and F^t against e", TABLES)
    lines = pieces.csv_table(folder / "critical_lines.csv", "fitted critical state lines", TABLES)
    ends = pieces.csv_table(folder / "critical_states.csv", "end states of the shear tests", TABLES, fold=True)
    beyond = pieces.csv_table(
        folder / "critical_extrapolated.csv", "end states extrapolated to infinite strain", TABLES, fold=True
    )
    return join(
        "## Critical state {#critical-state}",
        pieces.pictures("critical", folder, TABLES),
        "### Fitted lines",
        "e(p) is e = e0 - a p^b^ with p in MPa; Z(e) and Λ(e) are fitted jointly.",
        lines,
        "### Are the ends stationary?",
        "Slopes over the last quarter of the strain, per 10 % of strain, with the t test over independent "
        "specimens that their mean is zero, corrected for the number of rows (Holm). Only a quantity whose verdict "
        "is *stationary* may be called critical: its whole interval within the slope that "
        "matters. *Passed*: tests whose own slope is not resolved; a single test has few independent records, so "
        "that this alone says little.",
        drifts,
        "### Do all paths and densities end on the same line?",
        "Offset of the end states of a group from those of the others. The p-value is that of the hypothesis that "
        "no group has an offset (a mixed model in which tests of one specimen share an offset); corrected by Holm. "
        "A large p-value means that offsets larger than the intervals are excluded, not that there are none.",
        one,
        "### M and the anisotropies against the void ratio",
        "Straight lines in e at the ends of the tests, given at e = 0.67: means over tests depend on the mix of "
        "densities.",
        linear,
        ends,
        beyond,
    )


def large_strain(folder: Path) -> str:
    """Tests to 100 % of strain and in other directions."""
    file = folder.parent / "critical_state/offsets.csv"
    text = (
        "The ends at 40 % still drift. Further tests go to 100 % of strain, in compression, extension and between, "
        "with both rules of stiffness; [their page](../critical_state/README.md) has all tables. Below: the distance "
        "of their ends from the paper's lines and constants, means over specimens."
    )
    return join(
        "## To 100 % of strain {#large-strain}",
        text,
        pieces.pictures("large_strain", folder, FAR),
        pieces.csv_table(file, "distance from the paper's lines", FAR, fold=True),
    )


def figures(folder: Path) -> str:
    """The paper's figures."""
    there = [name for name in pieces.names_of("figures") if (folder / name).is_file()]
    titles = {name: re.split(r"(?<=\w\w)[.:]", pieces.caption(name))[0] for name in there}
    index = " · ".join(f"[{title}](#{pieces.anchor(name)})" for name, title in titles.items())
    lines = (
        "Solid lines are simulations, dashed lines C0, dotted lines the model with Table 2, and dash-dotted lines the "
        "model calibrated on the simulations."
    )
    unknown = [file.name for file in sorted(folder.glob("*.png")) if file.name not in pieces.CAPTIONS.index]
    known = pieces.pictures("figures", folder, TABLES)
    return join(
        "## The paper's figures {#figures}", lines, index, known, *(pieces.picture(name, folder) for name in unknown)
    )


def statistics(folder: Path) -> str:
    """Pictures of the statistics."""
    return join(
        "## Statistics and strength {#statistics}",
        pieces.pictures("statistics", folder, TABLES),
        "### F_zz by the way it is fitted",
        "The same contacts fitted in different ways, at the last snapshot of two tests (one specimen each).",
        pieces.csv_table(folder / "force_fits.csv", "F_zz by the way it is fitted", TABLES),
    )


def love(folder: Path) -> str:
    """Errors of C0."""
    text = (
        "Error of C0 in each monotonic test, over the records with p > 50 kPa: the Frobenius norm of the difference "
        "divided by the norm of Love's stress. Tests with records above 2 % are marked in "
        "[orange]{.key .outside}, the others in [green]{.key .inside}."
    )
    apart = (
        "The norm is mostly the error of p. Relative errors of p, q and q/p, signed: the mean of each test, then the "
        "mean over independent specimens with its 95 % interval; *low* is the number of tests whose mean is negative."
    )
    return join(
        "## C0 against Love's stress {#love}",
        text,
        pieces.csv_table(folder / "sff.csv", "errors of C0", TABLES),
        apart,
        pieces.csv_table(folder / "c0_bias.csv", "errors of C0 in p, q and q/p", TABLES),
        pieces.csv_table(folder / "c0_errors.csv", "errors of C0 in p, q and q/p, every test", TABLES, fold=True),
    )


def model(folder: Path) -> str:
    """Errors and parameters of the model."""
    file = folder / "model_errors.csv"
    text = model_summary(pandas.read_csv(file), boxed) if file.is_file() else ""
    all_errors = pieces.csv_table(file, "errors of q, p and e", TABLES, fold=True)
    parameters = pieces.csv_table(folder / "parameters.csv", "parameters of Table 2 and ours", TABLES, fold=True)
    worth = pieces.pictures("model_evidence", folder, WORTH)
    return join("## The model against the simulations {#model}", text, worth, all_errors, parameters)


def boxed(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of text in a box that scrolls."""
    numbers = range(2 if header[0] == "type of test" else 1, len(header))
    return pieces.box(markdown.table(header, rows, numbers), "errors of the model")


def engines(folder: Path) -> str:
    """The same tests on both engines."""
    text = (
        "Tests from the same specimens. Peak is the largest q/p. M (critical q/p), e, Z and Λ are means over the last "
        "quarter of the strain of CV, CR and CP tests, and e, Z and Λ of the last record of the others. Δ is the "
        "relative difference from YADE."
    )
    table = pieces.csv_table(folder / "engines.csv", "the same tests on both engines", TABLES)
    return join("## YADE and the fused engine {#engines}", pieces.pictures("engines", folder, TABLES), text, table)


def speed_error(folder: Path) -> str:
    """Recommended settings from the data of the study, and its pictures."""
    page = folder.parent / "speed_error/README.md"
    text = f"All measurements are in [results/speed_error](../speed_error/{page.name}) of the repository."
    settings = recommended_settings(folder.parent / "speed_error")
    drawn = pieces.pictures("speed_error", folder, STUDY)
    return join(
        "## Speed against error {#speed-against-error}",
        settings or pieces.missing("recommended settings", STUDY),
        drawn,
        text if page.is_file() else "",
    )


def recommended_settings(study: Path) -> str:
    """Text and table of the recommended settings along CP, from study.nc and settings.csv; empty if one is missing."""
    if not all((study / name).is_file() for name in STUDIED):
        return ""
    timed = pandas.read_csv(study / "settings.csv")
    with open_study(study / "study.nc") as data:
        text, header, rows = settings(data, errors(data, timed), timed, "cp")
    return join(text, pieces.box(markdown.table(header, rows), "recommended settings"))


def hard_cases(folder: Path) -> str:
    """Verdicts of the hard cases."""
    file = folder.parent / "hard_cases/hard_cases.csv"
    if not file.is_file():
        return join("## Hard cases {#hard-cases}", pieces.missing(file.name, CASES))
    cases = pandas.read_csv(file)
    counts = pandas.crosstab(cases["engine"], cases["verdict"]).reset_index()
    verdicts = cases.pivot(index="case", columns="engine", values="verdict").reindex(cases["case"].unique())
    text = (
        "Scenes in which a simulation of grains may go wrong. None may end in a wrong result without a warning: the "
        "result is correct, or the run reports which limit was exceeded, or labkit refuses with a clear message. "
        "Number of cases by verdict:"
    )
    return join(
        "## Hard cases {#hard-cases}",
        text,
        pieces.table(counts, "verdicts"),
        pieces.table(verdicts.reset_index(), "every case", fold=True),
        pieces.pictures("hard_cases", folder, CASES),
    )


def shown_files(folder: Path) -> list[Path]:
    """Data files and pictures shown on the page, sorted."""
    shown = {folder / name for name in pieces.CAPTIONS.index} | set(folder.glob("*.png"))
    others = [folder.parent / "hard_cases/hard_cases.csv", folder.parent / BENCH]
    others += [folder.parent / "speed_error" / name for name in STUDIED]
    return sorted(file for file in {*shown, *folder.glob("*.csv"), *others} if file.is_file())
