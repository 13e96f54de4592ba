"""The sections of the page about what was measured beside the tests."""

from __future__ import annotations

import pandas

from analysis import markdown


def engines(table: pandas.DataFrame) -> str:
    """Engines and threads."""
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
        "## Engines and threads\n\nIn turn on one scene, medians of three rounds. All engines compute in double "
        "precision; single is not offered.\n\n"
    )
    return text + markdown.table(["grains", "engine", "steps/s", "grain-steps/s", "over stock (range)"], rows)


def lammps(found: pandas.DataFrame) -> str:
    """LAMMPS; empty if it was not there."""
    if found.empty:
        return ""
    mean = found.groupby("program", sort=False).mean(numeric_only=True)
    spread = found.groupby("program", sort=False).std(numeric_only=True)
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
        "## LAMMPS\n\nThe same specimens along CV at 40 1/s, law paper on the engine fused, and what is nearest to it "
        f"in LAMMPS; means over {found['seed'].nunique()} specimens and their scatter. LAMMPS is not told the "
        "tangential forces at the start (analysis/speed_error/lammps.py says what else differs).\n\n"
        + markdown.table(["", *mean.index], rows)
    )


def skin(table: pandas.DataFrame) -> str:
    """The Verlet skin."""
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
    header = ["grains", "rate, 1/s", "skin, D", "us/step", "over auto", "difference of positions, D"]
    return (
        "## Verlet skin of the engine fused\n\nNo skin changes the physics: positions after 2,000 steps differ by "
        "rounding that grows. `auto` is what the engine does. YADE's own Verlet distance is not varied.\n\n"
        + markdown.table(header, rows)
    )


def collisions(table: pandas.DataFrame) -> str:
    """Two grains."""
    rows = [
        [r.quantity, r.law, f"{r.fraction:g}", f"{r.measured:.6g}", f"{r.exact:.6g}", f"{r.error:.1e}"]
        for r in table.itertuples()
    ]
    words = "measured: mean over the phases in which a contact begins within a step; error: their root mean square."
    return f"## Two grains against closed forms\n\n{words}\n\n" + markdown.table(
        ["quantity", "law", "time step over sqrt(m/kn)", "measured", "exact", "error"], rows
    )


def family(table: pandas.DataFrame) -> str:
    """The family of stress-force-fabric relationships."""
    rows = [
        [r.form, f"{100 * r.mean_error:.2f} %", f"{100 * r.worst_error:.2f} %", f"{r.cost_over_c0:.2f}"]
        for r in table.itertuples()
    ]
    return (
        "## The stress-force-fabric family: terms against error\n\nIn one test with the standard settings, against "
        "Love.\n\n"
        + markdown.table(["form", "mean error", "worst error", "cost over C0"], rows)
        + "\n\n![family](sff_family.png)"
    )


def model(lines: pandas.DataFrame) -> str:
    """The integrators of the model."""
    told = "\n".join(line for line in lines["line"].dropna() if line.startswith("one CV path"))
    return f"""## The model's integrators: steps against error

All integrators at all steps and tolerances, and the speed of the finite-element interface, are in
[model_speed.txt](model_speed.txt). With the defaults, {told}.

![integrators](model_speed.png)"""
