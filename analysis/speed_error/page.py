"""The page of a study, in Markdown. All numbers come from its data set."""

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
from analysis.speed_error.figures import WORST
from analysis.speed_error.observables import CHECKS, OBSERVABLES
from analysis.speed_error.table import cost
from labkit.paths import ConstantVolume
from labkit.servo import STANDARD

OTHERS = {
    "engines": others.engines,
    "lammps": others.lammps,
    "skin": others.skin,
    "collisions": others.collisions,
    "sff_family": others.family,
    "model": others.model,
}


def page(data: xr.Dataset, table: pandas.DataFrame, measures: Mapping[str, pandas.DataFrame], command: str) -> str:
    """Text of results/speed_error/README.md.

    `table`: from errors(), `measures`: from measure_others(), `command`: the command that wrote the study.
    """
    sections = [
        _head(data, command),
        *(settings.section(data, table, measures["settings"], path) for path in ("cp", "cv")),
        _paper(table),
        _faster(table),
        _how_to_read(),
        _defaults(data, table),
        _factors(data, table),
        _time_step(data),
        _sizes(),
        _same_on_both(table),
    ]
    sections += [write(measures[name]) for name, write in OTHERS.items() if name in measures]
    return "\n\n".join(section for section in [*sections, _failed(data)] if section) + "\n"


def _head(data: xr.Dataset, command: str) -> str:
    tests = int(((data["status"] == "") & (data["seed"] > 0)).sum())
    whole = float(data["wall_time"].sum()) / 3600.0
    return f"""# Speed against error

How fast can a test run, and what does that cost in accuracy? {data.sizes["case"]} cases, {tests} tests,
{whole:.1f} hours of computing, run by one command, which resumes an interrupted study:

    {command}

The data are in `study.nc` (every observable of every test), `errors.csv` (the source of the tables below), and one
table for each of the other measurements; `./lab speed-error --redraw` writes this page and its figures again from
them. The [hard cases](../hard_cases/README.md) have a separate page."""


def _paper(table: pandas.DataFrame) -> str:
    some = table[(table["factor"] == PRESET) & (table["level"] == "the paper's")]
    if some.empty:
        return ""
    clear = some[(np.abs(some["error"]) > some["error_within"]) & (some["observable"] != "pressure_critical")]
    different = ", ".join(f"{row.label} ({percent(row.error)})" for row in clear.itertuples()) or "none"
    return f"""## The paper's own settings

A 4 mm cube with 14,000 grains, a rate of 10 1/s and dashpot ratios of 0.2: this is the red star in the figures below
and the last column of the first table. Its contact law is the paper's (Eqs. 1-3); the other columns have YADE's
rolling-resistance law. Observables that differ from the reference by more than their interval: {different}.
The paper does not state its time step.

In the figures, each point is a case: the error of a single test against its cost. Errors above {WORST:g} % are drawn at
the top of a panel.

![cost against error, CP](pareto_cp.png)

![cost against error, CV](pareto_cv.png)"""


FASTER = ("inertial number", "precision", "inertial number x precision")


def _faster(table: pandas.DataFrame) -> str:
    """Section on mixed precision and tests at a given inertial number."""
    some = table[table["factor"].isin(FASTER) & (table["observable"] != "pressure_critical")]
    some = some[~((some["path"] == "cv") & (some["observable"] == "void_ratio_critical"))]
    if some.empty:
        return ""
    rows = []
    for (path, factor, level), lines in some.groupby(["path", "factor", "level"], sort=False):
        base = table.loc[(table["path"] == path) & (table["factor"] == BASELINE), "over_standard"].iloc[0]
        clear = int((np.abs(lines["change"]) > lines["change_within"]).sum())
        ratio = lines["over_standard"].iloc[0] / base
        rows.append([str(path).upper(), factor, level_text(level), f"{ratio:.2g}", f"{clear} of {len(lines)}"])
    looks = sum(int(row[-1].split(" of ")[1]) for row in rows)
    found = sum(int(row[-1].split(" of ")[0]) for row in rows)
    header = ["path", "factor", "level", "cost relative to the baseline", "intervals that exclude zero"]
    return (
        "## Inertial number and mixed precision\n\n`--inertial-number` shears as fast as an inertial number allows, "
        "`--precision mixed` computes forces in single precision. Neither is part of the settings above, which apply "
        "to every engine and keep the paper's rate; both can be added to each of them. The tests have 1,000 grains, "
        "whose steps cost relatively less in the caches of a core than those of a full specimen: the gain of mixed "
        "precision is larger there ([bench](../bench/README.md)).\n\n"
        + markdown.table(header, rows)
        + f"\n\nChanges from the baseline in {looks} comparisons; {found} of the 95 % intervals exclude zero, and "
        f"about {0.05 * looks:.0f} would by chance."
    )


