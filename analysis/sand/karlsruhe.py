"""Calibrate grains on TMD2 and TMD22, predict eight other tests, and compare: `python -m analysis.sand.karlsruhe`.

Samples and predictions are stored in results/sand once computed; the command continues where it stopped, and with all
of them stored it only writes the table and the figure.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas
from scipy import stats

import labkit as lk
from analysis.pictures import save

ROOT = Path(__file__).parents[2]
DATA = ROOT / "examples/laboratory/karlsruhe_fine_sand.csv"
RESULTS = ROOT / "results/sand"
USED = {"TMD2": 100, "TMD22": 100}  # kPa
OTHERS = {"TMD1": 50, "TMD5": 400, "TMD8": 200, "TMD12": 100, "TMD13": 200, "TMD20": 400, "TMD21": 50, "TMD25": 400}
FREE = {"friction": (0.1, 1.0), "rolling_friction": (0.02, 1.0), "young_modulus": (0.1e9, 0.5e9)}
SCATTER = {"stress_ratio": 0.03, "volumetric_strain": 0.003}
LIMITS = (0.677, 1.054)  # e_min, e_max
SAMPLES, GRAINS, LARGEST, DRAWS = 28, 300, 400, 4
Draws = list[dict[str, dict[str, list[float]]]]  # for each draw: test -> column -> values
WINDOW = 0.01  # window of strain over which the rate of dilation is taken
SCATTERS = {"largest q/p": 0.03, "q/p at the end": 0.03, "volumetric strain at the end": 0.003}
# a tenth of the scatter of a volumetric strain is assumed to vary within WINDOW
SCATTERS["largest rate of dilation"] = 0.1 * 0.003 * np.sqrt(2.0) / WINDOW
COLUMNS = {
    "axial_strain": ("eps_a[%]", "%", "compression"),
    "volumetric_strain": ("eps_v[%]", "%", "compression"),
    "axial_stress": ("sigma_a[kPa]", "kPa", "compression"),
    "radial_stress": ("sigma_r[kPa]", "kPa", "compression"),
}


def grain_tests(pressures: dict[str, int]) -> lk.GrainTests:
    """The measured tests with these names and pressures, kPa, to repeat on grains."""
    with DATA.open() as lines:
        rows = csv.DictReader(line for line in lines if not line.startswith("#"))
        void_ratios = {row["test"]: float(row["e"]) for row in rows}
    measured = {
        name: lk.read_measured(
            DATA,
            lk.paths.ConstantRadialStress(pressure=f"{pressure} kPa", strain=0.1, rate=20),
            COLUMNS,
            strain_kind="engineering",
            stress_kind="effective",
            void_ratio=void_ratios[name],
            rows={"test": name},
            source="https://doi.org/10.4121/086847a6-ba39-4d66-973b-6b93028c7ad8",
            licence="CC BY 4.0",
            name=name,
        )
        for name, pressure in pressures.items()
    }
    return lk.GrainTests(measured, FREE, SCATTER, limits=LIMITS)


def curves(run: lk.Run) -> dict[str, list[float]]:
    """Axial strain, q/p and volumetric strain of a run."""
    lab = run.data.lab
    columns = run.data["axial_strain"], lab.stress_ratio(), lab.volumetric_strain()
    return dict(zip(("strain", "ratio", "volume"), (one.values.tolist() for one in columns), strict=True))


def predict(
    posterior: lk.Posterior, tests: lk.GrainTests, file: Path, read: Callable[[lk.Run], dict[str, list[float]]] = curves
) -> Draws:
    """Simulate the tests with draws from the posterior; a line of the file for each draw, with what `read` returns."""
    done = file.read_text().splitlines() if file.exists() else []
    for number, parameters in list(enumerate(posterior.some(DRAWS)))[len(done) :]:
        runs = {name: read(run) for name, run in tests.repeat(parameters, GRAINS, 2001 + number).items()}
        with file.open("a") as lines:
            lines.write(json.dumps(runs) + "\n")
        print(f"prediction {number + 1} of {DRAWS}", flush=True)
    return [json.loads(line) for line in file.read_text().splitlines()]


def features(curve: dict[str, list[float]]) -> dict[str, float]:
    """Strength and dilation of a test."""
    strain, ratio, volume = (np.array(curve[name]) for name in ("strain", "ratio", "volume"))
    grid = np.linspace(0.0, strain[-1], 101)
    smooth = np.interp(grid, strain, volume)
    width = max(1, round(WINDOW / (grid[1] - grid[0])))
    return {
        "largest q/p": float(ratio.max()),
        "q/p at the end": float(np.interp(0.99 * strain[-1], strain, ratio)),
        "largest rate of dilation": float(((smooth[:-width] - smooth[width:]) / WINDOW).max()),
        "volumetric strain at the end": float(volume[-1]),
    }


def half_width(parts: Sequence[tuple[float, float]]) -> float:
    """Half of a 90 % interval from independent variances, each with its degrees of freedom (Welch-Satterthwaite)."""
    total = sum(variance for variance, _ in parts)
    freedom = total**2 / sum(variance**2 / known for variance, known in parts)
    return float(stats.t.ppf(0.95, freedom) * np.sqrt(total))


def prediction(measured: float, values: np.ndarray, scatter: float) -> dict[str, object]:
    """A feature with the 90 % interval of a further draw beside the measured value.

    values: those of the draws, (n,); scatter: the unexplained standard deviation, which counts as known.
    """
    draws = float(values.var(ddof=1)) * (1.0 + 1.0 / values.size)
    half = half_width([(draws, values.size - 1), (scatter**2, np.inf)])
    low, high = values.mean() - half, values.mean() + half
    inside = low <= measured <= high
    return {"measured": measured, "predicted": values.mean(), "low": low, "high": high, "inside": inside}


def compare(posterior: lk.Posterior, tests: lk.GrainTests, draws: Draws) -> pandas.DataFrame:
    """Tabulate predicted features with their 90 % intervals next to the measured ones."""
    unexplained = float(posterior.draws["misfit"].median())
    rows = []
    for name, measured in tests.measured.items():
        found = [features(draw[name]) for draw in draws]
        for feature, value in features(curves(measured)).items():
            values = np.array([one[feature] for one in found])
            density = (LIMITS[1] - float(measured.data["void_ratio"][0])) / (LIMITS[1] - LIMITS[0])
            row = {"test": name, "kPa": OTHERS[name], "relative density": density, "feature": feature}
            rows.append(row | prediction(value, values, unexplained * SCATTERS[feature]))
    return pandas.DataFrame(rows)


def draw(tests: lk.GrainTests, draws: Draws, file: Path) -> None:
    """Draw q/p and volumetric strain of every test, measured (points) and predicted (lines)."""
    figure, panels = plt.subplots(4, 4, figsize=(12, 11), layout="constrained", sharex=True)
    for number, (name, measured) in enumerate(tests.measured.items()):
        upper, lower = panels[2 * (number // 4) : 2 * (number // 4) + 2, number % 4]
        for axes, column, factor in ((upper, "ratio", 1.0), (lower, "volume", 100.0)):
            for one in draws:
                (line,) = axes.plot(
                    100 * np.array(one[name]["strain"]), factor * np.array(one[name][column]), "C0", alpha=0.5, lw=1
                )
            points = curves(measured)
            (dots,) = axes.plot(100 * np.array(points["strain"]), factor * np.array(points[column]), "ko", ms=3)
            axes.grid(alpha=0.25)
        upper.set_title(f"{name}: {OTHERS[name]} kPa, e = {float(measured.data['void_ratio'][0]):.3f}", fontsize=10)
    for k in range(4):
        panels[k, 0].set_ylabel("q/p" if k % 2 == 0 else "volumetric strain (%)")
        panels[3, k].set_xlabel("axial strain (%)")
    panels[0, 0].legend([dots, line], ["measured", "grains drawn from the posterior"], fontsize=8, loc="lower right")
    save(figure, file, command="python -m analysis.sand.karlsruhe", dpi=110)


def main() -> None:
    """Calibrate, predict, compare."""
    RESULTS.mkdir(exist_ok=True)
    posterior = lk.calibrate_grains(
        grain_tests(USED),
        SAMPLES,
        file=RESULTS / "samples.jsonl",
        grains=GRAINS,
        largest=LARGEST,
        progress=lambda done, text: print(text),
    )
    posterior.table().to_csv(RESULTS / "posterior.csv", float_format="%.4g")
    tests = grain_tests(OTHERS)
    draws = predict(posterior, tests, RESULTS / "predictions.jsonl")
    table = compare(posterior, tests, draws)
    table.to_csv(RESULTS / "predictions.csv", index=False, float_format="%.4g")
    draw(tests, draws, RESULTS / "predictions.png")
    print(posterior.table().to_string(float_format="%.4g"), table.to_string(float_format="%.3g"), sep="\n")
    print(table.groupby("feature")["inside"].agg(["sum", "count"]), int(table["inside"].sum()), "of", len(table))


if __name__ == "__main__":
    main()
