"""The questions of the plan, each a table of the snapshots of all runs."""

from __future__ import annotations

import numpy as np
import pandas
from scipy import stats
from scipy.optimize import curve_fit

from analysis.clumps.forms import FORMS, UNPLANNED
from analysis.statistics import SIGNIFICANT, Tested, cluster_mean

SHAPES, TESTS = ("rods12", "rods15", "rods20", "tetrapods", "mixture"), ("compression", "extension", "shear")
COMPONENTS = {"q": 0.02, "p": 0.01}  # component -> margin
STRAINS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)  # of axial strain; twice as much in simple shear
OF_YADE = (0.05, 0.15)  # strains over which the engines are compared
JUDGED = (0.05, 0.3)
STEPS = (("printed", "l.n"), ("l.n", "M"), ("M", "M - X"), ("M", "G"))
MATTERS = 0.01  # mean absolute change of the error of q
FEWEST = 4  # smallest number of specimens for which anything is called below the margin
LEVEL = 1.0 - SIGNIFICANT / (len(SHAPES) * len(TESTS))  # of the judged intervals, so that all hold at once
QUASI_STATIC = 3e-4  # largest inertial number of quasi-static tests
FABRIC = ("A", "branches", "axes", "G")
BOUNDS = (0.1, -1.0), (100.0, 1.0)  # of the rate c and the end of G; tests that do not end have no best fit
TRAINING = ("compression", (1, 2, 3))  # test and specimens from which the rate law of G is fitted
LENGTH = {"compression": 1.5**0.5, "extension": 1.5**0.5, "shear": 2.0**0.5}  # deviatoric strain over the strain


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


PAIRS = (("M - X", "c0_volume"), ("c0_volume", "fourth"), ("fourth, l.n", "fourth"))


def pairs(data: pandas.DataFrame) -> pandas.DataFrame:
    """Change of the mean size of the error of q between forms, paired by shape and seed; over all and by shape.

    Not planned. The three tests of a specimen are averaged first: a shape and a seed count once.
    """
    means, rows = over_judged(data), []
    for first, second in PAIRS:
        change = 100.0 * (means[f"{second} q"].abs() - means[f"{first} q"].abs())
        of_specimen = change.groupby([means["shape"], means["seed"]]).mean()
        for shape in ("all", *SHAPES):
            values = of_specimen if shape == "all" else of_specimen[shape]
            row = {"from": first, "to": second, "shape": shape}
            rows.append(row | cluster_mean(values).columns("change"))
    return pandas.DataFrame(rows)


def power(judged: pandas.DataFrame, form: str = "M - X", draws: int = 20000) -> dict[str, float]:
    """Scatter of the error of q between specimens, the corrected half-width, and the power for a form without error."""
    part = judged[(judged["form"] == form) & (judged["component"] == "q")]
    n = int(part["specimens"].median())
    scatter = part["within"] / stats.t.ppf(0.975, n - 1) * np.sqrt(n)
    half = stats.t.ppf(0.5 * (1.0 + LEVEL), n - 1) / np.sqrt(n)
    drawn = np.random.default_rng(1).normal(0.0, scatter.mean(), (draws, n))
    below = np.abs(drawn.mean(axis=1)) + half * drawn.std(axis=1, ddof=1) <= COMPONENTS["q"]
    names = {"scatter": scatter.mean(), "least": scatter.min(), "most": scatter.max(), "half": half * scatter.mean()}
    return {name: 100.0 * float(value) for name, value in names.items()} | {"power": float(below.mean())}


def budget(data: pandas.DataFrame) -> pandas.DataFrame:
    """Sentence 3: contributions of the error budget to the errors of q and p (%), by shape and test."""
    columns = [name for name in data if name.startswith("budget ")]
    means = over_judged(data).groupby(["shape", "test"])[columns].mean() * 100.0
    table = means.rename(columns=lambda name: name.removeprefix("budget "))
    table["truncation q"] = table[["normals q", "normal_forces q", "tangential_forces q"]].sum(axis=1)
    names = ["truncation", "sampling", "equal_stress"]
    sizes = table[[f"{name} q" for name in names]].abs().set_axis(names, axis=1)
    return table.assign(largest=sizes.idxmax(axis=1).str.replace("_", " ")).reset_index()


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
    data = data.assign(axes=data["axes"].where(data["shape"] != "tetrapods"))  # whose moments of inertia are equal
    for (shape, test), part in data[data["strain"] >= STRAINS[0]].groupby(["shape", "test"]):
        mean = part.groupby("strain").mean(numeric_only=True)
        shares = [name for name in mean if name.startswith("share ")]
        last = over_judged(part)[[*FABRIC, "q/p", *shares]].mean()
        correlation = {f"r {name}": float(mean["q/p"].corr(mean[name])) for name in FABRIC}
        rows.append({"shape": shape, "test": test} | correlation | last.to_dict())
    return pandas.DataFrame(rows)


def rate_law(data: pandas.DataFrame) -> pandas.DataFrame:
    """The rate law of G, fitted to TRAINING, and its root mean square error of g and of q (%) in each test."""
    start = data.groupby(["shape", "test", "seed"])["G"].transform("first")
    trained = (data["test"] == TRAINING[0]) & data["seed"].isin(TRAINING[1])
    data = data.assign(length=data["strain"] * data["test"].map(LENGTH), start=start, trained=trained)
    rows = []
    for shape, part in data.groupby("shape"):
        train, later = part[part["trained"]], part[~part["trained"] & (part["strain"] >= STRAINS[0])]
        (c, end), _ = curve_fit(
            eccentricity, (train["length"], train["start"]), train["G"], p0=(5.0, train["G"].mean()), bounds=BOUNDS
        )
        for test, held_out in later.groupby("test"):
            row = {"shape": shape, "test": test, "c": c, "end": end, "specimens": held_out["seed"].nunique()}
            predicted = {
                "law": eccentricity((held_out["length"], held_out["start"]), c, end),
                "constant": train["G"].mean(),
            }
            for name, g in predicted.items():
                error = ((held_out["G"] - g) ** 2).groupby(held_out["seed"]).mean() ** 0.5
                of_q = ((0.6 * (held_out["G"] - g) / held_out["q/p"]) ** 2).groupby(held_out["seed"]).mean() ** 0.5
                row |= {name: error.mean(), f"{name}_q": 100.0 * of_q.mean()}
            holds, worth = row["law_q"] < 100.0 * MATTERS, row["law"] < 0.5 * row["constant"]
            rows.append(row | {"holds": holds, "worth": worth})
    return pandas.DataFrame(rows)


def eccentricity(strain: tuple[pandas.Series, pandas.Series], c: float, end: float) -> pandas.Series:
    """The component of G by the rate law, of deviatoric strain and start."""
    length, start = strain
    return end + (start - end) * np.exp(-c * length)


def checks(data: pandas.DataFrame) -> pandas.DataFrame:
    """Largest inertial number, tests above QUASI_STATIC, energy balance, contacts per pair, negative l.n."""
    groups = data.groupby(["shape", "test"])
    most = groups[["inertial_number", "energy_balance", "negative l.n", "contacts per pair"]].max()
    above = data[data["inertial_number"] > QUASI_STATIC].groupby(["shape", "test"])["seed"].nunique().rename("above")
    judged = over_judged(data).groupby(["shape", "test"])["contacts per pair"].mean().rename("mean per pair")
    table = most.join([groups["seed"].nunique().rename("specimens"), above, judged])
    return table.fillna({"above": 0}).astype({"above": int}).reset_index()
