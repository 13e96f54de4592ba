"""The study of the hard cases: all of them on each engine, resumable; a table, a figure and a page."""

from __future__ import annotations

import dataclasses
import json

import matplotlib.pyplot as plt
import numpy as np
import pandas

from analysis import markdown
from labkit.visuals import plots
from labkit.runs.dataset import open_run
from labkit.errors import InputError
from labkit.io.files import make_folder, write_text
from analysis.hard_cases.cases import Outcome, cycle_ends, examine
from analysis.hard_cases.scenes import CLEAR_ERROR, CORRECT, LIMIT_SAID, SCENES, SILENT_WRONG
from labkit.dem.limits import OVERLAP_LIMIT, PRESSURE_LIMIT
from labkit.io.provenance import write_told
from labkit.dem.scene import Scene
from labkit.dem.specimen import side_for

SMALLEST_VOID_RATIO = 0.3


def study(names, engines, grains, output, work, command, progress, history):
    """Runs the named scenes on the engines and writes hard_cases.csv, hard_cases.png and README.md to `output`.

    `command` runs words as `labkit` does and raises its errors; `work`: folder of the run files, where finished cases
    are kept. Returns 1 when a case is silently wrong, else 0. Raises InputError for names, grains or folders that
    cannot be.
    """
    unknown = [name for name in names if name not in SCENES]
    if unknown:
        raise InputError(f"hard case {unknown[0]!r} is unknown: use {', '.join(SCENES)}")
    side_for(grains, SMALLEST_VOID_RATIO, Scene())
    folder, output = make_folder(work, "--work") / f"n{grains}", make_folder(output, "--output")
    names = list(dict.fromkeys(names))
    outcomes, all_ = [], [(engine, name) for engine in engines for name in names]
    for done, (engine, name) in enumerate(all_):
        progress(done / len(all_), f"{name} on {engine}, {len(all_) - done} to do")
        outcomes.append(_examined(SCENES[name], engine, grains, folder, command))
    progress(1.0, "done")
    outcomes.sort(key=lambda outcome: names.index(outcome.case))
    print(table(outcomes))
    frame = pandas.DataFrame([dataclasses.asdict(outcome) for outcome in outcomes])
    write_told(output / "hard_cases.csv", frame.to_csv(index=False, float_format="%.4g"))
    drawn = draw(folder, engines, names)
    if drawn is not None:
        plots.save(drawn, output / "hard_cases.png")
    write_told(output / "README.md", page(outcomes, grains, history, drawn is not None))
    print(f"page: {output / 'README.md'}")
    return int(any(outcome.verdict == SILENT_WRONG for outcome in outcomes))


def _examined(scene, engine, grains, folder, command):
    """The Outcome of a case: that in the work folder if it is of the same scene, else a new one, kept there."""
    place = folder / engine / scene.name
    kept, of = place / "outcome.json", json.loads(json.dumps(dataclasses.asdict(scene)))
    if kept.exists():
        found = json.loads(kept.read_text())
        if found["scene"] == of:
            return Outcome(**found["outcome"])
    outcome = examine(scene, engine, grains, 1.0, place, folder / "shared", command)
    write_text(kept, json.dumps({"scene": of, "outcome": dataclasses.asdict(outcome)}, indent=1))
    return outcome


NUMBERS = {
    "energy": "energy_balance_error", "stress": "stress_error", "held": "held_error", "C0": "c0_error",
    "momentum": "momentum", "undamped": "undamped_momentum",
}  # fmt: skip


def table(outcomes):
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


# --- the page ---------------------------------------------------------------------------------------------------

