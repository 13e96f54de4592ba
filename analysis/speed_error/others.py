"""The sections of the page on the measurements made in addition to the tests."""

from __future__ import annotations

import pandas

from analysis import markdown


def engines(table: pandas.DataFrame) -> str:
    """Section on engines and threads."""
    rows = [
        [
            f"{r.grains:.0f}",
            r.engine,
            f"{r.steps_per_second:.4g}",
            f"{r.grain_steps_per_second:.3g}",
            f"{r.over_stock:.3g} ({r.over_stock_least:.3g} to {r.over_stock_most:.3g})",
        ]
        for r in table.itertuples()
    ]
    text = (
        "## Engines and threads\n\nMeasured in turn on the same scene, medians of three rounds. All engines compute in "
        "double precision.\n\n"
    )
    return text + markdown.table(["grains", "engine", "steps/s", "grain-steps/s", "relative to stock (range)"], rows)


def lammps(table: pandas.DataFrame) -> str:
    """Section on LAMMPS; empty if LAMMPS was not installed."""
    if table.empty:
        return ""
    mean = table.groupby("program", sort=False).mean(numeric_only=True)
    spread = table.groupby("program", sort=False).std(numeric_only=True)
    names = {
        "ratio_1": "q/p at 1 %",
        "ratio_peak": "q/p at the peak",
        "ratio_critical": "q/p, critical",
        "pressure_critical": "p, critical, Pa",
    }
    rows = [
        [label] + [f"{mean.loc[p, name]:.4g} ± {spread.loc[p, name]:.2g}" for p in mean.index]
        for name, label in names.items()
    ]
    rows.append(["steps/s of the test"] + [f"{mean.loc[p, 'steps'] / mean.loc[p, 'seconds']:.4g}" for p in mean.index])
    return (
        "## LAMMPS\n\nCV tests of the same specimens at 40 1/s, with the paper's contact law on the `fused` engine and "
        f"with its closest equivalent in LAMMPS; means over {table['seed'].nunique()} specimens and their scatter. The "
        "initial tangential forces are not passed to LAMMPS (`analysis/speed_error/lammps.py` lists the other "
        "differences).\n\n" + markdown.table(["", *mean.index], rows)
    )


def skin(table: pandas.DataFrame) -> str:
    """Section on the Verlet skin."""
    rows = [
        [
            f"{r.grains:.0f}",
            f"{r.rate:g}",
            str(r.skin),
            f"{r.microseconds_per_step:.4g}",
            f"{r.over_auto:.3g}",
            f"{r.position_difference:.1e}",
        ]
        for r in table.itertuples()
    ]
    header = ["grains", "rate, 1/s", "skin, D", "us/step", "relative to auto", "difference of positions, D"]
    return (
        "## Verlet skin of the `fused` engine\n\nThe skin does not change the physics: positions after 2,000 steps "
        "differ by rounding errors that grow. `auto` is the engine's default. YADE's Verlet distance was not "
        "varied.\n\n" + markdown.table(header, rows)
    )


def collisions(table: pandas.DataFrame) -> str:
    """Section on collisions of two grains."""
    rows = [
        [r.quantity, r.law, f"{r.fraction:g}", f"{r.measured:.6g}", f"{r.exact:.6g}", f"{r.error:.1e}"]
        for r in table.itertuples()
    ]
    text = (
        "**measured**: mean over the phases within a time step at which a contact may begin; **error**: "
        "root-mean-square error over these phases."
    )
    return f"## Collisions of two grains\n\n{text}\n\n" + markdown.table(
        ["quantity", "law", "time step / sqrt(m/kn)", "measured", "exact", "error"], rows
    )


def family(table: pandas.DataFrame) -> str:
    """Section on the family of stress-force-fabric relationships."""
    rows = [
        [r.form, f"{100 * r.mean_error:.2f} %", f"{100 * r.worst_error:.2f} %", f"{r.cost_over_c0:.2f}"]
        for r in table.itertuples()
    ]
    return (
        "## The stress-force-fabric family: terms against error\n\nErrors relative to Love's stress, in one test with "
        "the standard settings.\n\n"
        + markdown.table(["form", "mean error", "worst error", "cost relative to C0"], rows)
        + "\n\n![family](sff_family.png)"
    )


def model(table: pandas.DataFrame) -> str:
    """Section on the integrators of the model."""
    path = table.iloc[0]
    return f"""## The model's integrators: steps against error

[model_speed.txt](model_speed.txt) compares all integrators at several step sizes and tolerances, and gives the speed of
the finite-element interface. With the default tolerance, a CV path to {100 * path["strain"]:g} % with
{path["records"]:.0f} records takes {path["milliseconds"]:.3g} ms, with a stress error of {path["stress_error"]:.1e}.

![integrators](model_speed.png)"""
