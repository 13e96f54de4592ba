"""From the grains of the sand to finite elements, with the uncertainty: `python -m analysis.sand.chain`.

Runs are kept in the folder given with --runs, and the command continues where it stopped. If results/sand/chain.jsonl
exists, it only writes the tables and the figure. Plan: analysis/plans/karlsruhe_sand.md.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import warnings
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas

import labkit as lk
from analysis.pictures import save
from analysis.sand.karlsruhe import RESULTS, SAMPLES, USED, grain_tests, half_width
from examples.boundary_value import problem
from examples.boundary_value.scikit_fem import ScikitFem
from labkit import Posterior
from labkit.micro import void_ratio_nominal
from labkit.model import Model, drive, isotropic_state, states
from labkit.plugins.laboratory_data import posterior_of, read_samples
from labkit.plugins.umat import Library, build, copy_sources

MIXED = lk.Fused(precision="mixed")
SHARES = (0.0, 0.1, 0.3, 1.0)  # shares of the friction during compression, from dense to loose
GRAINS, PRESSURE, DENSITY, DENSE = 300, 100e3, 0.63, 0.1  # of a specimen; DENSE: share of the friction
SPECIMENS = [(0, 1), (1, 1), (0, 2), (2, 1), (0, 3), (3, 1), (4, 1), (0, 4)]  # draw, number of the specimen
STRAIN, INCREMENTS, COLUMNS, FINER = 0.04, 40, 4, 8
SHEAR, VOLUME, KEPT = lk.paths.ConstantRadialStress, lk.paths.ConstantVolume, "plane_strain"
PATHS = {  # name: path, from the dense specimen
    "cr": (SHEAR(pressure=PRESSURE, strain=0.2, rate=20), False),
    "cr_dense": (SHEAR(pressure=PRESSURE, strain=0.2, rate=20), True),
    "isoc": (lk.paths.IsotropicCompression(pressure="400 kPa"), False),
    "isoc_dense": (lk.paths.IsotropicCompression(pressure="400 kPa"), True),
    "cv": (VOLUME(strain=0.2, rate=20), False),
    KEPT: (lk.paths.PlaneStrain(pressure=PRESSURE, strain=STRAIN, rate=20), False),
}
TABLE, FEATURES = RESULTS / "chain.jsonl", {"largest": "largest", "at 1 %": "at an axial strain of 1 %"}


def simulate(posterior: Posterior, folder: Path) -> None:
    """Make the specimens and load them, each into its own folder."""
    draws, tests = posterior.some(1 + max(draw for draw, _ in SPECIMENS)), grain_tests(USED)
    for draw, number in SPECIMENS:
        place = folder / f"{draw}-{number}"
        if (place / f"{KEPT}.run.nc").exists():
            continue
        place.mkdir(parents=True, exist_ok=True)
        scene, seed = tests.grains(draws[draw]), 3000 + 10 * draw + number

        def made(share: float, scene: lk.Scene = scene, seed: int = seed) -> lk.State:
            first, second = share * scene.friction, share * scene.rolling_friction
            recipe = lk.Recipe(
                0.7,
                grains=GRAINS,
                seed=seed,
                preparation="compression",
                pressure="100 kPa",
                step1_friction=first,
                step1_rolling_friction=second,
                cell="fixed",
            )
            return lk.make_specimen(recipe, scene, progress=False, engine=MIXED)

        e = [void_ratio_nominal(made(share).snapshot()) for share in SHARES]
        share = np.interp(e[-1] - DENSITY * (e[-1] - e[0]), np.maximum.accumulate(e), SHARES)
        specimens = {False: made(float(share)), True: made(DENSE)}
        for name, (path, dense) in PATHS.items():
            file = place / f"{name}.run.nc"
            if not (file.exists() and lk.open_run(file).attrs["complete"]):
                lk.run(specimens[dense], path, file=file, progress=False, engine=MIXED, snapshots=2)
        print(f"draw {draw}, specimen {number}: e = {e[0]:.3f} to {e[-1]:.3f}", flush=True)


def solve(model: Model, void_ratio: float, Z: float, library: Path, columns: int) -> problem.History:
    """Solve the biaxial test of examples/boundary_value with this model, whose stresses are those of PRESSURE."""
    model = Model(model.parameters, model.readings, model.young_modulus * problem.PRESSURE / PRESSURE)
    solved = ScikitFem(columns, Library(library, model).update, model)
    e = (problem.void_ratio(*solved.points) - problem.VOID_RATIO + void_ratio).ravel()
    solved.state = np.vstack([states(isotropic_state(model, float(one), problem.PRESSURE, Z=Z), 1) for one in e])
    return solved.run(STRAIN, INCREMENTS, lambda done, text: None)


def calibrated(folder: Path, draw: int, number: int, parameters: dict[str, float], library: Path) -> dict[str, object]:
    """Fit the model to the runs of a specimen, and use it; returns a line of chain.jsonl."""
    runs = {name: lk.open_run(folder / f"{draw}-{number}/{name}.run.nc") for name in PATHS}
    kept = runs.pop(KEPT)
    fit = lk.calibrate(runs)
    e, Z = (float(kept[name][0]) for name in ("void_ratio_nominal", "coordination_number"))
    point = drive(fit.model, PATHS[KEPT][0], isotropic_state(fit.model, e, PRESSURE, Z=Z))
    found: dict[str, object] = {"draw": draw, "specimen": number, **parameters, "void ratio": e, "Z": Z}
    found["misfit of q/p"] = float(fit.misfit["q/p"].mean())
    strain, axial = kept["axial_strain"].values, kept["stress"].values[:, 2, 2]
    found["grains"] = {"strain": strain.tolist(), "ratio": (axial / PRESSURE).tolist()}
    found["model"] = {"strain": point.axial_strain.tolist(), "ratio": (point.stress[:, 2, 2] / PRESSURE).tolist()}
    for name, columns in {"elements": COLUMNS, "finer": FINER if (draw, number) == SPECIMENS[0] else 0}.items():
        if columns:
            history = solve(fit.model, e, Z, library, columns)
            ratios = (np.array(history.stress) / problem.PRESSURE).tolist()
            found[name] = {"strain": history.strain, "ratio": ratios}
    return found | {"fitted": json.loads(fit.model.to_json())}


def summary(rows: list[dict]) -> pandas.DataFrame:
    """Tabulate each specimen."""
    table = []
    for row in rows:
        one = {name: row[name] for name in ("draw", "specimen", "void ratio", "misfit of q/p")}
        for name in ("grains", "model", "elements"):
            strain, ratio = (np.array(row[name][key]) for key in ("strain", "ratio"))
            one |= {f"{name}, largest": ratio.max(), f"{name}, strain": strain[ratio.argmax()]}
            one |= {f"{name}, at 1 %": float(np.interp(0.01, strain, ratio)), f"{name}, end": strain[-1]}
        table.append(one)
    return pandas.DataFrame(table)


def parts(table: pandas.DataFrame) -> pandas.DataFrame:
    """Tabulate the standard deviation from each source, relative to the mean, and the 90 % interval.

    The variance between draws contains that between specimens, so that the interval has the degrees of freedom of both.
    """
    reached = table[(table["elements, end"] > 0.999 * STRAIN) & (table["model, end"] > 0.999 * STRAIN)]
    sand = pandas.read_csv(RESULTS / "predictions.csv").query("feature == 'largest q/p'")
    to_sand = (sand["measured"] / sand["predicted"]).std(ddof=1)
    rows = []
    for feature, label in FEATURES.items():
        value, first = reached[f"elements, {feature}"], reached["specimen"] == 1
        mean = value[first].mean()
        repeated = value[reached["draw"] == 0]
        between, specimens = value[first].var(ddof=1) / mean**2, repeated.var(ddof=1) / mean**2
        draws = max(between - specimens, 0.0)
        model = reached[f"grains, {feature}"] / reached[f"model, {feature}"]
        sources = {"posterior": np.sqrt(draws), "specimens": np.sqrt(specimens), "model": model.std(ddof=1)}
        grains = (between, first.sum() - 1) if draws else (specimens, repeated.size - 1)
        others = [(sources["model"] ** 2, model.size - 1), (to_sand**2, sand.shape[0] - 1)]
        half = mean * half_width([(grains[0] * (1.0 + 1.0 / first.sum()), grains[1]), *others])
        row = {"axial over lateral stress": label, "mean": mean, "low": mean - half, "high": mean + half, **sources}
        rows.append(
            row | {"grains to sand": to_sand, "grains over model": model.mean(), "specimens used": len(reached)}
        )
    return pandas.DataFrame(rows)


def draw(rows: list[dict], found: pandas.DataFrame, file: Path) -> None:
    """Draw the plane-strain tests on grains and in the model, the finite elements, and the interval's parts."""
    figure, panels = plt.subplots(1, 3, figsize=(12, 3.8), layout="constrained", width_ratios=(1, 1, 0.8))
    lines = {}
    for row in rows:
        for axes, name, style in ((panels[0], "grains", "-"), (panels[0], "model", "--"), (panels[1], "elements", "-")):
            colour = f"C{row['draw']}"
            (lines[name],) = axes.plot(100 * np.array(row[name]["strain"]), row[name]["ratio"], style, c=colour, lw=1)
    panels[0].legend([lines["grains"], lines["model"]], ["grains", "model"], fontsize=8, loc="lower right")
    panels[0].set_title("one point: plane strain, not fitted", fontsize=10)
    panels[1].set_title("finite elements: biaxial test", fontsize=10)
    largest = found.iloc[0]
    panels[1].errorbar(
        100 * STRAIN * 1.06,
        largest["mean"],
        [[largest["mean"] - largest["low"]], [largest["high"] - largest["mean"]]],
        fmt="ko",
        ms=4,
        capsize=3,
        label="largest, 90 %",
    )
    panels[1].legend(fontsize=8, loc="lower right")
    for axes in panels[:2]:
        axes.set(xlabel="axial strain (%)", ylabel="axial over lateral stress")
        axes.grid(alpha=0.25)
    names = ["posterior", "specimens", "model", "grains to sand"]
    panels[2].barh(names[::-1], [100 * largest[name] for name in names[::-1]], color="C7")
    panels[2].set_xlabel("standard deviation (% of mean)")
    save(figure, file, command="python -m analysis.sand.chain", dpi=110)


