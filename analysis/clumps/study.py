"""`./lab clumps`: runs the campaign, or uses the stored snapshots, and writes results/clumps."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas
from matplotlib.figure import Figure
from scipy import stats

import labkit as lk
from analysis import markdown
from analysis.statistics import SIGNIFICANT, Tested, cluster_mean
from analysis.study import Figures, Study, Tables, Values
from labkit.figures import WIDTH, new_figure
from labkit.io import write_with_provenance
from labkit.micro import (
    along_deviator,
    axis_anisotropy,
    branch_anisotropy,
    contact_arms,
    contacts_per_pair,
    equivalent_stress,
    normal_force_eccentricity,
    void_ratio_nominal,
)
from labkit.sff import c0_stress, error_budget, stress

SHAPES, TESTS = ("rods12", "rods15", "rods20", "tetrapods", "mixture"), ("compression", "extension", "shear")
FORMS = ("printed", "l.n", "M", "M - X", "G")
UNPLANNED = ("c0_volume", "fourth")  # of labkit.sff.FORMS, with M - X: no equal stress of sizes; also fourth order
COMPONENTS = {"q": 0.02, "p": 0.01}  # component -> margin
STRAINS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)  # of axial strain; twice as much in simple shear
OF_YADE = (0.05, 0.15)  # strains over which the engines are compared
JUDGED = (0.05, 0.3)
SHEARED = {"compression": 1.0, "extension": 1.0, "shear": 0.5}  # factor from the strain of a test to STRAINS
STEPS = (("printed", "l.n"), ("l.n", "M"), ("M", "M - X"), ("M", "G"))
MATTERS = 0.01  # mean absolute change of the error of q
FEWEST = 4  # smallest number of specimens for which anything is called below the margin
LEVEL = 1.0 - SIGNIFICANT / (len(SHAPES) * len(TESTS))  # of the judged intervals, so that all hold at once
FABRIC = ("A", "branches", "axes", "G")


class Clumps(Study):
    """The error of five forms of C0 for clumps, and their fabric."""

    data = "snapshots.csv"

    def gather(self, runs: Sequence[Path], file: Path, command: str) -> None:
        table = pandas.concat([snapshots(one) for one in runs])
        write_with_provenance(file, table.to_csv(index=False, float_format="%.6g"), runs, command)

    def tables(self, data: pandas.DataFrame) -> Tables:
        fused = data[data["engine"] == "fused"]
        return {
            "by_strain": errors_by_strain(fused),
            "judged": judged(fused),
            "steps": steps(fused),
            "budget": budget(fused),
            "fabric": fabric(fused),
            "engines": engines(data),
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
        judged, of_forms = tables["judged"], tables["by_strain"]
        of_form = judged[judged["form"] == "M - X"]
        above = of_form[(of_form["component"] == "q") & (of_form["outcome"] == "above the margin")]
        stress = tables["budget"]["equal_stress q"]
        x_of_p = by_form(judged, "p")["M - X"] - by_form(judged, "p")["M"]
        percents = tables["engines"][["fused", "yade", "difference", "within"]] * 100.0
        return {
            "forms_q": by_form(judged, "q"),
            "forms_p": by_form(judged, "p"),
            "outcomes": outcomes(of_form),
            "unplanned": pandas.concat(outcomes(judged[judged["form"] == form]) for form in UNPLANNED),
            "exceeding": " and ".join(above["shape"] + " in " + above["test"]),
            "largest_printed": by_form(judged, "q")["printed"].abs().max(),
            "largest_here": by_form(judged, "q")["M - X"].abs().max(),
            "largest_printed_p": by_form(judged, "p")["printed"].abs().max(),
            "largest_here_p": by_form(judged, "p")["M - X"].abs().max(),
            "by_strain_q": across_strains(of_forms, "q"),
            "by_strain_p": across_strains(of_forms, "p"),
            "sizes": sizes(tables["steps"]),
            "x_of_p": (x_of_p.min(), x_of_p.max()),
            "stress_q": (stress.abs().min(), stress.abs().max()),
            "within": int((tables["budget"]["truncation q"].abs() < 100.0 * COMPONENTS["q"]).sum()),
            "yade": tables["engines"].assign(**percents),
        }


STUDY = Clumps()


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
    """Size of each step from one form to the next (%), over all combinations."""
    percents = steps.assign(size=100.0 * steps["change"].abs())
    groups = percents.groupby(["from", "to"], sort=False)
    table = groups["size"].agg(mean_size="mean", least="min", most="max").join(groups["matters"].first())
    return table.assign(matters=table["matters"].map({True: "yes", False: "no"})).reset_index()


def draw_fabric(data: pandas.DataFrame) -> Figure:
    """The anisotropies against q/p in compression, means over the specimens, a panel per anisotropy."""
    figure = new_figure(WIDTH, 2.4)
    for axes, name in zip(figure.subplots(1, len(FABRIC)), FABRIC, strict=True):
        for number, shape in enumerate(SHAPES):
            part = data[(data["test"] == "compression") & (data["shape"] == shape)]
            mean = part.groupby("strain")[["q/p", name]].mean()
            axes.plot(mean["q/p"], mean[name], ".-", ms=3, lw=0.8, color=f"C{number}", label=shape)
        axes.set(xlabel="q/p", title=name)
    figure.axes[0].set_ylabel("component along the deviator")
    figure.axes[0].legend(fontsize=6)
    return figure


def snapshots(file: Path) -> pandas.DataFrame:
    """A row for each snapshot of a run: test, shape, seed, strain and the numbers of `of_snapshot`."""
    test, shape, seed, *engine = file.name.removesuffix(".run.nc").split("-")
    with lk.open_run(file) as run:
        strain = np.abs(run.lab.strain().values[run["record"].values]) * SHEARED[test]
        shares = run.lab.strength_shares().isel(time=run["record"].values)
        rows = [of_snapshot(run.lab.snapshot(k)) for k in range(run.lab.number_of_snapshots)]
        balance = float(np.abs(run["energy_balance_error"]).max())
        inertial = float(run["inertial_number"].max())
    table = pandas.DataFrame(rows).assign(strain=np.round(strain, 2), energy_balance=balance, inertial_number=inertial)
    table = table.assign(**{f"share {name}": shares.sel(term=name).values for name in shares["term"].values})
    labels = {"test": test, "shape": shape, "seed": int(seed.removeprefix("s")), "engine": (engine or ["fused"])[0]}
    table, first = table.assign(**labels), [*labels, "strain"]
    return table[first + [name for name in table if name not in first]]


def forms_of(snapshot: lk.Snapshot) -> dict[str, np.ndarray]:
    """The stress by each of FORMS and UNPLANNED, (3, 3), Pa."""
    found = lk.statistics(snapshot)
    G, M = found.contact_eccentricity, found.normal_force_eccentricity
    assert G is not None and M is not None
    closed = normal_force_eccentricity(G, found.contact_anisotropy + found.normal_force_anisotropy)

    def c0(one: lk.micro.Statistics, eccentricity: np.ndarray | None) -> np.ndarray:
        tensors = one.contact_anisotropy, one.normal_force_anisotropy, one.mobilisation
        scalars = one.coordination_number, one.mean_normalised_force, void_ratio_nominal(snapshot)
        return c0_stress(snapshot.young_modulus, *scalars, *tensors, eccentricity)

    return {
        "printed": c0(statistics_with_lengths(snapshot), None),
        "l.n": c0(found, None),
        "M": c0(found, M),
        "M - X": lk.sff_stress(snapshot, found),
        "G": c0(found, closed),
        **{form: stress(form, snapshot) for form in UNPLANNED},
    }


def statistics_with_lengths(snapshot: lk.Snapshot) -> lk.micro.Statistics:
    """The statistics of C0 as printed, with |l| in Lambda: of contact vectors of this length along the normals."""
    contacts = snapshot.contacts
    length = np.linalg.norm(np.asarray(contacts.vectors), axis=2, keepdims=True)
    vectors = length * np.stack([contacts.normal, -contacts.normal], axis=1)
    return lk.statistics(dataclasses.replace(snapshot, contacts=dataclasses.replace(contacts, vectors=vectors)))


def of_snapshot(snapshot: lk.Snapshot) -> dict[str, float]:
    """Stress, errors of the forms, contributions of the error budget relative to q and p, and fabric of a snapshot.

    The q of a tensor is its component along the deviator of Love's stress.
    """
    love = lk.love_stress(snapshot)
    p, q = float(lk.mean_stress(love)), float(equivalent_stress(love))
    found, arms = lk.statistics(snapshot), contact_arms(snapshot)
    errors = {form: stress - love for form, stress in forms_of(snapshot).items()}
    parts = errors | {f"budget {name}": part for name, part in error_budget(snapshot).items()}
    tensors = {
        "A": found.contact_anisotropy,
        "branches": branch_anisotropy(snapshot),
        "axes": axis_anisotropy(snapshot),
        "G": np.asarray(found.contact_eccentricity),
        "F": found.normal_force_anisotropy,
        "Ft": found.mobilisation,
    }
    return {
        "p": p,
        "q/p": q / p,
        "e": float(lk.micro.void_ratio(snapshot)),
        "Z": found.coordination_number,
        **{name: float(along_deviator(tensor, love)) for name, tensor in tensors.items()},
        **{f"{name} q": float(along_deviator(part, love)) / q for name, part in parts.items()},
        **{f"{name} p": float(lk.mean_stress(part)) / p for name, part in parts.items()},
        "contacts per pair": contacts_per_pair(snapshot),
        "negative l.n": float((arms < 0.0).mean()),
    }


def errors_by_strain(data: pandas.DataFrame) -> pandas.DataFrame:
    """Errors (%) of every form by shape, test and strain, with intervals over the specimens."""
    rows = []
    for (shape, test), part in data.groupby(["shape", "test"]):
        for strain in STRAINS:
            at = part[np.isclose(part["strain"], strain)]
            for form in FORMS + UNPLANNED:
                row = {"shape": shape, "test": test, "strain": strain, "form": form, "specimens": len(at)}
                for component in COMPONENTS:
                    mean = cluster_mean(100.0 * at[f"{form} {component}"])
                    row |= {component: mean.value, f"{component}_within": mean.within}
                rows.append(row)
    return pandas.DataFrame(rows)


def over_judged(data: pandas.DataFrame, strains: tuple[float, float] = JUDGED) -> pandas.DataFrame:
    """Means over a range of strains, a row per shape, test and seed."""
    inside = data[data["strain"].between(*strains)]
    return inside.groupby(["shape", "test", "seed"]).mean(numeric_only=True).reset_index()


def judged(data: pandas.DataFrame) -> pandas.DataFrame:
    """Sentence 1: mean errors over the judged strains with 95 % and corrected intervals, and the outcome."""
    rows = []
    for (shape, test), part in over_judged(data).groupby(["shape", "test"]):
        for form in FORMS + UNPLANNED:
            for component, margin in COMPONENTS.items():
                mean = cluster_mean(part[f"{form} {component}"])
                wide = widened(mean)
                row = {"shape": shape, "test": test, "form": form, "component": component}
                row |= mean.columns("error") | {"corrected": wide, "outcome": outcome(mean, wide, margin)}
                rows.append(row)
    return pandas.DataFrame(rows)


def widened(mean: Tested) -> float:
    """Half-width of the interval of a mean at LEVEL instead of 95 %."""
    freedom = mean.n - 1
    if freedom < 1:
        return float("nan")
    half, own = (stats.t.ppf(0.5 * (1.0 + level), freedom) for level in (LEVEL, 0.95))
    return float(mean.within * half / own)


def outcome(mean: Tested, within: float, margin: float) -> str:
    """The sentence of the plan."""
    if abs(mean.value) + within <= margin and mean.n >= FEWEST:
        return "below the margin"
    return "above the margin" if abs(mean.value) - within > margin else "not resolved"


def steps(data: pandas.DataFrame) -> pandas.DataFrame:
    """Sentence 2: paired changes of the error of q from one form to the next, and whether they matter."""
    rows = []
    for first, second in STEPS:
        for (shape, test), part in over_judged(data).groupby(["shape", "test"]):
            change = cluster_mean(part[f"{second} q"] - part[f"{first} q"])
            rows.append({"from": first, "to": second, "shape": shape, "test": test} | change.columns("change"))
    table = pandas.DataFrame(rows)
    mean = table["change"].abs().groupby([table["from"], table["to"]]).transform("mean")
    return table.assign(mean_size=mean, matters=mean > MATTERS)


def budget(data: pandas.DataFrame) -> pandas.DataFrame:
    """Sentence 3: contributions of the error budget to the errors of q and p (%), by shape and test."""
    columns = [name for name in data if name.startswith("budget ")]
    means = over_judged(data).groupby(["shape", "test"])[columns].mean() * 100.0
    table = means.rename(columns=lambda name: name.removeprefix("budget "))
    for (
        component
    ) in COMPONENTS:  # without the assumption of equal stress: what statistics weighted by volume would leave
        cut = [f"{part} {component}" for part in ("normals", "normal_forces", "tangential_forces", "sampling")]
        table[f"truncation {component}"] = table[cut].sum(axis=1)
    return table.reset_index()


def engines(data: pandas.DataFrame) -> pandas.DataFrame:
    """Sentence 5: errors of M - X on YADE minus those on fused, paired by specimen, over OF_YADE."""
    yade = data[data["engine"] == "yade"]
    both = data.merge(yade[["test", "shape", "seed"]].drop_duplicates())
    rows = []
    for component in COMPONENTS:
        column = f"M - X {component}"
        mean = {name: over_judged(part, OF_YADE)[column] for name, part in both.groupby("engine")}
        change = cluster_mean(mean["yade"].to_numpy() - mean["fused"].to_numpy())
        same = abs(change.value) + change.within <= MATTERS
        row = {"component": component, **{name: values.mean() for name, values in mean.items()}}
        rows.append(row | change.columns("difference") | {"outcome": "the same" if same else "not resolved"})
    return pandas.DataFrame(rows)


def fabric(data: pandas.DataFrame) -> pandas.DataFrame:
    """Sentence 4: correlation of each anisotropy with q/p, the anisotropies at the end, and the shares of strength."""
    rows = []
    for (shape, test), part in data[data["strain"] >= STRAINS[0]].groupby(["shape", "test"]):
        mean = part.groupby("strain").mean(numeric_only=True)
        shares = [name for name in mean if name.startswith("share ")]
        last = over_judged(part)[[*FABRIC, "q/p", *shares]].mean()
        correlation = {f"r {name}": float(mean["q/p"].corr(mean[name])) for name in FABRIC}
        rows.append({"shape": shape, "test": test} | correlation | last.to_dict())
    return pandas.DataFrame(rows)


def checks(data: pandas.DataFrame) -> pandas.DataFrame:
    """Largest inertial number and error of the energy balance, contacts per pair, share of negative l.n."""
    groups = data.groupby(["shape", "test"])
    most = groups[["inertial_number", "energy_balance", "negative l.n", "contacts per pair"]].max()
    return most.join(groups["seed"].nunique().rename("specimens")).reset_index()
