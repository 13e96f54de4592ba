"""The page of the hard cases, and their table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from analysis import markdown
from analysis.hard_cases.outcome import Outcome
from analysis.hard_cases.scenes import CLEAR_ERROR, CORRECT, LIMIT_SAID, SILENT_WRONG

NUMBERS = {
    "energy": "energy_balance_error",
    "stress": "stress_error",
    "held": "held_error",
    "C0": "c0_error",
    "momentum": "momentum",
    "undamped": "undamped_momentum",
}


def table(outcomes: Iterable[Outcome]) -> str:
    """A line for each case and engine, as text."""
    heading = " ".join(f"{name:>9}" for name in NUMBERS)
    rows = [f"{'case':<20} {'engine':<6} {'verdict':<12} {'checks':>6} {'s':>5} {heading}"]
    for o in outcomes:
        numbers = " ".join(f"{_number(getattr(o, field)):>9}" for field in NUMBERS.values())
        rows.append(f"{o.case:<20} {o.engine:<6} {o.verdict:<12} {o.checks:>6} {o.seconds:5.0f} {numbers}")
        rows += [f"    FAILED {o.failed}"] if o.failed else []
    return "\n".join(rows)


def _number(value):
    return "" if value is None else f"{value:.1e}"


PAGE = """# Hard cases

Scenes at which a simulation of grains may go wrong, each run on both engines. None may end
in a silent wrong answer: what comes out is correct, or labkit says what is wrong. Made by

    {history}

with about {grains} grains where a case is not about their number. {summary}

- **{correct}**: every check of the case holds. **{limit}**: they hold, and the run says which of its limits it left.
  **{clear}**: labkit gave up with a sentence that says what to change. **{silent}**: a check fails and nothing said so.
- Every run that ended is also checked for its energy balance (5 % of the work), for the stresses in the file against
  those of its stored contacts and of the contacts that the fused kernel finds anew (1e-9), for what the path holds
  (`labkit verify`), for a drift of the centre of mass, and for C0 against Love where p > 50 kPa.
- "Half the step" is a run of the same specimen on the engine fused with half the time step. Shear of grains is chaotic:
  two converged runs differ by a scatter, which the tolerances are made of. They are in `analysis/hard_cases`.

{cases}
{figure}
## Numbers

Energy: worst error of the balance over the work. Stress: worst relative difference of stored and recomputed stresses.
Held: worst of what the path holds (relative stress or volume, or difference of strains). C0: worst error against Love
with p > 50 kPa. Momentum: |sum m c| / sum m |c| at the end, c without the mean field; it is no rounding, because local
damping acts on each grain by itself. Undamped: its change in 50 steps without that damping, by the engine fused, which
is rounding. Empty: the case leaves no run to measure, or there is nothing to be held or judged.

{numbers}

## What the guards said

{guards}
"""


def page(outcomes: Sequence[Outcome], grains: int, history: str, drawn: bool) -> str:
    """The page as Markdown."""
    wrong = sum(outcome.verdict == SILENT_WRONG for outcome in outcomes)
    summary = f"{len(outcomes)} cases, {wrong} silently wrong."
    cases, guards = [], []
    for name in dict.fromkeys(outcome.case for outcome in outcomes):
        mine = [outcome for outcome in outcomes if outcome.case == name]
        cases.append(f"### {name}\n\n*Should:* {mine[0].should}.\n")
        for o in mine:
            failed = f" **Failed: {o.failed}.**" if o.failed else ""
            cases.append(f"- {o.engine}, **{o.verdict}**: {_cell(o.did)}.{failed}")
            guards.append(f"- {name}, {o.engine}: {_cell(o.guard) or 'nothing'}")
        cases.append("")
    numbers = [
        [
            o.case,
            o.engine,
            str(o.checks or ""),
            *(_number(getattr(o, field)) for field in NUMBERS.values()),
            f"{o.seconds:.0f}",
        ]
        for o in outcomes
    ]
    header = ["case", "engine", "checks", *NUMBERS, "seconds"]
    return PAGE.format(
        history=history,
        grains=grains,
        summary=summary,
        correct=CORRECT,
        limit=LIMIT_SAID,
        clear=CLEAR_ERROR,
        silent=SILENT_WRONG,
        cases="\n".join(cases),
        numbers=markdown.table(header, numbers),
        guards="\n".join(guards),
        figure="![Six of the cases on both engines](hard_cases.png)\n" if drawn else "",
    )


def _cell(text):
    return text.replace(" | ", "; ").rstrip(".")
