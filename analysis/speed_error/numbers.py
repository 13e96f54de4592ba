"""Numbers of the page, from the data set of a study and its tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas
import xarray as xr

import labkit as lk
from analysis.places import texts
from analysis.speed_error.design import BASELINE, MIXED, PRESET, RATE
from analysis.speed_error.observables import OBSERVABLES
from labkit.paths import ConstantVolume
from labkit.servo import STANDARD

PRESETS = {"quick": "quick look", "standard": "standard", "reference": "reference", "the paper's": "the paper's"}
HELD = {"cp": "pressure_critical", "cv": "void_ratio_critical"}  # path -> the observable that it holds constant
FASTER = ("inertial number", "precision", "inertial number x precision")
OTHER_FACTORS = (PRESET, BASELINE, MIXED, "grains", "engine")  # factors that are not compared with the baseline
UNSTABLE = 0.05  # error of the energy balance at which a run is stopped
NEEDED = ("ratio_critical", "void_ratio_critical", "Z_critical", "Lambda_critical")  # for constitutive models
RIVALS = {"LAMMPS, 1 process": "LAMMPS", "stock YADE script, 1 thread": "stock YADE script"}
DEFAULTS = {  # factor -> its default, and where it is defined
    "time step": (lk.Scene.time_step_factor, "`--time-step-factor`, Scene.time_step_factor"),
    "rate": (RATE, "`--rate`, `rate` of a path"),
    "servo interval": (STANDARD.interval, "Servo.interval"),
    "servo gain": (STANDARD.gain, "Servo.gain"),
    "record interval": (ConstantVolume.record_strain, "`--record-strain`"),
    "local damping": (lk.Scene.local_damping, "Scene.local_damping"),
}
LEVELS: dict[str, str] = texts(__file__)["levels"]


def page_numbers(data: xr.Dataset, tables: Mapping[str, pandas.DataFrame]) -> dict[str, Any]:
    """Values for the page. `data`: from collect(); `tables`: errors, settings and those of the other measurements."""
    table, timed = tables["errors"], tables["settings"]
    paper = table[(table["factor"] == PRESET) & (table["level"] == "the paper's")]
    different = paper[(paper["error"].abs() > paper["error_within"]) & (paper["observable"] != HELD["cp"])]
    return {
        "cases": data.sizes["case"],
        "tests": int(((data["status"] == "") & (data["seed"] > 0)).sum()),
        "hours": float(data["wall_time"].sum()) / 3600.0,
        "settings": {path: settings(data, table, timed, path) for path in HELD},
        "different": different.assign(text=different["error"].map(percent)),
        "faster": faster(table),
        "needed": minutes(table, timed, tables.get("engines")),
        "defaults": defaults(data, table),
        "changes": {path: rows for path in HELD if not (rows := changes(table, path)).empty},
        "time_steps": time_steps(data),
        "same": same_on_both(data),
        "lammps": of_lammps(tables["lammps"]) if "lammps" in tables else None,
        "failed": failed(data),
    }


def short(value: float, sign: str = "") -> str:
    """Formats a number with two digits and no exponent."""
    return f"{value:{sign}.0f}" if abs(value) >= 99.5 else f"{value:{sign}.2g}"


def percent(value: float) -> str:
    """Formats a fraction as a percentage with its sign; `-` if it is not finite."""
    return "-" if not np.isfinite(value) else f"{short(100 * value, '+')} %"


def with_interval(value: float, within: float) -> str:
    """Formats an error with its 95 % half-width; in brackets if the interval includes zero."""
    if not np.isfinite(within):
        return percent(value)
    text = f"{short(100 * value, '+')} ± {short(100 * within)} %"
    return f"({text})" if abs(value) <= within else text


def level_text(level: str) -> str:
    """Text of a level on the page, as short as possible."""
    try:
        return f"{float(level):g}" if float(level) < 1e6 else f"{float(level) / 1e9:g} GPa"
    except ValueError:
        return LEVELS.get(level, level.replace(", paper", ", the paper's law"))


def settings(data: xr.Dataset, table: pandas.DataFrame, timed: pandas.DataFrame, path: str) -> dict[str, Any] | None:
    """`strain` of the tests with the presets along a path, and `rows`: their values, costs and errors as text.

    `data`: from collect(); `table`: from errors(); `timed`: from measures.settings. None if there are no such tests.
    """
    some = table[(table["path"] == path) & (table["factor"] == PRESET)]
    means, timed = data[["steps", "check"]].mean("replicate"), timed.set_index("case")
    columns = {}
    for level in (level for level in PRESETS if (some["level"] == level).any()):
        of = some[some["level"] == level].set_index("observable")
        case, grains = of["case"].iloc[0], of["number_of_grains"].iloc[0]
        one, rate = means.sel(case=case), float(data["rate"].sel(case=case))
        law = "spring_dashpot" if level == "the paper's" else "rolling_resistance"
        strain, steps = float(data["strain"].sel(case=case)), float(one["steps"])
        columns[PRESETS[level]] = {
            "grains": f"{grains:.0f}",
            "contact law": law,
            "axial rate, 1/s": f"{rate:g}",
            "`--time-step-factor`": f"{strain / (rate * steps * lk.Scene(law=law).time_unit):.3g}",
            "**time relative to standard**": f"**{timed.loc[case, 'over_standard']:.3g}**",
            "minutes, one core, `fused`": f"{timed.loc[case, 'minutes']:.2g}",
            "10^9 grain-steps": f"{steps * grains / 1e9:.3g}",
            "inertial number": f"{float(one['check'].sel(check_name='inertial_number')):.2g}",
            "specimens (seeds)": str(of["replicates"].iloc[0]),
            **{
                label + f", {unit}" * bool(unit): f"{row['mean']:.4g}, scatter {100 * row['scatter']:.2g} %"
                if level == "reference"
                else f"{with_interval(row['error'], row['error_within'])}; one test {100 * row['one_run']:.2g} %"
                for name, (label, unit, _) in OBSERVABLES.items()
                if name != HELD[path]
                for row in [of.loc[name]]
            },
        }
    if not columns:
        return None
    return {"strain": strain, "rows": pandas.DataFrame(columns).rename_axis("quantity").reset_index()}


def faster(table: pandas.DataFrame) -> pandas.DataFrame:
    """Tests at an inertial number and in mixed precision, a row per case: cost and number of clear changes."""
    some = table[table["factor"].isin(FASTER)]
    some = some[some["observable"] != some["path"].map(HELD)]
    some = some.assign(path=some["path"].str.upper(), level=some["level"].map(level_text), clear=clear(some))
    groups = some.groupby(["path", "factor", "level"], sort=False)
    return groups.agg(cost=("cost", "first"), clear=("clear", "sum"), compared=("clear", "size")).reset_index()


def minutes(table: pandas.DataFrame, timed: pandas.DataFrame, engines: pandas.DataFrame | None) -> pandas.DataFrame:
    """Minutes of a CP test and the error of one test, %, in NEEDED; a row per preset and case in mixed precision.

    LAMMPS and the stock script of YADE take the standard settings at their speeds; they have the error of `fused`.
    """
    some = table[(table["path"] == "cp") & table["factor"].isin((PRESET, MIXED)) & table["observable"].isin(NEEDED)]
    errors = 100 * some.pivot_table("one_run", "case", "observable", sort=False)
    rows = errors.join(timed.set_index("case")["minutes"]).join(some.groupby("case")["level"].first())
    rows["level"] = rows["level"].where(~rows.index.str.contains(MIXED), "mixed, " + rows["level"])
    standard = rows[rows["level"] == "standard"]
    others = [
        standard.assign(level=f"standard, {label}", minutes=standard["minutes"] * slowness_of(engines, name))
        for name, label in RIVALS.items()
        if engines is not None and name in set(engines["engine"])
    ]
    return pandas.concat([rows, *others]).sort_values("minutes")


def slowness_of(engines: pandas.DataFrame, name: str) -> float:
    """Time per step of an engine, divided by that of `fused` on one thread, for the largest specimen."""
    speed = engines[engines["grains"] == engines["grains"].max()].set_index("engine")["steps_per_second"]
    return float(speed["fused, 1 thread"] / speed[name])


def clear(table: pandas.DataFrame) -> pandas.Series:
    """True where the interval of a change excludes zero."""
    return table["change"].abs() > table["change_within"]


def of_factors(table: pandas.DataFrame, path: str) -> pandas.DataFrame:
    """The rows of the cases of a path that are compared with the baseline."""
    return table[(table["path"] == path) & ~table["factor"].isin(OTHER_FACTORS)]


def common(table: pandas.DataFrame) -> pandas.Series:
    """Median change of each observable over all cases of a path: the random error of the baseline's tests."""
    return table.groupby("observable")["change"].median()


