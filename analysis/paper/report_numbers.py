"""Named numbers of the paper's pages: report.md, fidelity.md and model_errors.md."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pandas

from analysis import markdown
from analysis.paper.ends import OTHERS
from analysis.paper.model_comparison import FAR_ENOUGH, LABELS, OURS, TABLE_2
from analysis.paper.numbers import INDEPENDENT
from analysis.paper.specimens import specimens_of
from analysis.places import texts
from analysis.statistics import cluster_mean

Values = dict[str, Any]
PATHS: dict[str, str] = texts(__file__)["paths"]
KINDS: dict[str, str] = texts(__file__)["kinds"]
LAWS: dict[str, str] = texts(__file__)["laws"]


def of_the_paper(rows: pandas.DataFrame) -> pandas.DataFrame:
    """The rows of the paper's tests, without those of tests that compare engines and contact laws."""
    return rows[~rows["run"].str.startswith(OTHERS)]


def medians(own: pandas.DataFrame) -> Values | None:
    """Median errors of q and e over tests; None without tests."""
    return {"q": own["q_error"].median(), "e": own["e_error_of_change"].median()} if len(own) else None


def model_medians(errors: pandas.DataFrame) -> list[Values]:
    """Median errors of the model in the paper's tests, by parameters."""
    rows = []
    for key in (TABLE_2, OURS):
        own = of_the_paper(errors)[of_the_paper(errors)["parameters"] == key]
        cyclic = own["path"] == "cyclic_cp"
        rows.append({"label": LABELS[key], "monotonic": medians(own[~cyclic]), "cyclic": medians(own[cyclic])})
    return [row for row in rows if row["monotonic"]]


# The paper's numbers and ours

NEEDED = (
    "number label ours within paper_says paper_rounding difference judged agrees kind uncertainty_of explanation"
).split()


def fidelity(numbers: pandas.DataFrame) -> Values:
    """The table of fidelity.csv for readers, the numbers that agree, and the explanations of those that do not."""
    numbers = numbers.reindex(columns=list(NEEDED))
    rows = pandas.DataFrame([number_row(row) for row in numbers.itertuples()])
    verdicts = numbers["agrees"].astype(str)
    marks = verdicts.map({"yes": "inside", "no": "outside"}).fillna("").tolist()
    cells = [[markdown.literal(cell) for cell in row] for row in rows.to_numpy()]
    measured = numbers["kind"].fillna("measured") == "measured"
    others = verdicts[measured].value_counts().to_dict()
    explained = numbers[numbers["explanation"].fillna("") != ""]
    facts = numbers[numbers["number"].isin(INDEPENDENT)]
    return {
        "facts": {
            verdict: [INDEPENDENT[str(number)] for number in facts["number"][facts["agrees"] == verdict]]
            for verdict in ("yes", "no", "not resolved")
        },
        "measured": int(measured.sum()),
        "yes": others.pop("yes", 0),
        "no": others.pop("no", 0),
        "others": others,
        "rest": int((~measured).sum()),
        "rows": rows,
        "marked": pandas.DataFrame(markdown.marked(cells, marks), columns=rows.columns),
        "right": range(1, 8),
        "off": rows[measured & (verdicts == "no")].to_dict("records"),
        "explanations": list(zip(explained["label"], explained["explanation"], strict=True)),
    }


def number_row(row: Any) -> dict[str, str]:
    """A row of fidelity.csv as text: heading -> cell."""
    basis = "" if pandas.isna(row.uncertainty_of) else str(row.uncertainty_of)
    within = float(row.within)
    ours, _, half = markdown.text(float(row.ours), within, 4).partition(" ± ")
    unknown = "exact" if basis.startswith("exact") or within == 0.0 else "unknown"
    return {
        "number": row.label,
        "ours": ours,
        "our interval (95 %)": (f"± {half}" if half else unknown) if ours else "",
        "paper": _text(row.paper_says),
        "paper's rounding": "" if pandas.isna(row.paper_rounding) else f"± {markdown.number(row.paper_rounding, 2)}",
        "difference": _number(row.difference),
        "allowed": _number(row.paper_rounding + (0.0 if math.isnan(within) else within)),
        "matters from": _number(row.judged),
        "agrees": _text(row.agrees),
        "kind": _text(row.kind),
        "interval from": basis,
    }


def _text(value: object) -> str:
    return "" if pandas.isna(value) else str(value)


def _number(value: float) -> str:
    return "" if pandas.isna(value) else f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}"


# The errors of the model

SHOWN = {"q_error": "q", "p_error": "p", "e_error_of_change": "e"}
FAILS = 1.5  # ratio of the errors of e and q above which the void ratio counts as poorly predicted


def model_errors(errors: pandas.DataFrame) -> Values:
    """The errors of model_errors.csv by type of test and of every test, and the failures of the model."""
    labels = [key for key in (TABLE_2, OURS) if key in errors["parameters"].values]
    wide = errors.pivot(index="run", columns="parameters", values=[*SHOWN, "reached"])
    per_test = [
        {"test": name}
        | {
            f"{quantity}, {LABELS[key]}": _percent(wide.loc[name, (column, key)], wide.loc[name, ("reached", key)])
            for column, quantity in SHOWN.items()
            for key in labels
        }
        for name in dict.fromkeys(errors["run"] if labels else ())
    ]
    by_kind = errors_by_kind(of_the_paper(errors))
    return {
        "enough": FAR_ENOUGH,
        "fitted": list(errors["run"][errors["calibrated_on"].astype(bool)]),
        "by_kind": by_kind,
        "right_by_kind": range(2, by_kind.shape[1]),
        "per_test": pandas.DataFrame(per_test),
        "right_per_test": range(1, 1 + len(SHOWN) * len(labels)),
        **failures(of_the_paper(errors)),
    }


