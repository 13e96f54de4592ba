"""The page and the table of the hard cases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from analysis import markdown
from analysis.hard_cases.outcome import Outcome
from analysis.hard_cases.scenes import CLEAR_ERROR, CORRECT, LIMIT_REPORTED, SCENES, SILENT_WRONG

NUMBERS = {
    "energy": "energy_balance_error",
    "stress": "stress_error",
    "held": "held_error",
    "C0": "c0_error",
    "momentum": "momentum",
    "undamped": "undamped_momentum",
}


def table(outcomes: Iterable[Outcome]) -> str:
    """Table with a line for each case and engine."""
    heading = " ".join(f"{name:>9}" for name in NUMBERS)
    rows = [f"{'case':<20} {'engine':<6} {'verdict':<12} {'checks':>6} {'s':>5} {heading}"]
    for o in outcomes:
        numbers = " ".join(f"{_number(getattr(o, field)):>9}" for field in NUMBERS.values())
        rows.append(f"{o.case:<20} {o.engine:<6} {o.verdict:<12} {o.checks:>6} {o.seconds:5.0f} {numbers}")
        rows += [f"    FAILED {o.failed}"] if o.failed else []
    return "\n".join(rows)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value * (1.0 + 1e-12):.1e}"  # stored halves, 0.0135, round up


PAGE = """# Hard cases

Scenarios in which a DEM simulation may go wrong, each run on YADE and on `fused`, there in double and in mixed
precision. None may end in a silently wrong result: either the result is correct, or labkit reports what is wrong.
Written by

    {history}

with about {grains} grains, unless the case itself prescribes the number of grains. {summary}

- **{correct}**: all checks hold. **{limit}**: all checks hold, and the run reports which of its limits it exceeded.
  **{clear}**: labkit stopped with an error message that says what to change. **{silent}**: a check fails without any
  message.
- Every completed run is also checked for its energy balance (5 % of the work), for agreement of the stored stresses
  with those of the stored contacts and of the contacts found again by the fused kernel (1e-9, in mixed precision
  1e-7), for the quantities that the path holds (`labkit verify`), for drift of the centre of mass, and for agreement of
  C0 with Love's stress where p > 50 kPa.
- "Half the time step" is a run of the same specimen on the `fused` engine with half the time step. Shearing of grains
  is chaotic: two converged runs differ by some scatter, from which the tolerances are derived. They are given in
  `analysis/hard_cases`.

{cases}
{figure}
## Numbers

Energy: largest error of the balance, relative to the work. Stress: largest relative difference of stored and recomputed
stresses. Held: largest error of a quantity that the path holds (relative stress or volume, or difference of strains).
C0: largest difference from Love's stress where p > 50 kPa. Momentum: |sum m c| / sum m |c| at the end, with c relative
to the mean field; this is not rounding error, because local damping acts on each grain separately. Undamped: change
of the momentum over 50 steps without local damping, on the `fused` engine; this is rounding error. Empty cells: the
case leaves no run to measure, or the quantity does not apply.

{numbers}

## Messages of labkit

{guards}
"""


def page(outcomes: Sequence[Outcome], grains: int, history: str, drawn: bool) -> str:
    """The page, in Markdown."""
    wrong = sum(outcome.verdict == SILENT_WRONG for outcome in outcomes)
    summary = f"{len(outcomes)} cases, {wrong} silently wrong."
    cases, guards = [], []
    for name in dict.fromkeys(outcome.case for outcome in outcomes):
        mine = [outcome for outcome in outcomes if outcome.case == name]
        cases.append(f"### {name}\n\n*Expected:* {SCENES[name].should if name in SCENES else mine[0].should}.\n")
        for o in mine:
            failed = f" **Failed: {o.failed}.**" if o.failed else ""
            cases.append(f"- {o.engine}, **{o.verdict}**: {_cell(o.did)}.{failed}")
            guards.append(f"- {name}, {o.engine}: {_cell(o.guard) or 'none'}")
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
        limit=LIMIT_REPORTED,
        clear=CLEAR_ERROR,
        silent=SILENT_WRONG,
        cases="\n".join(cases),
        numbers=markdown.table(header, numbers),
        guards="\n".join(guards),
        figure="![Six of the cases on all engines](hard_cases.png)\n" if drawn else "",
    )


def _cell(text: str) -> str:
    return text.replace(" | ", "; ").rstrip(".")
