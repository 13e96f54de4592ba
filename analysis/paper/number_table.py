"""The numbers of fidelity.csv laid out for readers: ours, the paper's, the difference and the difference allowed."""

from __future__ import annotations

from collections.abc import Sequence

import pandas

from analysis import markdown
from analysis.paper.estimates import text

HEADER = (
    "number",
    "ours",
    "our interval (95 %)",
    "paper",
    "paper's rounding",
    "difference",
    "allowed",
    "agrees",
    "tests",
    "interval from",
)
RIGHT = (1, 2, 3, 4, 5, 6, 8)  # right-aligned columns
EXACT = "exact"
RULE = (
    "A number agrees (`yes`) if the difference between ours and the paper's is at most the *allowed* one: the "
    "half-width of our 95 % interval plus the rounding of the paper's number, half a unit of its last digit. A number "
    "that the paper prints with few digits can therefore agree although it lies well outside our interval. `exact` "
    "means that the number has no interval: it is a count, a worst value over all records, or measured on a single "
    "specimen. *One test* means that the number was measured in a single test: its interval is unknown, and only the "
    "paper's rounding is allowed. For limits (*below ...*) no rounding is allowed; a negative difference is the "
    "distance below the limit."
)

EXPLAINED = (
    "For a limit: the runs that exceed it. For other numbers: the alternatives tested, each with its effect on the "
    "number."
)


def rows(numbers: pandas.DataFrame) -> list[list[str]]:
    """One row of text per row of fidelity.csv, with the columns of HEADER. Missing columns count as empty."""
    numbers = numbers.reindex(columns=[*dict.fromkeys([*numbers.columns, *NEEDED])])
    return [_row(row) for _, row in numbers.iterrows()]


NEEDED = (
    "label",
    "ours",
    "within",
    "paper_says",
    "paper_rounding",
    "difference",
    "agrees",
    "tests",
    "uncertainty_of",
)


def _row(row: pandas.Series) -> list[str]:
    basis = _text(row["uncertainty_of"])
    exact = basis.startswith(EXACT) or row["within"] == 0.0
    if pandas.isna(row["ours"]):
        ours = interval = ""
    else:
        spread = pandas.notna(row["within"]) and row["within"] > 0.0
        value, _, half = text(float(row["ours"]), float(row["within"]) if spread else float("nan"), 4).partition(" ± ")
        ours, interval = value, f"± {half}" if half else EXACT if exact else "unknown"
    rounding = row["paper_rounding"]
    limit = pandas.isna(rounding)
    allowed = float("nan") if limit else float(rounding) + (0.0 if pandas.isna(row["within"]) else float(row["within"]))
    return [
        _text(row["label"]),
        ours,
        interval,
        _text(row["paper_says"]),
        "" if limit else f"± {markdown.number(float(rounding), 2)}",
        _number(row["difference"]),
        _number(allowed),
        _text(row["agrees"]),
        "" if pandas.isna(row["tests"]) else f"{row['tests']:.0f}",
        basis,
    ]


def _text(value: object) -> str:
    return "" if pandas.isna(value) else str(value)


def _number(value: float) -> str:
    if pandas.isna(value):
        return ""
    return f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}"


def explanations(numbers: pandas.DataFrame) -> list[tuple[str, str]]:
    """(label, explanation) of the numbers that have one."""
    if "explanation" not in numbers:
        return []
    explained = numbers[numbers["explanation"].fillna("") != ""]
    return list(zip(explained["label"], explained["explanation"], strict=True))


def count(verdicts: Sequence[str]) -> str:
    """Sentence with the number of verdicts `yes`, `no` and others."""
    counts = pandas.Series(list(verdicts)).value_counts()
    yes, no = (int(counts.get(verdict, 0)) for verdict in ("yes", "no"))
    others = "".join(f"; {n}: {verdict}" for verdict, n in counts.items() if verdict not in ("yes", "no"))
    return f"Of {len(verdicts)} numbers, {yes} agree with the paper and {no} do not{others}."


def page(numbers: pandas.DataFrame) -> str:
    """The page fidelity.md: the rule, the table and the explanations."""
    parts = [
        "# The paper's numbers and ours",
        f"{count(numbers['agrees'].tolist())} {RULE}",
        markdown.table(HEADER, rows(numbers), RIGHT),
    ]
    listed = explanations(numbers)
    if listed:
        parts += [
            "## Numbers that do not agree",
            EXPLAINED,
            "\n".join(f"- **{label}**: {explanation}." for label, explanation in listed),
        ]
    return "\n\n".join(parts)