def changes(table: pandas.DataFrame, path: str) -> pandas.DataFrame:
    """Changes relative to the baseline as text, a row per case and a column per observable; the first row: medians."""
    some = of_factors(table, path)
    names = {name: label for name, (label, *_) in OBSERVABLES.items() if name != HELD[path]}
    typical = {names[name]: f"{100 * value:+.2g}" for name, value in common(some).items() if name in names}
    rows = [{"factor": "median over all cases", "level": "", "cost": ""} | typical]
    for _, lines in some.groupby("case", sort=False):
        first, lines = lines.iloc[0], lines.set_index("observable")
        cost = f"{first['cost']:.2g}" if np.isfinite(first["cost"]) else "-"
        cells = {label: _change(lines.loc[name]) for name, label in names.items()}
        rows.append({"factor": first["factor"], "level": level_text(first["level"]), "cost": cost} | cells)
    return pandas.DataFrame(rows[len(rows) == 1 :], columns=["factor", "level", "cost", *names.values()])


def _change(row: pandas.Series) -> str:
    change, within = 100 * row["change"], 100 * row["change_within"]
    if not np.isfinite(change):
        return "-"
    if not np.isfinite(within):
        return f"{change:+.2g}"
    return f"**{short(change, '+')}** ± {short(within)}" if abs(change) > within else f"± {short(within)}"


