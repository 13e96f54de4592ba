"""The summary at the top of the report: what was simulated, what agrees, and how large the errors are."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pandas

from analysis import markdown
from analysis.paper import number_table
from analysis.paper.cost import costs
from analysis.paper.ends import OTHERS
from analysis.paper.model_comparison import LABELS, OURS, TABLE_2
from labkit.runs import SFF_TOLERANCE, SHEAR

PATHS = {
    "cv": "CV (undrained)",
    "cr": "CR (radial stress held)",
    "cp": "CP (mean stress held)",
    "isoc": "isotropic compression",
    "isod": "isotropic dilation",
    "cyclic_cp": "cyclic CP",
}


def summary(folder: Path) -> str:
    """The summary as a Markdown list, each item with a link to its section. Items without data are left out."""
    items = [f"- {item}" for item in _items(folder)]
    return "\n\n".join(["## Summary", "\n".join(items)]) if items else ""


def _items(folder: Path) -> Iterator[str]:
    for name, item in (
        ("campaign.csv", _simulated),
        ("fidelity.csv", _numbers),
        ("sff.csv", _sff),
        ("model_errors.csv", _model),
        ("engines.csv", _engines),
        ("../hard_cases/hard_cases.csv", _hard_cases),
        ("campaign.csv", _cost),
    ):
        if (folder / name).is_file():
            frame = pandas.read_csv(folder / name)
            if len(frame):
                yield item(frame)


def _simulated(runs: pandas.DataFrame) -> str:
    main = runs[~runs["run"].str.startswith(OTHERS)]
    kinds = [f"{n} {PATHS.get(path, path)}" for path, n in main["path"].value_counts(sort=False).items()]
    text = f"**Simulated:** {len(runs)} {'test' if len(runs) == 1 else 'tests'}"
    if len(main):
        fewest, most = main["grains"].min(), main["grains"].max()
        grains = f"{most:,}" if fewest == most else f"{fewest:,} to {most:,}"
        text += f". {len(main)} from the paper, with {grains} grains: {', '.join(kinds)}"
    if len(main) < len(runs):
        text += f". {len(runs) - len(main)} for comparing engines and contact laws"
    return f"{text} ([names of the runs](#run-names))."


def _numbers(numbers: pandas.DataFrame) -> str:
    rows = {row[0]: row for row in number_table.rows(numbers)}
    agrees, kind = (number_table.HEADER.index(name) for name in ("agrees", "kind"))
    off = [label for label, row in rows.items() if row[agrees] == "no" and row[kind] in ("measured", "")]
    text = f"**The paper's numbers:** {number_table.count(numbers)} ([all numbers](#numbers))"
    if off:
        text += " Those that do not agree:"
        for label in off:
            _, ours, _, paper = map(markdown.literal, rows[label][:4])
            text += f"\n    - {markdown.literal(label)}: ours {ours}, paper {paper}"
    return text


def _sff(errors: pandas.DataFrame) -> str:
    judged = errors.dropna(subset=["worst"])
    main = judged[~judged["run"].str.startswith(OTHERS)]
    shear = main[main["path"].isin(SHEAR)]
    over = judged[judged["over"] > 0]
    text = "**Error of C0:**"
    if len(shear):
        text += (
            f" in the {len(shear)} monotonic shear tests of the paper, C0 differs from Love's stress by at most "
            f"{_percent(shear['worst'].max(), 1)} and by {_percent(shear['mean'].mean(), 1)} on average (Frobenius "
            "norm, which is mostly p; records with p > 50 kPa; q is lower, see the errors of p and q apart)."
        )
    text += f" The error exceeds {_percent(SFF_TOLERANCE)} in {len(over)} of all {len(judged)} monotonic tests"
    if len(over):
        text += f" ({', '.join(over['run'])}) and is {_percent(over['worst'].max(), 1)} at worst"
    return f"{text} ([C0 against Love's stress](#love))."


def _model(errors: pandas.DataFrame) -> str:
    text = "**Errors of the model** (median over the tests of the RMS error):"
    parts = []
    errors = errors[~errors["run"].str.startswith(OTHERS)]
    for key in (TABLE_2, OURS):
        own = errors[errors["parameters"] == key]
        monotonic, cyclic = own[own["path"] != "cyclic_cp"], own[own["path"] == "cyclic_cp"]
        if not len(monotonic):
            continue
        q, e = (_percent(monotonic[column].median()) for column in ("q_error", "e_error_of_change"))
        part = f" with {LABELS[key]}, {q} of the largest q and {e} of the range of e in monotonic tests"
        if len(cyclic):
            q, e = (_percent(cyclic[column].median()) for column in ("q_error", "e_error_of_change"))
            part += f", {q} and {e} in cyclic tests"
        parts.append(part)
    return f"{text}{';'.join(parts)} ([model](#model))."


def _percent(value: float, decimals: int = 0) -> str:
    return f"{100.0 * value:.{decimals}f} %"


def _engines(table: pandas.DataFrame) -> str:
    fused = table[table["kind"].str.startswith("fused, rolling")]
    texts = [
        f"{label} by at most {_percent(fused[column].abs().max(), 1)}"
        for column, label in (("off_peak", "the peak of q/p"), ("off_M", "the critical q/p"), ("off_e", "e"))
        if fused[column].notna().any()
    ]
    if not texts:
        return "**Engines:** no test ran on both ([engines](#engines))."
    return (
        "**Engines:** with the same contact law, the fused engine differs from YADE in "
        f"{', '.join(texts)} ([YADE and the fused engine](#engines))."
    )


def _hard_cases(cases: pandas.DataFrame) -> str:
    counts = cases["verdict"].value_counts()
    texts = ", ".join(f"{n} *{verdict}*" for verdict, n in counts.items())
    return f"**Hard cases:** {cases['case'].nunique()} scenes, {len(cases)} runs: {texts} ([hard cases](#hard-cases))."


def _cost(runs: pandas.DataFrame) -> str:
    total = costs(runs, None).iloc[-1]
    return (
        f"**Cost:** {markdown.number(total['grain-steps'], 2)} grain-steps, "
        f"{markdown.number(total['core time, h'], 2)} core hours on a computer that was also running other jobs "
        "([cost](#cost))."
    )
