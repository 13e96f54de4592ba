"""The section of the page on the presets."""

from __future__ import annotations

import pandas
import xarray as xr

import labkit as lk
from analysis import markdown
from analysis.speed_error.cells import with_interval
from analysis.speed_error.design import PRESET, PRESSURE, VOID_RATIO
from analysis.speed_error.observables import OBSERVABLES

NAMES = {"quick": "quick look", "standard": "standard", "reference": "reference", "the paper's": "the paper's"}
TITLES = {"cp": "## Recommended settings", "cv": "## The same settings in CV tests"}


def section(data: xr.Dataset, table: pandas.DataFrame, measured: pandas.DataFrame, path: str) -> str:
    """The section for a path, in Markdown; empty if it has no tests with presets."""
    if not levels_of(table, path):
        return ""
    text, header, rows = settings(data, table, measured, path)
    return f"{TITLES[path]}\n\n{text}\n\n" + markdown.table(header, rows)


def levels_of(table: pandas.DataFrame, path: str) -> list[str]:
    """The presets tested along a path, in the order of NAMES."""
    some = table[(table["path"] == path) & (table["factor"] == PRESET)]
    return [level for level in NAMES if (some["level"] == level).any()]


def settings(
    data: xr.Dataset, table: pandas.DataFrame, measured: pandas.DataFrame, path: str
) -> tuple[str, list[str], list[list[str]]]:
    """Introduction, header and rows of a table of the presets: their values, costs and errors.

    `data` is from collect(), `table` from errors(), and `measured` from measures.settings.
    """
    some = table[(table["path"] == path) & (table["factor"] == PRESET)]
    levels = levels_of(table, path)
    cases = {level: some.loc[some["level"] == level, "case"].iloc[0] for level in levels}
    measured = measured.set_index("case")

    def of(level: str, name: str) -> pandas.Series:
        return some[(some["level"] == level) & (some["observable"] == name)].iloc[0]

    def cell(level: str, name: str) -> str:
        row = of(level, name)
        if level == "reference":
            return f"{row['mean']:.4g}, scatter {100 * row['scatter']:.2g} %"
        return f"{with_interval(row['error'], row['error_within'])}; one test {100 * row['one_run']:.2g} %"

    grains = {level: float(of(level, "ratio_1")["number_of_grains"]) for level in levels}
    rows = [["grains"] + [f"{grains[level]:.0f}" for level in levels]]
    rates = [float(data["rate"].sel(case=case)) for case in cases.values()]
    strain = float(data["strain"].sel(case=cases["standard"]))
    steps = data["steps"].mean("replicate")
    laws = ["spring_dashpot" if level == "the paper's" else "rolling_resistance" for level in levels]
    factors = [
        strain / (rate * float(steps.sel(case=case)) * lk.Scene(law=law).time_unit)
        for rate, case, law in zip(rates, cases.values(), laws, strict=True)
    ]
    rows.append(["contact law", *laws])
    rows.append(["axial rate, 1/s"] + [f"{rate:g}" for rate in rates])
    rows.append(["`--time-step-factor`"] + [f"{factor:.3g}" for factor in factors])
    rows.append(
        ["**time relative to standard**"] + [f"**{measured.loc[c, 'over_standard']:.3g}**" for c in cases.values()]
    )
    rows.append(["minutes, one core, `fused`"] + [f"{measured.loc[c, 'minutes']:.2g}" for c in cases.values()])
    rows.append(["10^9 grain-steps"] + [f"{float(steps.sel(case=cases[x])) * grains[x] / 1e9:.3g}" for x in levels])
    inertial = data["check"].sel(check_name="inertial_number").mean("replicate")
    rows.append(["inertial number"] + [f"{float(inertial.sel(case=c)):.2g}" for c in cases.values()])
    rows.append(["specimens (seeds)"] + [f"{of(level, 'ratio_1')['replicates']}" for level in levels])
    held = "pressure_critical" if path == "cp" else "void_ratio_critical"
    for name, (label, unit, _) in OBSERVABLES.items():
        if name != held:
            rows.append([f"{label}{f', {unit}' if unit else ''}"] + [cell(level, name) for level in levels])
    introduction = {
        "cp": "`labkit specimen --settings ...` and `labkit run --settings ...`; `standard` is the default. "
        f"CP tests at {PRESSURE / 1e6:g} MPa from e = {VOID_RATIO:g} to {100 * strain:g} % axial strain:",
        "cv": "At constant volume, where the pressure is not controlled. The rates and time steps are those of the "
        "settings, but all tests use the same smaller number of grains, so the scatter is that of specimens of this "
        "smaller size.",
    }
    return introduction[path], ["", *(NAMES[level] for level in levels)], rows
