"""Tables, figure and page of analysis.sand.with_fabric: `python -m analysis.sand.with_fabric_table [FOLDER]`.

FOLDER is that of the samples, which are copied to results/sand; without it the stored copies are used.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas

from analysis.pages import render
from analysis.pictures import save
from analysis.sand import karlsruhe, undrained
from analysis.sand.karlsruhe import OTHERS, RESULTS, grain_tests
from analysis.sand.score import means, scored
from analysis.sand.with_fabric import DRAINED, FREE, LEFT, TRAINED, fabric_tests, lines_of
from labkit.plugins.laboratory_data import Sample, posterior_of, read_samples

FILES = {name: RESULTS / f"with_fabric_{name}.jsonl" for name in ("samples", "draws", "sands")}
TRAININGS = {
    "drained and compression": (DRAINED, TRAINED),
    "drained": (DRAINED,),
    "compression": (TRAINED,),
    "drained, compression and extension": (DRAINED, TRAINED, LEFT),
}
CYCLES = "cycles to r_u = 0.95"
LOW, HIGH = np.array([*FREE.values()]).T


def predictions(draws: Sequence[dict], unexplained: float) -> pandas.DataFrame:
    """Tabulate the features of all tests with their 90 % intervals beside the measured ones; the kind is in `tests`."""
    drained = {name: karlsruhe.features(karlsruhe.curves(run)) for name, run in grain_tests(OTHERS).measured.items()}
    rows = []
    for kind, known in {"drained": drained, "undrained": json.loads(undrained.MEASURED.read_text())}.items():
        for name, values in known.items():
            found = [draw["tests"][name]["features"] for draw in draws if "features" in draw["tests"].get(name, {})]
            for feature, value in values.items():
                scatter = (
                    karlsruhe.SCATTERS[feature] if kind == "drained" else undrained.scatter_of(feature, value)
                ) * unexplained
                row = karlsruhe.prediction(value, np.array([one[feature] for one in found]), scatter)
                rows.append({"tests": kind, "test": name, "feature": feature, "draws": len(found)} | row)
    return pandas.DataFrame(rows)


def scores(table: pandas.DataFrame) -> pandas.DataFrame:
    """Number inside and interval score of each kind of tests: this study, the first one, a constant."""
    before = {"drained": "predictions.csv", "undrained": "undrained.csv"}
    first = {kind: pandas.read_csv(RESULTS / file) for kind, file in before.items()}
    now = {kind: own for kind, own in table.groupby("tests")}
    untrained = {"undrained, not trained on": now["undrained"][now["undrained"]["test"] != TRAINED]}
    untrained_before = {"undrained, not trained on": first["undrained"][first["undrained"]["test"] != TRAINED]}
    both = []
    for tables in (first | untrained_before, now | untrained):
        both.append(means([row for kind, own in tables.items() for row in scored(own, kind)]).set_index("tests"))
    renamed = both[0][["inside", "score"]].rename(columns={"inside": "inside before", "score": "score before"})
    return both[1].join(renamed).reset_index()


def posteriors(samples: Sequence[Sample]) -> pandas.DataFrame:
    """Quantiles of the parameters after each training."""
    made = []
    for name, trained in TRAININGS.items():
        table = posterior_of(fabric_tests(trained), samples).table().rename_axis("parameter").reset_index()
        made.append(table.assign(training=name))
    return pandas.concat(made)[["training", "parameter", "5 %", "50 %", "95 %"]]


def hidden(samples: Sequence[Sample], sands: Sequence[Sample]) -> pandas.DataFrame:
    """Are the parameters of synthetic sands recovered? A row per parameter."""
    filling, inside, widths, errors = samples[: len(samples) // 2], [], [], []
    for sand in sands:
        if sand.points is None:
            continue
        draws = posterior_of(fabric_tests(given=sand.points), filling).draws[[*FREE]].to_numpy()
        low, middle, high = np.quantile(draws, (0.05, 0.5, 0.95), axis=0)
        truth = np.array([sand.parameters[name] for name in FREE])
        inside.append((low <= truth) & (truth <= high))
        widths.append((high - low) / (HIGH - LOW))
        errors.append(np.abs(middle - truth) / (HIGH - LOW))
    columns = {"inside": np.sum(inside, axis=0), "of": len(inside)}
    columns |= {"mean width": np.mean(widths, axis=0), "mean error": np.mean(errors, axis=0)}
    return pandas.DataFrame({"parameter": [*FREE], **columns})


def draw(table: pandas.DataFrame, file: Path) -> None:
    """Draw the undrained features of each test: measured, and the intervals of both studies."""
    before = pandas.read_csv(RESULTS / "undrained.csv")
    figure, panels = plt.subplots(1, 3, figsize=(11, 4.4), layout="constrained", sharey=True)
    names = [*undrained.MONOTONIC]
    for axes, feature in zip(panels, undrained.SCATTERS, strict=True):
        for own, offset, colour, label in ((before, 0.2, "0.6", "first study"), (table, -0.2, "C0", "this study")):
            rows = own[own["feature"] == feature].set_index("test").loc[names]
            y = np.arange(len(names)) + offset
            axes.hlines(y, rows["low"], rows["high"], color=colour, lw=3, label=label)
        axes.plot(rows["measured"], np.arange(len(names)), "k|", ms=14, mew=2, label="measured")
        axes.set_xlabel(feature)
        axes.grid(alpha=0.25)
    panels[2].set_xscale("symlog", linthresh=100.0)
    panels[0].set_yticks(np.arange(len(names)), [f"{n} *" if n == TRAINED else n for n in names], fontsize=8)
    panels[0].invert_yaxis()
    panels[0].legend(fontsize=8)
    save(figure, file, [*FILES.values()], "python -m analysis.sand.with_fabric_table", dpi=80)


def main() -> None:
    """Write tables, figure and page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", help="folder of the samples (default: the stored copies)")
    folder = parser.parse_args().folder
    if folder is not None:
        for file in FILES.values():
            shutil.copyfile(folder / file.name, file)
    samples, sands = (read_samples(fabric_tests(), FILES[name]) for name in ("samples", "sands"))
    draws = lines_of(FILES["draws"])
    misfit = posterior_of(fabric_tests(), samples).draws["misfit"].median()
    table, trained, recovered = predictions(draws, float(misfit)), posteriors(samples), hidden(samples, sands)
    compared = scores(table)
    for name, one in {"": table, "_score": compared, "_posteriors": trained, "_hidden": recovered}.items():
        one.to_csv(RESULTS / f"with_fabric{name}.csv", index=False, float_format="%.4g")
    draw(table, RESULTS / "with_fabric.png")
    cycles = table[table["feature"] == CYCLES].iloc[0]
    values = {
        "samples": len(samples),
        "failed": sum(sample.points is None for sample in samples),
        "filling": len(samples) // 2,
        "draws": len(draws),
        "sands": int(recovered["of"].iloc[0]),
        "misfit": float(misfit),
        "minutes": sum(sample.seconds for sample in samples) / 60.0,
        "scores": compared,
        "undrained": table[table["tests"] == "undrained"],
        "posteriors": trained,
        "hidden": recovered,
        "cycles": cycles,
    }
    page = render(Path(__file__).with_name("with_fabric_page.md"), values)
    (RESULTS / "with_fabric.md").write_text(page, encoding="utf-8")
    for one in (compared, table, trained, recovered):
        print(one.to_string(float_format="%.3g"))


if __name__ == "__main__":
    main()