PAGE = """# Hard cases

Scenes at which a simulation of grains may go wrong, each run with the commands of a user on both engines. None may end
in a silent wrong answer: what comes out is correct, or labkit says what is wrong. Made by

    {history}

with about {grains} grains where a case is not about their number. {summary}

- **{correct}**: every check of the case holds. **{limit}**: they hold, and the run says which of its limits it left.
  **{clear}**: labkit gave up with a sentence that says what to change. **{silent}**: a check fails and nothing said so.
- Every run that ended is also checked for its energy balance (5 % of the work), for the stresses in the file against
  those of its stored contacts and of the contacts that the fused kernel finds anew (1e-9), for what the path holds
  (`labkit verify`), for a drift of the centre of mass, and for C0 against Love where p > 50 kPa.
- "Half the step" is a run of the same specimen on the engine fused with half the time step. Shear of grains is chaotic:
  two converged runs differ by a scatter, which the tolerances are made of. They are in `labkit/hard_cases.py`.

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


def page(outcomes, grains, history, drawn):
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
        [o.case, o.engine, str(o.checks or ""), *(_number(getattr(o, field)) for field in NUMBERS.values()),
         f"{o.seconds:.0f}"]
        for o in outcomes
    ]  # fmt: skip
    header = ["case", "engine", "checks", *NUMBERS, "seconds"]
    return PAGE.format(
        history=history, grains=grains, summary=summary, correct=CORRECT, limit=LIMIT_SAID, clear=CLEAR_ERROR,
        silent=SILENT_WRONG, cases="\n".join(cases), numbers=markdown.table(header, numbers), guards="\n".join(guards),
        figure="![Six of the cases on both engines](hard_cases.png)\n" if drawn else "",
    )  # fmt: skip


def _cell(text):
    return text.replace(" | ", "; ").rstrip(".")


# --- the figure -------------------------------------------------------------------------------------------------

STYLES = {"yade": {"color": "tab:blue", "ls": "-"}, "fused": {"color": "tab:orange", "ls": "--"}}
REFERENCE = {"color": "0.6", "ls": "-", "lw": 0.9, "zorder": 0, "label": "fused, half the step"}


def draw(folder, engines, names):
    """Those of six panels whose cases are in `names` and left runs, a Figure; None without any."""
    wanted = [(name, panel) for name, panel in PANELS.items() if name in names]
    columns = min(3, len(wanted))
    if not wanted:
        return None
    rows = -(-len(wanted) // columns)
    figure, grid = plt.subplots(
        rows, columns, figsize=(plots.WIDTH * 1.2 * columns / 3, 3.5 * rows + 0.3), layout="constrained", squeeze=False
    )
    for axes in grid.ravel()[len(wanted) :]:
        axes.axis("off")
    handles = {}
    for axes, (name, panel) in zip(grid.ravel(), wanted):
        references = folder.glob(f"shared/{name}_n*.run.nc")
        curves = [(file, REFERENCE) for file in references]
        curves += [(folder / e / name / "run.run.nc", {**STYLES[e], "lw": 1.3, "label": e}) for e in engines]
        for file, style in curves:
            if file.exists():
                panel(axes, open_run(file), style)
        axes.set_title(name, fontsize=10)
        axes.grid(alpha=0.25)
        handles |= {h.get_label(): h for h in axes.get_legend_handles_labels()[0]}
    figure.legend(handles=list(handles.values()), loc="outside lower center", ncols=6, frameon=False, fontsize=8)
    return figure


def _loose(axes, run, style):
    axes.semilogy(plots.percent(run), run.lab.mean_stress().values / 1e3, **style)
    axes.set(xlabel="axial strain (%)", ylabel="mean stress p (kPa)")


def _nothing(axes, run, style):
    axes.plot(-plots.percent(run), run["coordination_number"].values, **style)
    axes.set(xlabel="dilation, strain in each direction (%)", ylabel="coordination number Z")


def _overlap(axes, run, style):
    axes.plot(run.lab.mean_stress().values / 1e6, 100.0 * run["overlap_ratio"].values, **style)
    axes.axhline(100.0 * OVERLAP_LIMIT, color="tab:red", lw=0.8, ls=":", label="limits")
    axes.axvline(PRESSURE_LIMIT / 1e6, color="tab:red", lw=0.8, ls=":")
    axes.set(xlabel="mean stress p (MPa)", ylabel="mean overlap/D (%)")


def _cycles(axes, run, style):
    axes.plot(plots.percent(run), run.lab.deviatoric_stress().values / 1e6, **style)
    axes.set(xlabel="axial strain (%)", ylabel="deviatoric stress q (MPa)")


def _ratchet(axes, run, style):
    e, _ = cycle_ends(run)
    axes.plot(np.arange(len(e)), 1e5 * (e - e[0]), **style)
    axes.set(xlabel="cycle", ylabel=r"change of the void ratio ($10^{-5}$)")


def _long(axes, run, style):
    axes.plot(plots.percent(run), (run.lab.deviatoric_stress() / run.lab.mean_stress()).values, **style)
    axes.set(xlabel="axial strain (%)", ylabel="q/p")


PANELS = {
    "loose_cv": _loose, "isod_to_nothing": _nothing, "isoc_beyond": _overlap, "growing_cycles": _cycles,
    "many_cycles": _ratchet, "strain_100": _long,
}  # fmt: skip
