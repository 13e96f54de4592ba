"""`./lab rotation`: runs the campaign, or uses the stored curves, and writes results/rotation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas

import labkit as lk
from analysis.critical_state.ends import TENSORS
from analysis.curves import accumulated_strain
from analysis.statistics import cluster_mean, judge_plan, paired_difference
from analysis.study import Figures, Study, Tables
from labkit.figures import WIDTH, new_figure
from labkit.io import write_with_provenance
from labkit.micro import deviator, equivalent_stress

TESTS = ("straight", "turned")
BIN = 0.01  # interval of strain over which records are averaged
TURNING, AFTER = (0.15, 0.5), (0.7, 0.8)  # strain since the critical state; the windows of the plan
REFERENCE = TURNING  # window of `straight`
MARGINS = {"e": 0.003, "Z": 0.04, "Lambda": 1e-4}
RELATIVE = 0.01  # margin of the other quantities, as a fraction of their value
SECOND = ("q/p", "Z", "Lambda", "A", "F", "Ft")


class Rotation(Study):
    """Rotation of the principal stresses at the critical state."""

    data = "curves.csv"

    def gather(self, runs: Sequence[Path], file: Path, command: str) -> None:
        parts = []
        for one in runs:
            test, *_, seed = one.name.removesuffix(".run.nc").split("-")
            if test in TESTS:
                parts.append(curves(one).assign(test=test, specimen=seed))
        table = pandas.concat(parts)[["test", "specimen", *parts[0].columns[:-2]]]
        write_with_provenance(file, table.to_csv(index=False, float_format="%.6g"), runs, command)

    def tables(self, data: pandas.DataFrame) -> Tables:
        return {"differences": differences(data), "directions": directions(data), "checks": checks(data)}

    def figures(self, data: pandas.DataFrame, tables: Tables) -> Figures:
        figure = new_figure(WIDTH, 5.0)
        panels = {"e": "void ratio e", "q/p": "q/p", "Z": "coordination number Z", "lag": "lag of A (degrees)"}
        for axes, (name, label) in zip(figure.subplots(2, 2, sharex=True).flat, panels.items(), strict=True):
            for test, colour in zip(TESTS, ("0.6", "C0"), strict=True):
                for number, (_, curve) in enumerate(data[data["test"] == test].groupby("specimen")):
                    axes.plot(curve["strain"], curve[name], color=colour, lw=0.8, label=None if number else test)
            axes.axvspan(0.0, TURNING[1], color="0.93", zorder=0)
            axes.set(
                ylabel=label, xlabel=r"strain along $\sigma_1$ since the critical state" if name in ("Z", "lag") else ""
            )
        figure.axes[0].legend()
        return {"curves": figure}


STUDY = Rotation()


def curves(file: Path) -> pandas.DataFrame:
    """Means over BIN of one test, a row per bin, by strain along sigma_1 since the critical state.

    Columns: strain, e, q/p, Z, Lambda, A, F, Ft (norms), lag (degrees by which A is behind the stress), to_critical
    and to_F (cosines of dA with A^c - A and with F - A), inertial_number.
    """
    with lk.open_run(file) as run:
        run.load()
        strain = accumulated_strain(run)
        tensors = {name: run[key].values.astype(float) for name, key in TENSORS.items()}
        stress, of_strain = run["stress"].values.astype(float), run["strain"].values.astype(float)
        table = pandas.DataFrame(
            {
                "strain": strain,
                "e": run["void_ratio"].values,
                "q/p": equivalent_stress(stress) / lk.mean_stress(stress),
                "Z": run["coordination_number"].values,
                "Lambda": run["mean_normalised_force"].values,
                **{name: np.linalg.norm(values, axis=(1, 2)) for name, values in tensors.items()},
                "lag": (angle(stress) - angle(tensors["A"]) + 90.0) % 180.0 - 90.0,
                "inertial_number": run["inertial_number"].values,
            }
        )
    bins = np.floor(strain / BIN + 1e-6).astype(int)
    means = table.groupby(bins).mean()
    A, F = (_binned(tensors[name], bins) for name in ("A", "F"))
    along = deviator(np.gradient(_binned(of_strain, bins), axis=0))
    size = np.linalg.norm(A, axis=(1, 2)).max()
    critical = size * along / np.linalg.norm(along, axis=(1, 2))[:, None, None]
    change = np.gradient(A, axis=0)
    return means.assign(to_critical=cosine(change, critical - A), to_F=cosine(change, F - A))


def _binned(tensors: np.ndarray, bins: np.ndarray) -> np.ndarray:
    return np.stack([tensors[bins == number].mean(axis=0) for number in np.unique(bins)])


def angle(tensors: np.ndarray) -> np.ndarray:
    """Angle from z of the major axis in the plane xz, degrees, (n,); tensors (n, 3, 3)."""
    return 0.5 * np.degrees(np.arctan2(2.0 * tensors[:, 0, 2], tensors[:, 2, 2] - tensors[:, 0, 0]))


def cosine(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Cosine between tensors (n, 3, 3), (n,)."""
    sizes = np.linalg.norm(first, axis=(1, 2)) * np.linalg.norm(second, axis=(1, 2))
    return np.einsum("nij,nij->n", first, second) / sizes


def means(data: pandas.DataFrame, test: str, window: tuple[float, float]) -> pandas.DataFrame:
    """Means of one test over a window of strain, a row per specimen."""
    inside = data[(data["test"] == test) & data["strain"].between(*window)]
    return inside.drop(columns="test").groupby("specimen", as_index=False).mean()


def differences(data: pandas.DataFrame) -> pandas.DataFrame:
    """`turned` minus `straight`, comparisons 1, 2 and 4 of the plan.

    Columns: comparison, quantity, straight (mean), difference, within (95 %), specimens, p_value, judged (the
    margin), corrected (comparison 2: Holm), resolved, equivalent (the whole interval is within the margin).
    """
    reference = means(data, "straight", REFERENCE).assign(test="straight")
    rows = []
    for comparison, quantity, window in [(1, "e", TURNING), *((2, name, TURNING) for name in SECOND), (4, "e", AFTER)]:
        both = pandas.concat([reference, means(data, "turned", window).assign(test="turned")])
        found = paired_difference(both, quantity, "test", *TESTS)
        straight = float(reference[quantity].mean())
        judged = MARGINS.get(quantity, RELATIVE * straight)
        row = {"comparison": comparison, "quantity": quantity, "straight": straight}
        rows.append(row | found.columns("difference") | {"judged": judged})
    return judge_plan(rows)


def directions(data: pandas.DataFrame) -> pandas.DataFrame:
    """Comparisons 3 and 5 while turning: lag of A, and where A goes; columns quantity, mean, within, specimens."""
    turning = means(data, "turned", TURNING)
    rows = [{"quantity": name} | cluster_mean(turning[name]).columns("mean") for name in ("lag", "to_critical", "to_F")]
    return pandas.DataFrame(rows).drop(columns="p_value")


def checks(data: pandas.DataFrame) -> pandas.DataFrame:
    """Point 6: the largest inertial number of each test, and the drift of e in `straight`: name, value, within."""
    early, late = (means(data, "straight", window).set_index("specimen")["e"] for window in ((0.15, 0.3), (0.35, 0.5)))
    drift = cluster_mean((late - early).to_numpy())
    rows = [{"name": "drift of e", "value": drift.value, "within": drift.within}]
    for test in TESTS:
        rows.append({"name": f"I of {test}", "value": data.loc[data["test"] == test, "inertial_number"].max()})
    return pandas.DataFrame(rows)