def _how_to_read() -> str:
    return """## How to read this

- **error**: mean over the specimens minus that of the reference, with its 95 % interval (paired if the specimens are
  those of the reference, otherwise Welch's). It is in brackets if the interval includes zero: such a difference cannot
  be distinguished from scatter.
- **one test**: expected error of a single test, sqrt(error² + scatter²).
- **change**: mean difference from the baseline (standard settings, 1,000 grains) for the same specimens, which removes
  most of the scatter. About one interval in twenty misses zero by chance.
- **critical**: mean over the last quarter of the strain.
- **cost**: wall time relative to a yardstick (the same steps of the same specimen, timed in the same process just
  before and after the test), median over the specimens. The effect of other load on the computer partly cancels; the
  cost remains uncertain by about 20 %. The recommended settings were timed differently: by running them in turn.

All changes are relative to the same three baseline tests, so their random error enters every row equally. The first
row of a table of changes, the median over all cases, shows this error; it is subtracted in the comparison of the
defaults."""


def _factors(data: xr.Dataset, table: pandas.DataFrame) -> str:
    costs = cost(data)
    text = ["## One factor at a time, and pairs", "![what each factor changes](changes.png)"]
    for path, held in (("cp", "pressure_critical"), ("cv", "void_ratio_critical")):
        base = data["case"].values[(data["path"].values == path) & (data["factor"].values == BASELINE)]
        some = table[(table["path"] == path) & ~table["factor"].isin([PRESET, BASELINE, "grains", "engine"])]
        if some.empty:
            continue
        names = [name for name in OBSERVABLES if name != held]
        typical = common(some)
        rows = [["median over all cases", "", "", *(f"{100 * typical[name]:+.2g}" for name in names)]]
        for case, lines in some.groupby("case", sort=False):
            lines = lines.set_index("observable")
            ratio = float(costs.sel(case=case) / costs.sel(case=base[0]))
            cells = [_change(lines.loc[name]) for name in names]
            factor, level = lines["factor"].iloc[0], level_text(lines["level"].iloc[0])
            rows.append([factor, level, f"{ratio:.2g}" if np.isfinite(ratio) else "-", *cells])
        text.append(
            f"Changes in {path.upper()} tests relative to the baseline, %. For changes in bold the 95 % interval "
            "excludes zero; where only an interval is given, the change is not distinguishable from zero."
        )
        text.append(markdown.table(["factor", "level", "cost", *(OBSERVABLES[name][0] for name in names)], rows))
    return "\n\n".join(text)


def common(table: pandas.DataFrame) -> pandas.Series:
    """Median change of each observable over all cases of a path: the random error of the baseline's tests."""
    return table.groupby("observable")["change"].median()


def _change(row: pandas.Series) -> str:
    change, within = 100 * row["change"], 100 * row["change_within"]
    if not np.isfinite(change):
        return "-"
    if not np.isfinite(within):
        return f"{change:+.2g}"
    return f"**{short(change, '+')}** ± {short(within)}" if abs(change) > within else f"± {short(within)}"


LEVELS = {  # level in the data -> text on the page
    "paper": "the paper's law",
    "paper, no tangential dashpot": "the paper's law, no tangential dashpot",
    "paper, beta 0.05": "the paper's law, dashpot ratios of 0.05",
    "yade, mean rolling limit right": "YADE's law, mean rolling limit corrected",
    "off, law yade": "off, YADE's law",
    "off, law paper": "off, the paper's law",
}


def level_text(level: str) -> str:
    """Text of a level on the page, as short as possible."""
    try:
        return f"{float(level):g}" if float(level) < 1e6 else f"{float(level) / 1e9:g} GPa"
    except ValueError:
        return LEVELS.get(level, level.replace(", paper", ", the paper's law"))


