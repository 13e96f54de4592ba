"""`./lab clumps`: runs the campaign, or uses the stored snapshots, and writes results/clumps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas
from matplotlib.figure import Figure

from analysis import markdown
from analysis.campaigns import write_compressed
from analysis.clumps.forms import UNPLANNED, snapshots
from analysis.clumps.questions import (
    COMPONENTS,
    FABRIC,
    SHAPES,
    STRAINS,
    TESTS,
    budget,
    checks,
    engines,
    errors_by_strain,
    fabric,
    judged,
    pairs,
    power,
    rate_law,
    steps,
)
from analysis.study import Figures, Study, Tables, Values
from labkit.figures import WIDTH, new_figure

OWN = ("normals", "normal_forces", "tangential_forces", "sampling", "equal_stress")  # contributions, each by itself

PAIR_NAMES = {"M - X": "c0_volume", "c0_volume": "fourth over c0_volume", "fourth, l.n": "fourth"}  # by the first form


class Clumps(Study):
    """The error of five forms of C0 for clumps, and their fabric."""

    data = "snapshots.csv.gz"

    def gather(self, runs: Sequence[Path], file: Path, command: str) -> None:
        write_compressed(pandas.concat([snapshots(one) for one in runs]), file, runs, command, "%.4g")

    def tables(self, data: pandas.DataFrame) -> Tables:
        fused = data[data["engine"] == "fused"]
        return {
            "by_strain": errors_by_strain(fused),
            "judged": judged(fused),
            "steps": steps(fused),
            "budget": budget(fused),
            "fabric": fabric(fused),
            "rate_law": rate_law(fused),
            "engines": engines(data),
            "pairs": pairs(fused),
            "checks": checks(fused),
        }

    def figures(self, data: pandas.DataFrame, tables: Mapping[str, pandas.DataFrame]) -> Figures:
        data = data[data["engine"] == "fused"]
        figure = new_figure(WIDTH, 4.5)
        grid = figure.subplots(len(COMPONENTS), len(TESTS), sharex="col", squeeze=False)
        for row, (component, margin) in zip(grid, COMPONENTS.items(), strict=True):
            for axes, test in zip(row, TESTS, strict=True):
                axes.axhspan(-100.0 * margin, 100.0 * margin, color="0.93", zorder=0)
                for number, shape in enumerate(SHAPES):
                    part = data[(data["test"] == test) & (data["shape"] == shape) & (data["strain"] >= STRAINS[0])]
                    for form, style in (("printed", ":"), ("M - X", "-")):
                        mean = 100.0 * part.groupby("strain")[f"{form} {component}"].mean()
                        axes.plot(100.0 * mean.index, mean, style, color=f"C{number}", lw=1.0, label=f"{shape}, {form}")
            row[0].set_ylabel(f"error of {component} (%)")
        for axes, test in zip(grid[-1], TESTS, strict=True):
            axes.set_xlabel("half the shear strain (%)" if test == "shear" else f"axial strain, {test} (%)")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, fontsize=6, ncols=len(SHAPES), loc="outside lower center")
        return {"errors": figure, "fabric": draw_fabric(data)}

    def numbers(self, tables: Mapping[str, pandas.DataFrame]) -> Values:
        data = tables["snapshots"][lambda table: (table["engine"] == "fused") & (table["strain"] >= STRAINS[0])]
        judged, of_forms = tables["judged"], tables["by_strain"]
        of_form = judged[judged["form"] == "M - X"]
        above = of_form[(of_form["component"] == "q") & (of_form["outcome"] == "above the margin")]
        forms, budget = {component: by_form(judged, component) for component in COMPONENTS}, tables["budget"]
        x_of_p = forms["p"]["M - X"] - forms["p"]["M"]
        failing = data["fourth q"].abs()[lambda error: error > 0.1]
        varied = data.groupby(["shape", "test", "strain"])["q/p"].mean().groupby(["shape", "test"])
        range_of_q = 100.0 * (varied.max() / varied.min() - 1.0)
        own = budget.set_index(["shape", "test"])[[f"{name} q" for name in OWN]].abs().idxmax(axis=1)
        percents = tables["engines"][["fused", "yade", "difference", "within"]] * 100.0
        return {
            "failing": len(failing),
            "worst": 100.0 * failing.max(),
            "least": 100.0 * failing.min(),
            "considered": len(data),
            "forms_q": forms["q"],
            "forms_p": forms["p"],
            "mean_size": mean_sizes(forms),
            "closer": (forms["q"]["l.n"].abs() < forms["q"]["M - X"].abs()).sum(),
            "beyond": (forms["q"]["M - X"].abs() > 100.0 * COMPONENTS["q"]).sum(),
            "outcomes": outcomes(of_form),
            "unplanned": pandas.concat(outcomes(judged[judged["form"] == form]) for form in UNPLANNED),
            "exceeding": " and ".join(above["shape"] + " in " + above["test"]),
            "by_strain_q": across_strains(of_forms, "q"),
            "by_strain_p": across_strains(of_forms, "p"),
            "sizes": sizes(tables["steps"]),
            "x_of_p": (x_of_p.min(), x_of_p.max()),
            "largest": budget["largest"].value_counts().to_dict(),
            "own": own.value_counts().to_dict(),
            "power": power(judged),
            "worst_of": {form: 100.0 * data[f"{form} q"].abs().max() for form in ("M - X", *UNPLANNED)},
            "pair": {(PAIR_NAMES[row["from"]], row["shape"]): row for _, row in tables["pairs"].iterrows()},
            "stress_q": (budget["equal_stress q"].abs().min(), budget["equal_stress q"].abs().max()),
            "range_of_q": (range_of_q.min(), range_of_q.max()),
            "rates": tables["rate_law"].replace({True: "yes", False: "no"}),
            "yade": tables["engines"].assign(**percents),
        }


STUDY = Clumps()


def mean_sizes(forms: Mapping[str, pandas.DataFrame]) -> pandas.DataFrame:
    """Mean and largest size of the error over all combinations (%), a row per form."""
    names = [name for name in forms["q"] if f"{name}_within" in forms["q"]]
    rows = []
    for name in names:
        row = {"form": name}
        for component, table in forms.items():
            row |= {component: table[name].abs().mean(), f"largest {component}": table[name].abs().max()}
        rows.append(row)
    order = {"printed": 0, "l.n": 1, "M": 2, "M - X": 3}
    return pandas.DataFrame(rows).sort_values("form", key=lambda form: form.map(order).fillna(4))


def by_form(judged: pandas.DataFrame, component: str) -> pandas.DataFrame:
    """Judged errors (%) of a component, a row per shape and test, with a column and a column `_within` per form."""
    part = judged[judged["component"] == component].set_index(["shape", "test", "form"])[["error", "within"]] * 100.0
    error, within = (part[name].unstack("form") for name in part)
    return error.join(within.add_suffix("_within")).reset_index()


def across_strains(by_strain: pandas.DataFrame, component: str) -> pandas.DataFrame:
    """Errors of M - X with intervals as text, a row per shape and test and a column per strain."""
    part = by_strain[by_strain["form"] == "M - X"]
    cells = [markdown.text(*pair) for pair in zip(part[component], part[f"{component}_within"], strict=True)]
    part = part.assign(cell=cells, strain=[f"{100 * strain:.0f} %" for strain in part["strain"]])
    wide = part.pivot(index=["shape", "test"], columns="strain", values="cell")
    return wide[list(dict.fromkeys(part["strain"]))].reset_index()


def outcomes(judged: pandas.DataFrame) -> pandas.DataFrame:
    """Number of combinations with each outcome, and the largest error, a row per component."""
    rows = []
    for component, margin in COMPONENTS.items():
        part = judged[judged["component"] == component]
        counts = part["outcome"].value_counts()
        worst = part.loc[part["error"].abs().idxmax()]
        row = {
            "form": worst["form"],
            "component": component,
            "margin": 100.0 * margin,
            "below": counts.get("below the margin", 0),
        }
        row |= {"above": counts.get("above the margin", 0), "unresolved": counts.get("not resolved", 0)}
        largest = f"{100 * worst['error']:.1f} ± {100 * worst['corrected']:.1f} % ({worst['shape']}, {worst['test']})"
        rows.append(row | {"largest": largest})
    return pandas.DataFrame(rows)


def sizes(steps: pandas.DataFrame) -> pandas.DataFrame:
    """Change of each step from one form to the next (%), over all combinations."""
    percents = steps.assign(size=100.0 * steps["change"].abs())
    groups = percents.groupby(["from", "to"], sort=False)
    least, most = 100.0 * groups["change"].min(), 100.0 * groups["change"].max()
    table = (
        groups["size"]
        .agg(mean_size="mean")
        .join([least.rename("least"), most.rename("most"), groups["matters"].first()])
    )
    return table.assign(matters=table["matters"].map({True: "yes", False: "no"})).reset_index()


def draw_fabric(data: pandas.DataFrame) -> Figure:
    """The anisotropies against q/p in compression, means over the specimens, a panel per anisotropy."""
    figure = new_figure(WIDTH, 2.4)
    for axes, name in zip(figure.subplots(1, len(FABRIC)), FABRIC, strict=True):
        for number, shape in enumerate(SHAPES):
            if name == "axes" and shape == "tetrapods":
                continue  # their moments of inertia are equal
            part = data[(data["test"] == "compression") & (data["shape"] == shape)]
            mean = part.groupby("strain")[["q/p", name]].mean()
            axes.plot(mean["q/p"], mean[name], ".-", ms=3, lw=0.8, color=f"C{number}", label=shape)
        axes.set(xlabel="q/p", title=name)
    figure.axes[0].set_ylabel("component along the deviator")
    figure.axes[0].legend(fontsize=6)
    return figure