def defaults(data: xr.Dataset, table: pandas.DataFrame) -> pandas.DataFrame:
    """Every default compared with the next lower and the next higher level, a row per neighbour."""
    table = of_factors(table, "cp")
    table = table.assign(change=table["change"] - table["observable"].map(common(table)).fillna(0.0))
    rows = []
    for factor, (value, where) in DEFAULTS.items():
        some = table[(table["factor"] == factor) & (table["observable"] != HELD["cp"])]
        some = some.assign(level=some["level"].astype(float))
        levels = np.array(sorted(some["level"].unique()))
        for level in (*levels[levels < value][-1:], *levels[levels > value][:1]):
            lines = some[some["level"] == level]
            changed = lines[clear(lines)]
            largest = changed.loc[changed["change"].abs().idxmax()] if len(changed) else None
            held = data["check"].sel(case=lines["case"].iloc[0], check_name="held_error")
            rows.append(
                {
                    "factor": factor,
                    "default": float(value),
                    "where": where,
                    "level": level,
                    "cost": lines["cost"].iloc[0],
                    "clear": len(changed),
                    "compared": len(lines),
                    "largest": "" if largest is None else f"{largest['label']}, {percent(largest['change'])}",
                    "held": float(held.mean()),
                }
            )
    return pandas.DataFrame(rows)


def time_steps(data: xr.Dataset) -> pandas.DataFrame:
    """The CP tests with other time steps, a row per case: the stability limit, errors, and what the checks would do."""
    rows = []
    for k in np.flatnonzero(data["factor"].str.contains("time step") & (data["path"] == "cp")):
        case = data.isel(case=int(k))
        limits = case["time_step_over_limit"].values[case["seed"].values > 0]
        limits = limits[np.isfinite(limits)]
        energy = float(case["check"].sel(check_name="energy_balance_error").max())
        errors, refused = [s for s in np.unique(case["status"].values.astype(str)) if s], int((limits > 1.0).sum())
        at_start = f"refuses {refused} of {len(limits)} at the start"
        rows.append(
            {
                "factor": case["factor"].item(),
                "level": level_text(case["level"].item()),
                "limit": limits.mean(),
                "least": limits.min(),
                "most": limits.max(),
                "energy": energy,
                "stopped": "" if np.isfinite(energy) else f"stopped: {errors[0][:60]}",
                "held": float(case["check"].sel(check_name="held_error").mean()),
                "effect": at_start if refused else "stops the run" if energy > UNSTABLE else "none",
            }
        )
    return pandas.DataFrame(rows)


def same_on_both(data: xr.Dataset) -> pandas.DataFrame | None:
    """Means of the observables on YADE and on fused, a row per observable; None without tests on both."""
    same = data["value"].isel(case=np.flatnonzero(data["factor"] == "engine"))
    if set(same["level"].values) != {"yade", "fused"}:
        return None
    means = same.mean("replicate").swap_dims(case="level").to_pandas().T
    replicates = int(same.notnull().any("observable").sum("replicate").max())
    text = (means["fused"] / means["yade"] - 1.0).map(percent)
    return means.assign(label=[label for label, *_ in OBSERVABLES.values()], replicates=replicates, text=text)


def of_lammps(tests: pandas.DataFrame) -> pandas.DataFrame:
    """Means over the specimens, a row per program: the observables, their scatter (NAME_scatter), and the speed."""
    groups = tests.groupby("program", sort=False)
    means = groups.mean(numeric_only=True)
    speed = means["steps"] / means["seconds"]
    return means.join(groups.std(numeric_only=True).add_suffix("_scatter")).assign(speed=speed).reset_index()


def failed(data: xr.Dataset) -> pandas.DataFrame:
    """The first error of each case that had one."""
    errors = data["status"].astype(str).to_series().rename("error")
    return errors[errors != ""].groupby("case", sort=False).first().reset_index()
