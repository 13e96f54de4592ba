"""The page of a study: Markdown with tables made of its data set. No number is written by hand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas
import xarray as xr

import labkit as lk
from analysis import markdown
from analysis.speed_error import others, settings
from analysis.speed_error.cells import percent, short
from analysis.speed_error.design import BASELINE, PRESET, RATE
from analysis.speed_error.observables import CHECKS, OBSERVABLES
from analysis.speed_error.table import cost
from labkit.dem import STANDARD, ConstantVolume

OTHERS = {
    "engines": others.engines,
    "lammps": others.lammps,
    "skin": others.skin,
    "collisions": others.collisions,
    "sff_family": others.family,
    "model": others.model,
}


def page(data: xr.Dataset, table: pandas.DataFrame, measures: Mapping[str, pandas.DataFrame], command: str) -> str:
    """The text of results/speed_error/README.md. `table`: of errors(), `measures`: of measure_others(), `command`: what
    wrote it.
    """
    sections = [
        _head(data, command),
        *(settings.section(data, table, measures["settings"], path) for path in ("cp", "cv")),
        _paper(table),
        _how_to_read(),
        _defaults(data, table),
        _factors(data, table),
        _time_step(data),
        _sizes(),
        _same_on_both(table),
    ]
    sections += [write(measures[name]) for name, write in OTHERS.items() if name in measures]
    return "\n\n".join(section for section in [*sections, _failed(data)] if section) + "\n"


def _head(data, command):
    tests = int(((data["status"] == "") & (data["seed"] > 0)).sum())
    whole = float(data["wall_time"].sum()) / 3600.0
    return f"""# Speed against error

How fast can a test run, and what does that cost in accuracy? {data.sizes["case"]} cases, {tests} tests,
{whole:.1f} hours of computing, made by one command, which goes on where it was cut off:

    {command}

The data: `study.nc` (every observable of every test), `errors.csv` (what the tables here are made of), and a table for
each of the other measurements. [The hard cases](../hard_cases/README.md) have a page of their own."""


def _paper(table):
    some = table[(table["factor"] == PRESET) & (table["level"] == "the paper's")]
    if some.empty:
        return ""
    clear = some[(np.abs(some["error"]) > some["error_within"]) & (some["observable"] != "pressure_critical")]
    told = ", ".join(f"{row.label} ({percent(row.error)})" for row in clear.itertuples()) or "none"
    return f"""## The paper's own settings

A cube of 4 mm with 14,000 grains, 10 1/s, dashpots of 0.2: the red star below, the last column above. Its contact
law is the paper's (Eqs. 1-3), the other columns have YADE's. Observables that differ from the reference by more
than their interval: {told}. The paper does not say its time step.

![cost against error, CP](pareto_cp.png)

![cost against error, CV](pareto_cv.png)"""


def _how_to_read():
    return """## How to read this

**error**: mean over the specimens less that of the reference, with its 95 % interval (pair by pair where these are
the reference's own specimens, else Welch's); in brackets where the interval reaches zero: such a difference is not told
from the scatter. **one test**: what a single test is off by, sqrt(error² + scatter²). **change**: mean difference to
the baseline (standard settings, 1,000 grains) with the same specimens, which takes most of the scatter out. About one
in twenty intervals misses zero by chance. Critical: means over the last quarter of the strain. **cost**: wall time over
that of a yardstick (the same steps of the same specimen, timed just before and after in the same process), median over
the specimens: what else the machine does cancels in part, a fifth or so is left. The times of the sets of settings were
measured in turn instead. All changes are against the same three tests of the baseline: what these are off by, by
chance, is in every row alike. The first row of a table of changes, the median of all, shows it, and the comparison of
the defaults takes it out."""


def _factors(data, table):
    costs = cost(data)
    text = ["## One factor at a time, and pairs", "![what each factor changes](changes.png)"]
    for path, held in (("cp", "pressure_critical"), ("cv", "void_ratio_critical")):
        base = data["case"].values[(data["path"].values == path) & (data["factor"].values == BASELINE)]
        some = table[(table["path"] == path) & ~table["factor"].isin([PRESET, BASELINE, "grains", "engine"])]
        if some.empty:
            continue
        names = [name for name in OBSERVABLES if name != held]
        typical = common(some)
        rows = [["median of all", "", "", *(f"{100 * typical[name]:+.2g}" for name in names)]]
        for case, lines in some.groupby("case", sort=False):
            lines = lines.set_index("observable")
            ratio = float(costs.sel(case=case) / costs.sel(case=base[0]))
            cells = [_change(lines.loc[name]) for name in names]
            factor, level = lines["factor"].iloc[0], _number(lines["level"].iloc[0])
            rows.append([factor, level, f"{ratio:.2g}" if np.isfinite(ratio) else "-", *cells])
        text.append(
            f"Changes along {path.upper()} against the baseline, %. A bold one is outside its 95 % interval; where "
            "there is only an interval, the change lies inside it and is not told from zero."
        )
        text.append(markdown.table(["factor", "level", "cost", *(OBSERVABLES[name][0] for name in names)], rows))
    return "\n\n".join(text)


def common(table: pandas.DataFrame) -> pandas.Series:
    """observable -> median of the changes of all cases of a path: what the baseline's own tests are off by."""
    return table.groupby("observable")["change"].median()


def _change(row):
    change, within = 100 * row["change"], 100 * row["change_within"]
    if not np.isfinite(change):
        return "-"
    if not np.isfinite(within):
        return f"{change:+.2g}"
    return f"**{short(change, '+')}** ± {short(within)}" if abs(change) > within else f"± {short(within)}"


