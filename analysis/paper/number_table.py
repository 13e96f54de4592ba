"""The numbers of fidelity.csv laid out for readers: ours, the paper's, the difference and the difference allowed."""

from __future__ import annotations

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
    "matters from",
    "agrees",
    "kind",
    "interval from",
)
RIGHT = (1, 2, 3, 4, 5, 6, 7)  # right-aligned columns
EXACT = "exact"
RULE = (
    "Only *measured* numbers count: *input* was put into the simulations (void ratios, stresses, reversals, "
    "damping), a specimen was *tuned* to the number, and a *limit* is kept or not. A measured number agrees (`yes`) "
    "if its whole 95 % interval is closer to the paper's number than the difference that *matters* (2 % of the "
    "number, or its rounding if that is more). It does not (`no`) if the difference exceeds the *allowed* one: the "
    "half-width of the interval plus the rounding, half a unit of the last digit that the paper prints. Otherwise it "
    "is *not resolved*. A specimen counts once in an interval, however often it was tested. `exact`: a count, or a "
    "worst value over all records. The state at 30 to 40 % of strain is not stationary in all quantities: see the "
    "critical state."
)

EXPLAINED = (
    "For a limit: the runs that exceed it. For other numbers: the alternatives whose effect is resolved after the "
    "correction of Benjamini and Hochberg for the number of all comparisons, with 95 % intervals over specimens, and "
    "those whose effect is not."
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
    "judged",
    "agrees",
    "kind",
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
        _number(row["judged"]),
        _text(row["agrees"]),
        _text(row["kind"]),
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


def count(numbers: pandas.DataFrame) -> str:
    """Sentence with the number of measured numbers that agree, do not agree and are not resolved."""
    measured = numbers[numbers["kind"] == "measured"] if "kind" in numbers else numbers
    counts = measured["agrees"].astype(str).value_counts()
    yes, no = (int(counts.get(verdict, 0)) for verdict in ("yes", "no"))
    others = "".join(
        f", {n} {'is' if n == 1 else 'are'} {verdict}" for verdict, n in counts.items() if verdict not in ("yes", "no")
    )
    rest = len(numbers) - len(measured)
    text = f"Of {len(measured)} measured numbers, {yes} agree with the paper, {no} do not{others}."
    return f"{text} {rest} further numbers are limits, or were put in, and do not count." if rest else text


def page(numbers: pandas.DataFrame) -> str:
    """The page fidelity.md: the rule, the table and the explanations."""
    parts = [
        "# The paper's numbers and ours",
        f"{count(numbers)} {RULE}",
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