def errors_by_kind(errors: pandas.DataFrame) -> pandas.DataFrame:
    """Means over specimens with their intervals, as text, a row per type of test and set of parameters."""
    kinds = errors.assign(kind=errors["path"].map(KINDS), specimen=specimens_of(errors["run"]))
    rows = []
    for kind in KINDS.values():
        for key, label in LABELS.items():
            own = kinds[(kinds["kind"] == kind) & (kinds["parameters"] == key)]
            if own.empty:
                continue
            row = {"type of test": kind, "parameters": label, "tests": len(own), "specimens": own["specimen"].nunique()}
            for column, quantity in SHOWN.items():
                found = cluster_mean(own[column], own["specimen"])
                spread = f" ± {found.within:.1%}" if np.isfinite(found.within) else ""
                row[quantity] = _percent(found.value, own["reached"].max()) + spread
            rows.append(row | {"strain completed, at least": f"{own['reached'].min():.0%}"})
    return pandas.DataFrame(rows)


def failures(errors: pandas.DataFrame) -> Values:
    """The shortcomings of the model: a poor void ratio, as the paper reports it, and tests that it does not complete.

    The void ratio is poor in stress-controlled or cyclic tests if the error of e, relative to its range, exceeds FAILS
    times the error of q, relative to the largest q.
    """
    poor = []
    for kind, paths in (("stress-controlled tests (CR, CP)", ("cr", "cp")), ("cyclic tests", ("cyclic_cp",))):
        for key in (TABLE_2, OURS):
            found = medians(errors[errors["path"].isin(paths) & (errors["parameters"] == key)])
            if found and np.isfinite(found["e"]):
                poor.append(
                    {"kind": kind, "label": LABELS[key], "reproduced": found["e"] > FAILS * found["q"], **found}
                )
    early = errors[errors["status"].fillna("").ne("") & (errors["reached"] < 1.0)]
    return {"void_ratio": poor, "stopped": early.assign(label=early["parameters"].map(LABELS)).to_dict("records")}


def _percent(value: float, reached: float = 1.0) -> str:
    return f"{value:.1%}" if np.isfinite(value) else "given" if reached >= FAR_ENOUGH else "ended"


# What the campaign cost

BENCH = "speed_error/engines.csv"
STOCK = "stock YADE script, 1 thread"
IDLE = {"fused": "fused, 1 thread", "yade": "labkit on YADE, 1 thread"}  # engine of a run -> engine of the benchmark
HOUR, DAY = 3600.0, 86400.0  # s


def cost(runs: pandas.DataFrame, bench: pandas.DataFrame | None) -> Values:
    """Cost of the runs of campaign.csv, measured and at the speeds of the benchmark, see `bench_speeds`."""
    speeds = bench_speeds(bench)
    stock = speeds.get(STOCK)
    sums = costs(runs, stock)
    total = sums.iloc[-1]
    return {
        "runs": total["runs"],
        "grain_steps": total["grain-steps"],
        "core_hours": total["core time, h"],
        "idle": idle_hours(runs, speeds),
        "bench": BENCH,
        "stock": stock,
        "stock_days": total["stock YADE, h"] * HOUR / DAY / 2 if stock else None,
        "by_engine": sums,
        "every_run": runs,
    }


def costs(runs: pandas.DataFrame, stock: float | None) -> pandas.DataFrame:
    """Sums over the runs of campaign.csv by engine, and over all runs in the last row; a pandas.DataFrame.

    `stock`: grain-steps per second of a stock YADE script on one thread, or None.
    """
    hours = runs["wall_time"].astype(float) / HOUR
    columns = {
        "engine": runs["engine"].astype(str),
        "runs": 1,
        "grain-steps": _grain_steps(runs),
        "wall time, h": hours,
        "core time, h": hours * runs["threads"].astype(float),
    }
    if stock:
        columns["stock YADE, h"] = _grain_steps(runs) / stock / HOUR
    sums = pandas.DataFrame(columns).groupby("engine", sort=False).sum()
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


def bench_speeds(table: pandas.DataFrame | None) -> dict[str, float]:
    """Grain-steps per second of every engine in the benchmark of `./lab speed-error`, for its largest specimen."""
    if table is None:
        return {}
    return table.sort_values("grains").groupby("engine")["grain_steps_per_second"].last().astype(float).to_dict()


# The runs


def run_list(folder: Path) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per reduced run file: test, specimen, initial state, engine and contact law."""
    return pandas.DataFrame([_run(file) for file in sorted((folder / "runs").glob("*.run.nc"))])


def _run(file: Path) -> Values:
    with netCDF4.Dataset(file) as run:
        path = json.loads(getattr(run, "path_parameters", "{}"))
        recipe = json.loads(getattr(run, "recipe", "{}"))
        held = path.get("pressure") if run.path in ("cr", "cp", "cyclic_cp") else None
        law = json.loads(run.scene)["law"]
        return {
            "run": file.name.removesuffix(".run.nc"),
            "test": KINDS.get(run.path, run.path),
            "e of the specimen": recipe.get("void_ratio"),
            "seed": recipe.get("seed"),
            "initial p, MPa": float(np.trace(run["stress"][0])) / 3e6,
            "held stress, MPa": held / 1e6 if held else None,
            "axial rate, 1/s": path.get("rate"),
            "grains": len(run["grains"].dimensions["grain"]),
            "engine": run.engine,
            "contact law": LAWS.get(law, law),
        }