def _number(text):
    """A level as short as it can be written."""
    try:
        return f"{float(text):g}" if float(text) < 1e6 else f"{float(text) / 1e9:g} GPa"
    except ValueError:
        return text


DEFAULTS = {  # factor -> what the default is, where it lives
    "time step": (lk.Scene.time_step_factor, "`--time-step-factor`, Scene.time_step_factor"),
    "rate": (RATE, "`--rate`, paths.ConstantVolume.rate"),
    "servo interval": (STANDARD.interval, "servo.Servo.interval"),
    "servo gain": (STANDARD.gain, "servo.Servo.gain"),
    "record interval": (ConstantVolume.record_strain, "`--record-strain`"),
    "local damping": (lk.Scene.local_damping, "Scene.local_damping"),
}


def _defaults(data, table):
    """Every default beside the next lower and the next higher level that was measured."""
    rows = []
    along = table[(table["path"] == "cp") & ~table["factor"].isin([PRESET, BASELINE, "grains", "engine"])]
    typical = common(along)
    table = table.assign(change=table["change"] - table["observable"].map(typical).fillna(0.0))
    for factor, (value, where) in DEFAULTS.items():
        some = table[(table["path"] == "cp") & (table["factor"] == factor)]
        levels = np.array(sorted(some["level"].astype(float).unique()))
        cells = []
        for level in (*levels[levels < value][-1:], *levels[levels > value][:1]):
            lines = some[(some["level"].astype(float) == level) & (some["observable"] != "pressure_critical")]
            clear = lines[np.abs(lines["change"]) > lines["change_within"]]
            told = f"cost {lines['cost'].iloc[0]:.2g}, {len(clear)} of {len(lines)} changed"
            if len(clear):
                largest = clear.loc[clear["change"].abs().idxmax()]
                told += f", most {largest['label']} ({percent(largest['change'])})"
            held = float(data["check"].sel(case=lines["case"].iloc[0], check_name="held_error").mean())
            cells.append(f"{level:g}: {told}; held stress off by {100 * held:.2g} %")
        rows.append([f"{factor}: **{value:g}**", where, *(cells + ["-"] * (2 - len(cells)))])
    return (
        "## Every default beside its neighbours\n\nBaseline of 1,000 grains along CP. Cost is over that of the "
        "default; observables that changed are those outside their 95 % interval, the median of all cases "
        "taken out.\n\n"
        + markdown.table(["default", "where", "next lower", "next higher"], rows)
        + "\n\nWhat is cheaper and does not show here is kept as a margin. A longer step comes near the limit of law "
        "paper (the table of time steps), and a denser or more widely graded specimen has a lower limit; a higher rate "
        "leaves the paper's bound of the inertial number, 3e-4, at low pressure. `quick` takes both."
    )


def _time_step(data):
    rows = []
    at = np.flatnonzero(
        [("time step" in f) and p == "cp" for f, p in zip(data["factor"].values, data["path"].values, strict=True)]
    )
    for k in at:
        case = data.isel(case=int(k))
        limits = case["time_step_over_limit"].values[case["seed"].values > 0]
        limit, limits = float(np.nanmean(limits)), limits[np.isfinite(limits)]
        energy = float(case["check"].sel(check_name="energy_balance_error").max())
        held = float(case["check"].sel(check_name="held_error").mean())
        said = [s for s in np.unique(case["status"].values.astype(str)) if s]
        refused = int((limits > 1.0).sum())
        guard = f"refuses {refused} of {len(limits)} at the start"
        if not refused:
            guard = "stops the run" if energy > 0.05 else "silent"
        balance = f"{100 * energy:.2g} %" if np.isfinite(energy) else f"ends: {said[0][:60]}"
        names = case["factor"].item(), case["level"].item()
        over = f"{limit:.2f} ({limits.min():.2f} to {limits.max():.2f})"
        rows.append([*names, over, balance, f"{100 * held:.2g} %", guard])
    return """## The time step, through the limit and past it

The guards were off here but for the pairs with the rate, to see what comes. The limit is that of
`labkit.dem.time_step`, a bound that is on the safe side; it is the mean over the specimens, the range beside it decides
what the guard says.

""" + markdown.table(
        [
            "factor",
            "level",
            "step over limit",
            CHECKS["energy_balance_error"][0],
            CHECKS["held_error"][0],
            "what the guards say",
        ],
        rows,
    )


def _sizes():
    return "## How many grains\n\n![scatter and error over the number of grains](sizes.png)"


def _same_on_both(table):
    same = table[table["factor"] == "engine"]
    both = same.pivot_table(index="observable", columns="level", values="mean", sort=False)
    if not {"yade", "fused"} <= set(both):
        return ""
    rows = [
        [OBSERVABLES[name][0], f"{yade:.4g}", f"{fused:.4g}", percent(fused / yade - 1.0)]
        for name, yade, fused in zip(both.index, both["yade"], both["fused"], strict=True)
    ]
    return (
        "## YADE and fused\n\nThe same specimens on both engines, law yade, one thread; means over "
        f"{same['replicates'].max()}. More threads give the same bits on `fused`; on YADE they change the order of "
        "sums.\n\n" + markdown.table(["", "YADE", "fused", "difference"], rows)
    )


def _failed(data):
    said = {}
    for case, statuses in zip(data["case"].values, data["status"].values.astype(str), strict=True):
        for status in filter(None, statuses):
            said.setdefault(str(case), status)
    if not said:
        return ""
    rows = [[case, status] for case, status in said.items()]
    return "## Tests that ended with an error\n\n" + markdown.table(["case", "what was said"], rows)