DEFAULTS = {  # factor -> its default, and where it is defined
    "time step": (lk.Scene.time_step_factor, "`--time-step-factor`, Scene.time_step_factor"),
    "rate": (RATE, "`--rate`, `rate` of a path"),
    "servo interval": (STANDARD.interval, "Servo.interval"),
    "servo gain": (STANDARD.gain, "Servo.gain"),
    "record interval": (ConstantVolume.record_strain, "`--record-strain`"),
    "local damping": (lk.Scene.local_damping, "Scene.local_damping"),
}


def _defaults(data: xr.Dataset, table: pandas.DataFrame) -> str:
    """Section that compares every default with the next lower and the next higher level."""
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
            text = f"cost {lines['cost'].iloc[0]:.2g}, {len(clear)} of {len(lines)} changed"
            if len(clear):
                largest = clear.loc[clear["change"].abs().idxmax()]
                most = ":" if len(clear) == 1 else ", most of all"
                text += f"{most} {largest['label']} ({percent(largest['change'])})"
            held = float(data["check"].sel(case=lines["case"].iloc[0], check_name="held_error").mean())
            cells.append(f"{level:g}: {text}; error of the held stress {100 * held:.2g} %")
        rows.append([f"{factor}: **{value:g}**", where, *(cells + ["-"] * (2 - len(cells)))])
    return (
        "## Every default and its neighbours\n\nCP tests with 1,000 grains, as in the baseline. Cost is relative to "
        "the default; an observable counts as changed if the 95 % interval of its change (minus the median over all "
        "cases) excludes zero.\n\n"
        + markdown.table(["default", "where", "next lower", "next higher"], rows)
        + "\n\nCheaper settings that make no difference here were not adopted as defaults, to keep a safety margin. "
        "A longer time step approaches the stability limit of the paper's contact law (see the table of time steps), "
        "and a denser or more widely graded specimen has a lower limit; a higher rate exceeds the paper's limit on the "
        "inertial number, 3e-4, at low pressure. The `quick` settings give up both margins."
    )


def _time_step(data: xr.Dataset) -> str:
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
        errors = [s for s in np.unique(case["status"].values.astype(str)) if s]
        refused = int((limits > 1.0).sum())
        effect = f"refuses {refused} of {len(limits)} at the start"
        if not refused:
            effect = "stops the run" if energy > 0.05 else "none"
        balance = f"{100 * energy:.2g} %" if np.isfinite(energy) else f"stopped: {errors[0][:60]}"
        names = case["factor"].item(), level_text(case["level"].item())
        over = f"{limit:.2f} ({limits.min():.2f} to {limits.max():.2f})"
        rows.append([*names, over, balance, f"{100 * held:.2g} %", effect])
    return """## The time step below and above the stability limit

The checks of the time step and of the energy balance were disabled here, except in the cases that also vary the
strain rate, to see what happens. The limit is that of `labkit.grains.time_step`, a conservative bound; the table gives
the mean over the specimens, the range in brackets, and how many of them the check would refuse.

""" + markdown.table(
        [
            "factor",
            "level",
            "time step / limit",
            CHECKS["energy_balance_error"][0],
            CHECKS["held_error"][0],
            "effect of the checks",
        ],
        rows,
    )


def _sizes() -> str:
    return "## Number of grains\n\n![scatter and error against the number of grains](sizes.png)"


def _same_on_both(table: pandas.DataFrame) -> str:
    same = table[table["factor"] == "engine"]
    both = same.pivot_table(index="observable", columns="level", values="mean", sort=False)
    if not {"yade", "fused"} <= set(both):
        return ""
    rows = [
        [OBSERVABLES[name][0], f"{yade:.4g}", f"{fused:.4g}", percent(fused / yade - 1.0)]
        for name, yade, fused in zip(both.index, both["yade"], both["fused"], strict=True)
    ]
    return (
        "## YADE and fused\n\nThe same specimens on both engines with YADE's contact law, on one thread; means over "
        f"{same['replicates'].max()} specimens. The results of `fused` are bitwise identical for any number of "
        "threads; on YADE the number of threads changes the order of summation.\n\n"
        + markdown.table(["", "YADE", "fused", "difference"], rows)
    )


def _failed(data: xr.Dataset) -> str:
    errors: dict[str, str] = {}
    for case, statuses in zip(data["case"].values, data["status"].values.astype(str), strict=True):
        for status in filter(None, statuses):
            errors.setdefault(str(case), status)
    if not errors:
        return ""
    rows = [[case, status] for case, status in errors.items()]
    return "## Tests that ended with an error\n\n" + markdown.table(["case", "error"], rows)
