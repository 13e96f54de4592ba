"""Response envelopes of grains, of labkit's models and of peers at the same states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas
import xarray as xr
from matplotlib.figure import Figure

import labkit as lk
from analysis.curves import each_run
from analysis.model_benchmark.score import Contestant
from analysis.netcdf import write_data
from analysis.statistics import cluster_mean
from labkit.figures import WIDTH, colors_for, new_figure
from labkit.grains import State
from labkit.micro import statistics, symmetric, void_ratio_nominal
from labkit.model import Adaptive, Failure, Problem, strain_control

SEEDS = (4, 5, 6)  # packings; the first is that of the tutorial on probes, with more grains
NUMBER, VOID_RATIO, PRESSURE = 1000, 0.62, 200e3
SHEARED = 0.02  # axial strain at constant mean stress before the second set of probes
DIRECTIONS, AMPLITUDE = 16, 1e-4
STATES = ("isotropic", "sheared")
GRAINS = "grains"


def write_probes(file: Path, command: str) -> None:
    """Probe the grains of all packings in the axisymmetric plane, isotropic and sheared, and write one data set."""
    sets = {f"{state}-s{seed}": one for seed in SEEDS for state, one in zip(STATES, _probed(seed), strict=True)}
    data = xr.concat(list(sets.values()), dim="run").assign_coords(run=list(sets))
    data.attrs = {"title": "Strain probes of grains", "amplitude": AMPLITUDE, "grains": NUMBER}
    write_data(file, data, command)


def _probed(seed: int) -> Iterator[xr.Dataset]:
    recipe = lk.Recipe(void_ratio=VOID_RATIO, grains=NUMBER, seed=seed, cell="fixed")
    state = lk.consolidate(lk.make_specimen(recipe, progress=False), PRESSURE, progress=False)
    yield _probes_at(state, f"s{seed}")
    run = lk.run(state, lk.paths.ConstantMeanStress(pressure=PRESSURE, strain=SHEARED), progress=False)
    yield _probes_at(run.state, f"s{seed}")


def _probes_at(state: State, packing: str) -> xr.Dataset:
    """Probes of a state, and the statistics from which the models start, along `point`."""
    probes = lk.probe(state, directions=DIRECTIONS, amplitude=AMPLITUDE, progress=False)
    start, fabric = state.snapshot(), statistics(state.snapshot())
    tensors = {
        "stress": symmetric(lk.love_stress(start)),
        "A": fabric.contact_anisotropy,
        "F": fabric.normal_force_anisotropy,
        "Ft": fabric.mobilisation,
    }
    scalars = {"Z": fabric.coordination_number, "Lambda": fabric.mean_normalised_force, "e": void_ratio_nominal(start)}
    found = {name: (("probe", "i", "j"), probes.data[f"{name}_increment"].values) for name in ("strain", "stress")}
    return xr.Dataset(
        {name: (("point", "i", "j"), np.asarray(value)[None]) for name, value in tensors.items()}
        | {name: ("point", [float(value)]) for name, value in scalars.items()}
        | {f"{name}_increment": value for name, value in found.items()},
        coords={"packing": packing, "angle": ("probe", probes.data["angle"].values)},
    )


def responses(probes: xr.Dataset, contestants: Sequence[Contestant]) -> pandas.DataFrame:
    """Responses of grains and contestants, a row per state, packing, model and direction.

    Columns: state, packing, model, angle, axial and radial (stress increment, sqrt2 times the mean of the radial ones),
    divided by p and the amplitude; NaN where a law is undefined.
    """
    rows = []
    for name, one in each_run(probes):
        state, stress = name.partition("-")[0], one["stress"].values[0]
        scale = float(lk.mean_stress(stress)) * AMPLITUDE
        increments = {GRAINS: one["stress_increment"].values}
        increments |= {c.name: _predicted(c, one) for c in contestants}
        for model, found in increments.items():
            for angle, change in zip(one["angle"].values, found / scale, strict=True):
                radial = (change[0, 0] + change[1, 1]) / np.sqrt(2.0)
                row = {"state": state, "packing": str(one["packing"].values), "model": model, "angle": float(angle)}
                rows.append(row | {"axial": change[2, 2], "radial": radial})
    return pandas.DataFrame(rows)


def _predicted(contestant: Contestant, one: xr.Dataset) -> np.ndarray:
    law, y = contestant.law, contestant.start(one)
    found = np.full((one.sizes["probe"], 3, 3), np.nan)
    for k, strain in enumerate(one["strain_increment"].values):
        size = float(np.linalg.norm(strain))
        try:
            new = Adaptive().advance(Problem(law, strain_control(strain / size), law.floor(y)), y, size)
        except Failure:
            continue
        found[k] = law.stress(new) - law.stress(y)
    return found


def envelope_errors(table: pandas.DataFrame) -> pandas.DataFrame:
    """Errors of the envelopes, a row per state and model: means over packings, with NAME_within.

    `error`: root mean square of the difference of the responses over that of the grains, %; `size`, `low` and `high`:
    the geometric mean over directions of the ratio of their norms, with its interval; `direction`: the mean angle
    between them, degrees.
    """
    keys = ["state", "packing", "angle"]
    grains = table[table["model"] == GRAINS].set_index(keys)[["axial", "radial"]]
    rows = []
    for (state, model), own in table[table["model"] != GRAINS].groupby(["state", "model"], sort=False):
        found = own.set_index(keys)[["axial", "radial"]].to_numpy()
        wanted = grains.loc[pandas.MultiIndex.from_frame(own[keys])].to_numpy()
        sizes, others = np.linalg.norm(found, axis=1), np.linalg.norm(wanted, axis=1)
        angle = np.degrees(np.arccos(np.clip(np.sum(found * wanted, axis=1) / (sizes * others), -1.0, 1.0)))
        each = pandas.DataFrame({"size": np.log(sizes / others), "direction": angle, "packing": own["packing"].values})
        each = each.assign(off=np.sum((found - wanted) ** 2, axis=1), all=others**2)
        mean = each.groupby("packing").mean()
        row: dict[str, object] = {"state": state, "model": model, "packings": len(mean)}
        mean = mean.assign(error=100.0 * np.sqrt(mean["off"] / mean["all"]))
        for name in ("error", "direction"):
            estimate = cluster_mean(mean[name], mean.index)
            row |= {name: estimate.value, f"{name}_within": estimate.within}
        size = cluster_mean(mean["size"], mean.index)
        bounds = {"size": 0.0, "low": -size.within, "high": size.within}
        row |= {name: float(np.exp(size.value + by)) for name, by in bounds.items()}
        rows.append(row)
    return pandas.DataFrame(rows)


def envelopes_figure(table: pandas.DataFrame) -> Figure:
    """The envelopes of the first packing, a column per state; the lower row enlarges those of the grains."""
    figure = new_figure(WIDTH, 7.4)
    panels = figure.subplots(2, len(STATES))
    first = table[table["packing"] == table["packing"].iloc[0]]
    names = [name for name in dict.fromkeys(first["model"]) if name != GRAINS]
    colors = {GRAINS: "black"} | dict(zip(names, colors_for(len(names)), strict=True))
    for column, state in zip(panels.T, STATES, strict=True):
        for model, color in colors.items():
            own = first[(first["state"] == state) & (first["model"] == model)]
            closed = pandas.concat([own, own.iloc[:1]])
            width = 2.0 if model == GRAINS else 1.0
            for panel in column:
                panel.plot(closed["radial"], closed["axial"], ".-", color=color, lw=width, ms=3, label=model)
        for panel in column:
            panel.set(aspect="equal", xlabel=r"$\sqrt{2}\,\Delta\sigma_r/(p\,|\Delta\varepsilon|)$")
        column[0].set(title=state)
        column[1].set(xlim=(-450, 450), ylim=(-450, 450))
    for panel in panels[:, 0]:
        panel.set(ylabel=r"$\Delta\sigma_z/(p\,|\Delta\varepsilon|)$")
    panels[0, 0].legend(fontsize=6, loc="upper left")
    return figure
