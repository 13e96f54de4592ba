"""Predict undrained tests with the grains calibrated on two drained ones: `python -m analysis.sand.undrained [FOLDER]`.

FOLDER is a copy of github.com/kokerozas/AdvanceHypoplasticModel2026, commit 7cde2aa, with the tests of Wichtmann and
Triantafyllidis (2016). It has no licence, so results/sand keeps features of the measured curves, and no curves. Without
FOLDER only the table is written again, from these features.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas

import labkit as lk
from analysis.pictures import save
from analysis.sand import karlsruhe
from analysis.sand.karlsruhe import RESULTS, USED, Draws, grain_tests

# name: file, void ratio (those of the folder), sign of the axial strain
FIRST, SECOND = "TMU - triaxial-monotonic-undrained/", "TMU2 - triaxial monotonic undrained/"
MONOTONIC = {
    "200 kPa, e = 0.946": (FIRST + "TMU2.dat", 0.946, 1),
    "200 kPa, e = 0.814": (FIRST + "TMU1.dat", 0.814, 1),
    "200 kPa, e = 0.728": (FIRST + "TMU3.dat", 0.728, 1),
    "100 kPa, e = 0.828": (SECOND + "TMU1.dat", 0.828, 1),
    "300 kPa, e = 0.822": (SECOND + "TMU3.dat", 0.822, 1),
    "400 kPa, e = 0.819": (SECOND + "TMU4.dat", 0.819, 1),
    "200 kPa, e = 0.964, extension": (FIRST + "TMU5.dat", 0.964, -1),
    "200 kPa, e = 0.853, extension": (FIRST + "TMU4.dat", 0.853, -1),
    "100 kPa, e = 0.828, extension": (SECOND + "TMU5.dat", 0.828, -1),
    "300 kPa, e = 0.828, extension": (SECOND + "TMU7.dat", 0.828, -1),
    "400 kPa, e = 0.827, extension": (SECOND + "TMU8.dat", 0.827, -1),
}
CYCLIC = {"100 kPa, e = 0.961, cycles of q = 25 kPa": ("TCU - cyclic triaxial test karlsuhe/TCUI4.dat", 0.961)}
STRAIN, LONGEST = 0.03, 30  # logarithmic strain of the monotonic tests; number of cycles
LEAST_P = 0.05  # of p_0: below, few contacts remain, and q/p is noise
SCATTERS = {"least p/p_0": 0.03, "largest |q/p|": 0.03, "|q| at 3 % (kPa)": 0.05}  # the last as a share of |q|
MEASURED = RESULTS / "undrained_measured.json"


def measured(file: Path, path: lk.paths.Path, void_ratio: float) -> lk.Run:
    """Read one test of the folder."""
    columns = {
        "axial_strain": ("eps1", "%", "compression"),
        "axial_stress": ("sigma1'", "kPa", "compression"),
        "radial_stress": ("sigma3'", "kPa", "compression"),
    }
    source = "https://doi.org/10.1007/s11440-015-0402-z, https://github.com/kokerozas/AdvanceHypoplasticModel2026"
    return lk.read_measured(
        file,
        path,
        columns,
        strain_kind="engineering",
        stress_kind="effective",
        void_ratio=void_ratio,
        source=source,
        licence="none given: not to be passed on",
    )


def undrained_tests(folder: Path) -> dict[str, lk.Run]:
    """Read all tests: name -> measured test."""
    tests = {}
    for name, (file, void_ratio, sign) in MONOTONIC.items():
        tests[name] = measured(folder / file, lk.paths.ConstantVolume(strain=sign * STRAIN, rate=20), void_ratio)
    for name, (file, void_ratio) in CYCLIC.items():
        path = lk.paths.UndrainedCycles(amplitude="25 kPa", cycles=LONGEST, rate=5)
        tests[name] = measured(folder / file, path, void_ratio)
    return tests


def curves(run: lk.Run) -> dict[str, list[float]]:
    """Axial strain, p and q (negative in extension), Pa, and the cycles to r_u = 0.95 of a cyclic run."""
    lab, stress = run.data.lab, run.data["stress"]
    q = stress.sel(i="z", j="z") - 0.5 * (stress.sel(i="x", j="x") + stress.sel(i="y", j="y"))
    found = {"strain": run.data["axial_strain"], "p": lab.mean_stress(), "q": q}
    listed = {name: one.values.tolist() for name, one in found.items()}
    return listed | ({"cycles": [lab.liquefaction().cycles_to_ratio]} if run.data.attrs["path"] != "cv" else {})


def features(curve: dict[str, list[float]]) -> dict[str, float]:
    """Features of a test that are compared."""
    if "cycles" in curve:
        return {"cycles to r_u = 0.95": float(np.nan_to_num(curve["cycles"][0], nan=LONGEST))}
    strain, p, q = (np.array(curve[name]) for name in ("strain", "p", "q"))
    at_end = float(np.interp(0.99 * STRAIN, np.maximum.accumulate(np.abs(strain)), np.abs(q)))
    bears = p > LEAST_P * p[0]
    values = float(p.min() / p[0]), float(np.abs(q[bears] / p[bears]).max()), 1e-3 * at_end
    return dict(zip(SCATTERS, values, strict=True))


def scatter_of(feature: str, value: float) -> float:
    """Return the assumed standard deviation between repeated tests of a feature with this value."""
    return SCATTERS.get(feature, 0.0) * (value if feature.startswith("|q| at") else 1.0)


def compare(known: dict[str, dict[str, float]], draws: Draws, unexplained: float) -> pandas.DataFrame:
    """Tabulate predicted features with their 90 % intervals next to the measured ones, test -> feature -> value."""
    rows = []
    for name, values in known.items():
        for feature, value in values.items():
            found = np.array([features(draw[name])[feature] for draw in draws])
            row = karlsruhe.prediction(value, found, unexplained * scatter_of(feature, value))
            rows.append({"test": name, "feature": feature} | row)
    return pandas.DataFrame(rows)


def draw(tests: dict[str, lk.Run], draws: Draws, file: Path) -> None:
    """Draw the stress paths: measured (black) and predicted."""
    figure, panels = plt.subplots(3, 4, figsize=(12, 8.5), layout="constrained")
    for axes, name in zip(panels.ravel(), MONOTONIC, strict=False):
        for one in draws:
            (line,) = axes.plot(1e-3 * np.array(one[name]["p"]), 1e-3 * np.array(one[name]["q"]), "C0", alpha=0.5, lw=1)
        points = curves(tests[name])
        (dots,) = axes.plot(1e-3 * np.array(points["p"]), 1e-3 * np.array(points["q"]), "k", lw=1.5)
        axes.set_title(name, fontsize=9)
        axes.grid(alpha=0.25)
    panels[-1, -1].axis("off")
    for axes in panels[-1]:
        axes.set_xlabel("p (kPa)")
    for axes in panels[:, 0]:
        axes.set_ylabel("q (kPa)")
    panels[-1, -1].legend([dots, line], ["measured", "grains drawn from the posterior"], loc="center")
    save(figure, file, command="python -m analysis.sand.undrained", dpi=100)


def main() -> None:
    """Measure the features, predict, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", help="copy of the measured tests (default: only the table)")
    folder = parser.parse_args().folder
    stored = RESULTS / "undrained.jsonl"
    if folder is not None:
        tests = undrained_tests(folder)
        MEASURED.write_text(json.dumps({name: features(curves(test)) for name, test in tests.items()}, indent=1) + "\n")
        posterior = lk.calibrate_grains(grain_tests(USED), karlsruhe.SAMPLES, file=RESULTS / "samples.jsonl")
        repeated = lk.GrainTests(tests, karlsruhe.FREE, karlsruhe.SCATTER, limits=karlsruhe.LIMITS)
        draw(tests, karlsruhe.predict(posterior, repeated, stored, curves), RESULTS / "undrained.png")
    draws = [json.loads(line) for line in stored.read_text().splitlines()]
    misfit = float(pandas.read_csv(RESULTS / "posterior.csv", index_col=0).loc["misfit", "50 %"])
    table = compare(json.loads(MEASURED.read_text()), draws, misfit)
    table.to_csv(RESULTS / "undrained.csv", index=False, float_format="%.4g")
    print(table.to_string(float_format="%.3g"), int(table["inside"].sum()), "of", len(table))


if __name__ == "__main__":
    main()
