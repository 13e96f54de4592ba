"""The report's section on cost: the campaign's recorded times, and estimates from the benchmark on an idle computer."""

from __future__ import annotations

from pathlib import Path

import pandas

from analysis import markdown
from analysis.paper import pieces
from analysis.paper.pieces import join

BENCH = "speed_error/engines.csv"
STOCK = "stock YADE script, 1 thread"
IDLE = {"fused": "fused, 1 thread", "yade": "labkit on YADE, 1 thread"}  # engine of a run -> engine of the benchmark
HOUR, DAY = 3600.0, 86400.0  # s


def cost(folder: Path, tables: str, study: str) -> str:
    """Section on the cost of the campaign. `tables`, `study`: commands that write campaign.csv and the benchmark."""
    heading, file, bench = "## What the campaign cost {#cost}", folder / "campaign.csv", folder.parent / BENCH
    if not file.is_file():
        return join(heading, pieces.missing(file.name, tables))
    runs, speeds = pandas.read_csv(file, dtype_backend="numpy_nullable"), bench_speeds(bench)
    stock = speeds.get(STOCK)
    sums = costs(runs, stock)
    total = sums.iloc[-1]
    text = (
        f"{total['runs']} runs, {markdown.number(total['grain-steps'], 3)} grain-steps. The recorded times add up to "
        f"{markdown.number(total['core time, h'], 3)} core hours, that is wall time multiplied by the number of "
        "threads. The computer was busy with other jobs as well, so an idle computer is faster"
    )
    idle = idle_hours(runs, speeds)
    if idle is not None:
        text += f": at the speeds of the benchmark (`results/{BENCH}`) {markdown.number(idle, 2)} core hours"
    text += (
        ". The dry run (`./lab campaign analysis/paper/paper.yaml --dry-run`) estimates the time on an idle computer "
        "too. It adds the specimens and their consolidation, which are not counted here, and takes the tests that stop "
        "at a stress at their full length."
    )
    if stock:
        text += (
            f" A stock YADE script on one thread runs {markdown.number(stock, 3)} grain-steps per second; it would "
            f"need {markdown.number(total['stock YADE, h'] * HOUR / DAY / 2, 3)} days for these runs on two cores, two "
            "simulations at a time."
        )
    return join(
        heading,
        text,
        "" if stock else pieces.missing(bench.name, study),
        pieces.table(sums, "cost by engine"),
        pieces.table(runs, "cost of every run", fold=True),
    )


def costs(runs: pandas.DataFrame, stock: float | None) -> pandas.DataFrame:
    """Sums over the runs of campaign.csv by engine, and over all runs in the last row; a pandas.DataFrame.

    `stock`: grain-steps per second of a stock YADE script on one thread, or None.
    """
    runs = runs.assign(
        engine=runs["engine"].astype(str),
        **{
            "runs": 1,
            "grain-steps": _grain_steps(runs),
            "wall time, h": runs["wall_time"].astype(float) / HOUR,
        },
    )
    runs["core time, h"] = runs["wall time, h"] * runs["threads"].astype(float)
    if stock:
        runs["stock YADE, h"] = runs["grain-steps"] / stock / HOUR
    shown = ["runs", "grain-steps", "wall time, h", "core time, h", *["stock YADE, h"] * (stock is not None)]
    sums = runs.groupby("engine", sort=False)[shown].sum()
    return pandas.concat([sums, sums.sum().to_frame("all").T.astype(sums.dtypes)]).reset_index(names="engine")


def idle_hours(runs: pandas.DataFrame, speeds: dict[str, float]) -> float | None:
    """Core hours of the runs of campaign.csv at the speeds of the benchmark; None if an engine is not in it."""
    names = [IDLE.get(str(engine), "") for engine in runs["engine"]]
    if not all(name in speeds for name in names):
        return None
    seconds = _grain_steps(runs) / [speeds[name] for name in names]
    return float(seconds.sum() / HOUR)


def _grain_steps(runs: pandas.DataFrame) -> pandas.Series:
    return runs["steps"].astype(float) * runs["grains"].astype(float)


def bench_speeds(file: Path) -> dict[str, float]:
    """Grain-steps per second of every engine in the benchmark of `./lab speed-error`, for its largest specimen.

    Empty if the file is missing.
    """
    if not file.is_file():
        return {}
    table = pandas.read_csv(file).sort_values("grains")
    return table.groupby("engine")["grain_steps_per_second"].last().astype(float).to_dict()
