"""The report of a campaign: all runs, limits that were exceeded, failures, and provenance, in Markdown.

Paths are relative to the campaign folder.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from labkit.errors import printable
from labkit.files.netcdf import name_damage
from labkit.files.provenance import commit, libraries, machine, provenance_of, write_with_provenance
from labkit.paths.rates import default_rate, on_grains, rate_of
from labkit.plugins.campaigns.jobs import Job
from labkit.plugins.campaigns.layout import CAMPAIGN, OVERVIEW, PLOTS, REPORT, RUNS, STATISTICS, Row, output_of
from labkit.plugins.campaigns.workflow import failures
from labkit.records.limits import Exceeded, exceeded_in
from labkit.results.dataset import open_whole
from labkit.specimens.recipe import SETTINGS
from labkit.version import __version__

INERTIAL = "inertial number"  # name of the limit in labkit.records.limits
Limits = Mapping[str, Sequence[Exceeded]]  # name of a run -> limits that it exceeded


def write_report(rows: Sequence[Row], finished: Sequence[Job]) -> None:
    """Write the report: a summary, one row per run, limits exceeded, failures with reasons, and the provenance.

    `rows` are the rows of plan.json, and `finished` are the finished runs.
    """
    limits = {job.name: exceeded_in(output_of(job)) for job in finished}
    rates = {job.name: _rate_factor(job) if limits[job.name] else 1.0 for job in finished}
    table = [line for job in finished if (line := _row(job, limits[job.name]))]
    failed, waiting = failures(rows, ".")
    planned = sum(row.kind == "run" for row in rows)
    lines = [f"# Campaign {Path.cwd().name}", "", _summary(planned, rates, len(failed), limits), ""]
    if failed:
        lines += ["## Failed", "", *(f"- {kind} `{name}`: {_literal(reason)}" for kind, name, reason in failed), ""]
    if waiting:
        lines += [f"Not started: {', '.join(waiting)}.", ""]
    if table:
        lines += ["## Overview", "", f"![q/p and void ratio of all runs]({OVERVIEW})", ""] * Path(OVERVIEW).exists()
        lines += ["## Runs", "", *markdown_table(table), ""]
        lines += _limits_section(rates, limits)
        lines += ["## Figures", "", *(f"![{row['run']}]({PLOTS}/{row['run']}.png)" for row in table), ""]
    lines += ["## Provenance", "", *_origin(table)]
    inputs = [Path(STATISTICS) / f"{row['run']}.nc" for row in table]
    write_with_provenance(REPORT, "\n".join(lines) + "\n", inputs)


def _literal(text: str) -> str:
    """Return a text as code, in which nothing is Markdown or HTML."""
    return "`" + printable(text).replace("`", "'") + "`"


def _summary(planned: int, rates: Mapping[str, float], failed: int, limits: Limits) -> str:
    """Summarise finished runs, failures and limits; `rates` maps a run to its rate divided by the standard rate."""
    failures = f", {failed} {'job' if failed == 1 else 'jobs'} failed" if failed else ""
    start = f"{len(rates)} of {planned} runs are finished{failures}."
    if not rates:
        return start
    above = {name: {limit.name for limit in limits[name]} for name in rates if limits[name]}
    fast = sum(names == {INERTIAL} and rates[run] > 1.0 for run, names in above.items())
    sentences = [start]
    if fast:
        sentences.append(
            f"{fast} exceed only the limit on the inertial number, as expected of runs above the standard rate."
        )
    if len(above) > fast:
        others = "others" if fast else "of them"
        sentences.append(f"{len(above) - fast} {others} exceed a limit of quasi-static tests.")
    return " ".join([*sentences, "See Limits." if above else "None exceeds a limit of quasi-static tests."])


def _limits_section(rates: Mapping[str, float], limits: Limits) -> list[str]:
    """Write the section on limits: one table row per limit, and how many runs exceed it because of their rate."""
    names = dict.fromkeys(limit.name for ones in limits.values() for limit in ones)
    if not names:
        return []
    rows = [_limit_row(name, len(rates), limits) for name in names]
    settings = {preset.rate_factor: f" (`settings: {name}`)" for name, preset in SETTINGS.items()}
    fast = Counter(
        rates[run] for run in rates if rates[run] > 1.0 and INERTIAL in {limit.name for limit in limits[run]}
    )
    lines = [
        f"{number} of these runs are sheared at {factor:.3g} times the standard rate{settings.get(factor, '')}. This "
        "is a choice of the campaign file, which trades accuracy for time, and a higher inertial number is expected."
        for factor, number in sorted(fast.items())
    ]
    return ["## Limits", "", *markdown_table(rows), "", *lines, *[""] * bool(lines)]


def _limit_row(name: str, runs: int, limits: Limits) -> dict[str, object]:
    over = {run: limit for run, all_of_run in limits.items() for limit in all_of_run if limit.name == name}
    worst = max(over, key=lambda run: over[run].largest)
    return {
        "limit": name,
        "at most": over[worst].limit,
        "runs above": f"{len(over)} of {runs}",
        "records above, median": f"{np.median([limit.records / limit.of for limit in over.values()]):.0%}",
        "largest": over[worst].largest,
        "times the limit": over[worst].largest / over[worst].limit,
        "in run": worst,
    }


def _rate_factor(run: Job) -> float:
    """Return the rate of a run divided by the default rate of its path for these grains."""
    path = on_grains(run.loading, run.scene)
    return float(f"{rate_of(path) / default_rate(type(path), run.scene):.6g}")


def markdown_table(rows: Sequence[Mapping[str, object]]) -> list[str]:
    """Return the lines of a Markdown table, with the keys of the first row as columns."""
    cells = [list(rows[0]), ["---"] * len(rows[0]), *([_cell(value) for value in row.values()] for row in rows)]
    return [f"| {' | '.join(line)} |" for line in cells]


def _cell(value: object) -> str:
    """Return the text of a cell; empty for NaN."""
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return "" if text == "nan" else text


def _row(job: Job, limits: Sequence[Exceeded]) -> dict[str, object] | None:
    file = Path(STATISTICS) / f"{job.name}.nc"
    if not file.exists():
        return None
    with name_damage(file), open_whole(file, "statistics") as statistics:
        value = {name: float(statistics[name]) for name in statistics}
    return {
        "run": job.name,
        "path": job.loading.name,
        "engine": job.device.name,
        "specimen": job.specimen,
        "grains": int(value["grains"]),
        "p0, kPa": value["initial_mean_stress"] / 1e3,
        "p, kPa": value["final_mean_stress"] / 1e3,
        "e made, nominal": value.get("made_void_ratio_nominal", np.nan),
        "e0, nominal": value.get("initial_void_ratio_nominal", np.nan),
        "e0": value["initial_void_ratio"],
        "e": value["final_void_ratio"],
        "Z": value["final_coordination_number"],
        "peak q/p": value["peak_stress_ratio"],
        "q/p, last quarter": value.get("critical_M", np.nan),
        "critical": {1.0: "yes", 0.0: "not shown"}.get(value.get("critical_shown", np.nan), ""),
        "cycles": value.get("cycles", np.nan),
        "largest r_u": value.get("largest_pore_pressure_ratio", np.nan),
        "C0 error, %": 100.0 * value["largest_sff_error"],
        "error by volume, %": 100.0 * value.get("largest_sff_error_by_volume", np.nan),
        "limits exceeded": ", ".join(limit.name for limit in limits),
        "time, s": value["wall_time"],
    }


def _origin(rows: Sequence[Mapping[str, object]]) -> Iterator[str]:
    """Yield lines that name the software and the computers that produced the runs and the report."""
    here = machine()
    origins = {
        (record["labkit_version"], record["commit"] or "installed", record["machine"]["name"])
        for row in rows
        if (record := provenance_of(Path(RUNS) / f"{row['run']}.run.nc"))
    }
    yield f"- campaign file: `{CAMPAIGN}`; `labkit info FILE` shows the origin of any file"
    for version, code, name in sorted(origins):
        yield f"- runs by labkit {version}, {code}, on {name}"
    code = commit() or "installed"
    yield f"- this page by labkit {__version__}, {code}, on {here['name']} ({here['processor']})"
    yield f"- {', '.join(f'{name} {version}' for name, version in libraries().items())}"
