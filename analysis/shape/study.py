"""`./lab shape`: runs the campaign, or uses the stored snapshots, and writes results/shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas

import labkit as lk
from analysis.places import texts
from analysis.statistics import SIGNIFICANT, adjusted, cluster_mean, difference_of_means, in_bold
from analysis.study import Figures, Study, Tables, Values
from labkit.figures import WIDTH, new_figure
from labkit.io import write_with_provenance
from labkit.micro import along_deviator, rattler_fraction, stress_along_normals
from labkit.sff import BRANCHES, error_budget

GROUPS, TESTS = ("rods", "spheres"), ("compression", "extension")
WINDOW, STRAINS = (0.2, 0.3), (0.02, 0.05, 0.1, 0.2, 0.3)  # axial strain
C0_MARGIN, ASSUMPTION_MARGIN, LIKENESS, LODE_MARGIN, STRENGTH_MARGIN = 0.03, 0.01, 0.1, 0.03, 0.03
FEWEST = 4  # smallest number of specimens for which anything is called equal
PARTS = ("directions", "sizes", "normals", "normal_forces")  # contributions to C0 - Love
LIKE = ("Z", "A", "F", "Ft", "Lambda E/p", "rattlers", "rise of e", "sliding")
SLIDING = 0.999  # share of the friction limit


class Shape(Study):
    """C0 of rods, and rolling resistance in place of shape."""

    data = "snapshots.csv"

    def gather(self, runs: Sequence[Path], file: Path, command: str) -> None:
        table = pandas.concat([snapshots(one) for one in runs])
        write_with_provenance(file, table.to_csv(index=False, float_format="%.6g"), runs, command)

    def tables(self, data: pandas.DataFrame) -> Tables:
        means = window_means(data)
        return {
            "values": means,
            "c0": errors_of_c0(means),
            "c0_by_strain": errors_by_strain(data),
            "differences": differences(means),
            "strengths": strengths(means),
            "checks": checks(data),
        }

    def figures(self, data: pandas.DataFrame, tables: Mapping[str, pandas.DataFrame]) -> Figures:
        figure = new_figure(WIDTH, 5.0)
        for axes, (name, label) in zip(figure.subplots(2, 3).flat, texts(__file__)["panels"].items(), strict=True):
            for (group, test), part in data.groupby(["group", "test"]):
                mean = part.groupby("strain")[name].agg(["mean", "min", "max"])
                colour, style = f"C{GROUPS.index(group)}", "-" if test == "compression" else "--"
                axes.plot(mean.index, mean["mean"], style, color=colour, lw=1.0, label=f"{group}, {test}")
                axes.fill_between(mean.index, mean["min"], mean["max"], color=colour, alpha=0.15, lw=0.0)
            axes.axvspan(*WINDOW, color="0.95", zorder=0)
            axes.set(ylabel=label, xlabel="axial strain")
        figure.axes[0].legend(fontsize=6)
        return {"curves": figure}

    def numbers(self, tables: Mapping[str, pandas.DataFrame]) -> Values:
        rows = in_bold(tables["differences"])
        rows["label"] = rows["quantity"].map(texts(__file__)["quantities"])
        rows["sentence"] = [sentence(row) for row in rows.itertuples()]
        M = tables["strengths"].set_index(["group", "quantity"])
        ratio = M.loc[("spheres", "M"), "value"] / M.loc[("rods", "M"), "value"]
        return {"rows": rows, "ratio": ratio}


STUDY = Shape()


def snapshots(file: Path) -> pandas.DataFrame:
    """A row for each snapshot of a run: test, group, seed, strain and the numbers of `of_snapshot`."""
    test, specimen, *_, seed = file.name.removesuffix(".run.nc").split("-")
    with lk.open_run(file) as run:
        rows = [of_snapshot(run.lab.snapshot(k)) for k in range(run.lab.number_of_snapshots)]
        balance = float(np.abs(run["energy_balance_error"]).max())
        inertial, late = run["inertial_number"].values, np.abs(run["axial_strain"].values) >= WINDOW[0]
        sheared = {"inertial_number": inertial.max(), "inertial_in_window": inertial[late].mean()}
    table = pandas.DataFrame(rows).assign(energy_balance=balance, **sheared)
    table["rise of e"] = table["e"] - table["e"].iloc[0]
    names = {"test": test, "group": specimen.partition("_")[0], "seed": int(seed.removeprefix("s"))}
    return table.assign(**names)[[*names, *table.columns]]


def of_snapshot(snapshot: lk.Snapshot) -> dict[str, float]:
    """Stress, statistics and the contributions to C0 - Love (shares of p) of a snapshot.

    `directions`: assuming contact vectors parallel to the normals; `sizes`: equal stress of all sizes, without
    `directions`. The q of a tensor is its component along the stress deviator.
    """
    love, c0 = lk.love_stress(snapshot), lk.sff_stress(snapshot)
    found, contacts = lk.statistics(snapshot), snapshot.contacts
    p, q = float(lk.mean_stress(love)), float(lk.deviatoric_stress(love))
    budget = error_budget(snapshot)
    parts = {"directions": stress_along_normals(snapshot) - love}
    parts["sizes"] = budget.get(BRANCHES, 0.0) + budget["equal_stress"] - parts["directions"]
    parts |= {name: budget[name] for name in PARTS[2:]}
    limit = SLIDING * snapshot.scene.friction * contacts.normal_force
    tensors = {"A": found.contact_anisotropy, "F": found.normal_force_anisotropy, "Ft": found.mobilisation}
    return {
        "strain": round(abs(snapshot.axial_strain or 0.0), 3),
        "p": p,
        "M": abs(q) / p,
        "e": float(lk.micro.void_ratio(snapshot)),
        "Z": found.coordination_number,
        **{name: float(along_deviator(tensor, love)) for name, tensor in tensors.items()},
        "Lambda E/p": found.mean_normalised_force * snapshot.young_modulus / p,
        "rattlers": rattler_fraction(snapshot),
        "sliding": float((np.linalg.norm(contacts.tangential_force, axis=1) >= limit).mean()),
        "C0 p": float(lk.mean_stress(c0)) / p - 1.0,
        "C0 q": float(lk.deviatoric_stress(c0)) / q - 1.0,
        **{f"{name} p": float(lk.mean_stress(part)) / p for name, part in parts.items()},
        **{f"{name} q": float(along_deviator(part, love)) / p for name, part in parts.items()},
    }


def window_means(data: pandas.DataFrame) -> pandas.DataFrame:
    """Means over the window, a row per test, group and seed; `Lode`: M in extension over M in compression."""
    inside = data[data["strain"].between(WINDOW[0] - 1e-6, WINDOW[1] + 1e-6)]
    means = inside.drop(columns="strain").groupby(["test", "group", "seed"]).mean().reset_index()
    M = means.pivot(index=["group", "seed"], columns="test", values="M")
    ratio = (M["extension"] / M["compression"]).rename("Lode").reset_index()
    return means.merge(ratio, on=["group", "seed"], how="left")


def errors_of_c0(means: pandas.DataFrame) -> pandas.DataFrame:
    """Question 1: errors of C0 in p and q, and their part `directions`; value, within, within the margin or outside.

    In `directions` q is divided by the q of Love, like the error.
    """
    rows = []
    for (test, group), part in means.groupby(["test", "group"]):
        for component in ("p", "q"):
            mean = cluster_mean(part[f"C0 {component}"])
            one = part[f"directions {component}"] / (part["M"] if component == "q" else 1.0)
            row = {"test": test, "group": group, "component": component, "directions": float(one.mean())}
            row |= mean.columns("error") | {"rest": mean.value - float(one.mean())}
            rows.append(row | {"outcome": outcome(mean.value, mean.within, C0_MARGIN, mean.n)})
    return pandas.DataFrame(rows)


def errors_by_strain(data: pandas.DataFrame) -> pandas.DataFrame:
    """Errors of C0 of the rods, q and p (%), and their void ratio e, with intervals, a row per test and strain.

    The strains are STRAINS; `slope` is the slope over the window, per 10 % strain.
    """
    rows = []
    for test, rods in data[data["group"] == "rods"].groupby("test"):
        late = rods[rods["strain"].between(WINDOW[0] - 1e-6, WINDOW[1] + 1e-6)].groupby("seed")
        for strain in (*STRAINS, None):
            row = {"test": test, "strain": "slope" if strain is None else f"{100.0 * strain:g} %"}
            for name, column, scale in (("q", "C0 q", 100.0), ("p", "C0 p", 100.0), ("e", "e", 1.0)):
                if strain is None:
                    values = [0.1 * np.polyfit(one["strain"], one[column], 1)[0] for _, one in late]
                else:
                    values = rods.loc[np.isclose(rods["strain"], strain), column].tolist()
                mean = cluster_mean(scale * np.array(values))
                row |= {name: mean.value, f"{name}_within": mean.within}
            rows.append(row)
    return pandas.DataFrame(rows)


def outcome(value: float, within: float, margin: float, specimens: int) -> str:
    """`inside` or `outside`, if the interval is within the margin or beyond it altogether, or `not resolved`."""
    if abs(value) + within <= margin and specimens >= FEWEST:
        return "inside"
    return "outside" if abs(value) - within > margin else "not resolved"


def differences(means: pandas.DataFrame) -> pandas.DataFrame:
    """Questions 2 to 4, corrected together (Holm): rods, spheres, difference, within, corrected, outcome.

    Question 2: rods minus spheres in compression, shares of p. 3: spheres minus rods over the mean of the rods, in
    compression. 4: rods minus spheres, M in extension over M in compression.
    """
    compression = means[means["test"] == "compression"]
    names = [f"{name} {component}" for name in PARTS for component in ("p", "q")]
    asked = [(2, name, ASSUMPTION_MARGIN) for name in names] + [(3, name, LIKENESS) for name in LIKE]
    rows = []
    for question, name, margin in [*asked, (4, "Lode", LODE_MARGIN)]:
        rods, spheres = (compression.loc[compression["group"] == group, name].dropna() for group in GROUPS)
        found, mean = difference_of_means(rods, spheres), {"rods": rods.mean(), "spheres": spheres.mean()}
        scale = 1.0 / mean["rods"] if question == 3 else -1.0
        difference, within = scale * found.value, abs(scale) * found.within
        row = {"question": question, "quantity": name, **mean}
        row |= {"difference": difference, "within": within, "p_value": found.p_value, "judged": margin}
        rows.append(row | {"outcome": outcome(difference, within, margin, min(len(rods), len(spheres)))})
    table = pandas.DataFrame(rows)
    return table.assign(corrected=adjusted(table["p_value"].to_numpy()))


def sentence(row: Any) -> str:
    """The sentence in the plan for an outcome of `differences`."""
    differs, most = row.corrected <= SIGNIFICANT, abs(row.difference) + row.within
    if row.question == 2:
        if row.outcome == "inside":
            return f"shape adds at most {100.0 * most:.2g} % of p"
        known = differs and abs(row.difference) > row.judged
        return f"shape adds {100.0 * row.difference:.2g} % of p" if known else "not resolved"
    if row.outcome == "outside":
        return "does not reproduce it" if differs else "not resolved"
    if row.outcome == "inside":
        return "reproduces it"
    return f"differs; not resolved at {row.judged:g}" if differs else f"not resolved at {row.judged:g}"


def strengths(means: pandas.DataFrame) -> pandas.DataFrame:
    """M in compression and extension, and their ratio, of both groups with intervals."""
    rows = []
    for group, part in means.groupby("group"):
        by_test = part.set_index("test")
        for quantity, values in (
            ("M", by_test.loc["compression", "M"]),
            ("M in extension", by_test.loc["extension", "M"]),
            ("Lode", by_test.loc["compression", "Lode"]),
        ):
            rows.append({"group": group, "quantity": quantity} | cluster_mean(values).columns("value"))
    return pandas.DataFrame(rows).drop(columns="p_value")


def checks(data: pandas.DataFrame) -> pandas.DataFrame:
    """The largest inertial number and error of the energy balance of a group and test, and the initial void ratio.

    `inertial_in_window` is the mean over the window, the largest of the group.
    """
    groups = data.groupby(["group", "test"])
    worst = groups[["inertial_number", "inertial_in_window", "energy_balance"]].max()
    before = data[data["strain"] == 0.0].groupby(["group", "test"])["e"].mean().rename("e before")
    return worst.join(before).reset_index()