def main() -> None:
    """Simulate, fit, solve, tabulate."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=Path, default=Path("sand_chain"), help="folder of the runs")
    parser.add_argument("--only-runs", action="store_true", help="simulate, and stop")
    options = parser.parse_args()
    warnings.simplefilter("ignore", UserWarning)  # warnings about small specimens
    if options.only_runs or not TABLE.exists():
        posterior = posterior_of(grain_tests(USED), read_samples(grain_tests(USED), RESULTS / "samples.jsonl"))
        assert len(posterior.samples) == SAMPLES
        simulate(posterior, options.runs)
        if options.only_runs:
            return
        draws = posterior.some(1 + max(draw for draw, _ in SPECIMENS))
        with tempfile.TemporaryDirectory() as scratch:
            copy_sources(Path(scratch))
            library = build(Path(scratch))
            made = [one for one in SPECIMENS if (options.runs / "{}-{}".format(*one) / f"{KEPT}.run.nc").exists()]
            rows = [calibrated(options.runs, one, number, draws[one], library) for one, number in made]
        TABLE.write_text("".join(json.dumps(row) + "\n" for row in rows))
    rows = [json.loads(line) for line in TABLE.read_text().splitlines()]
    table = summary(rows)
    found = parts(table)
    table.to_csv(RESULTS / "chain.csv", index=False, float_format="%.4g")
    found.to_csv(RESULTS / "chain_parts.csv", index=False, float_format="%.4g")
    draw(rows, found, RESULTS / "chain.png")
    print(table.to_string(float_format="%.3g"), found.to_string(float_format="%.3g"), sep="\n")


if __name__ == "__main__":
    main()
