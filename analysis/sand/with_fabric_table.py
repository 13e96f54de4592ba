"""Tables, figure and page of analysis.sand.with_fabric: `python -m analysis.sand.with_fabric_table [--page]`."""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from analysis.pages import render
from analysis.pictures import save
from analysis.sand import cyclic, karlsruhe, undrained
from analysis.sand.karlsruhe import OTHERS, RESULTS, grain_tests
from analysis.sand.score import constant_intervals, interval_score, means, scored
from analysis.sand.with_fabric import (
    DEVIATIONS,
    DRAINED,
    FREE,
    LEFT,
    TRAINED,
    fabric_tests,
    lines_of,
    undrained_of,
)
from labkit.plugins.laboratory_data import Sample, posterior_of, read_samples

FILES = {name: RESULTS / f"with_fabric_{name}.jsonl" for name in ("samples", "draws", "sands")}
FILLING, NOISE_SEED = 22, 5100  # FILLING: number of samples that fill the ranges
TRAININGS = {
    "drained and compression": (DRAINED, TRAINED),
    "drained": (DRAINED,),
    "compression": (TRAINED,),
    "drained, compression and extension": (DRAINED, TRAINED, LEFT),
}
POINTS = [f"{LEFT}: {name}" for name in ("least p/p_0", "largest |q/p|", "ln of |q|/p_0 at 3 %")]
CYCLES = "cycles to r_u = 0.95"
LOW, HIGH = np.array([*FREE.values()]).T


def compared(draws: Sequence[dict]) -> Iterator[tuple[str, str, str, float, np.ndarray, float]]:
    """Yield of each feature: kind, test, name, measured value, those of the draws (n,), and the assumed scatter."""
    drained = {name: karlsruhe.features(karlsruhe.curves(run)) for name, run in grain_tests(OTHERS).measured.items()}
    for kind, measured in {"drained": drained, "undrained": json.loads(undrained.MEASURED.read_text())}.items():
        for name, values in measured.items():
            predicted = [draw["tests"][name]["features"] for draw in draws if "features" in draw["tests"].get(name, {})]
            for feature, value in values.items():
                scatter = karlsruhe.SCATTERS[feature] if kind == "drained" else undrained.scatter_of(feature, value)
                yield kind, name, feature, value, np.array([features[feature] for features in predicted]), scatter


def predictions(draws: Sequence[dict], unexplained: float) -> pandas.DataFrame:
    """Tabulate the features of all tests with their 90 % intervals beside the measured ones; the kind is in `tests`."""
    rows = []
    for kind, name, feature, value, predicted, scatter in compared(draws):
        row = karlsruhe.prediction(value, predicted, unexplained * scatter)
        rows.append({"tests": kind, "test": name, "feature": feature, "draws": len(predicted)} | row)
    return pandas.DataFrame(rows)


def scores(table: pandas.DataFrame) -> pandas.DataFrame:
    """Number inside and interval score of each kind of tests: this study, the first one, a constant."""
    before = {"drained": "predictions.csv", "undrained": "undrained.csv"}
    first = {kind: pandas.read_csv(RESULTS / file) for kind, file in before.items()}
    now = {kind: rows for kind, rows in table.groupby("tests")}
    untrained = {"undrained, not trained on": now["undrained"][now["undrained"]["test"] != TRAINED]}
    untrained_before = {"undrained, not trained on": first["undrained"][first["undrained"]["test"] != TRAINED]}
    both = []
    for tables in (first | untrained_before, now | untrained):
        both.append(means([row for kind, rows in tables.items() for row in scored(rows, kind)]).set_index("tests"))
    renamed = both[0][["inside", "score"]].rename(columns={"inside": "inside before", "score": "score before"})
    return both[1].join(renamed).reset_index()


def by_feature(table: pandas.DataFrame) -> pandas.DataFrame:
    """Tabulate what makes the undrained score: spread of the measured values and width of the intervals."""
    own = table[table["tests"] == "undrained"]
    rows = pandas.DataFrame(scored(own, "undrained")).dropna()
    direction = np.where(own["test"].str.contains("extension"), "extension", "compression")
    groups = own.assign(width=own["high"] - own["low"], direction=direction).groupby(["feature", "direction"])
    sizes = groups.agg(spread=("measured", "std"), width=("width", "mean"))
    return rows.join(sizes, on=["feature", "direction"])


def posteriors(samples: Sequence[Sample]) -> pandas.DataFrame:
    """Quantiles of the parameters after each training."""
    quantiles = []
    for name, trained in TRAININGS.items():
        table = posterior_of(fabric_tests(trained), samples).table().rename_axis("parameter").reset_index()
        quantiles.append(table.assign(training=name))
    return pandas.concat(quantiles)[["training", "parameter", "5 %", "50 %", "95 %"]]


def left_of(sample: Sample) -> list[float]:
    """Return the points of LEFT of a sample that did not fail."""
    return (sample.points or [])[-3:]


def emulated(samples: Sequence[Sample], draws: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard deviation (3,) of the points of LEFT over draws, (n, parameters): Gaussian processes."""
    x = np.array([[sample.parameters[name] for name in FREE] for sample in samples])
    points = np.array([left_of(sample) for sample in samples])
    kernel = ConstantKernel() * RBF(np.ones(len(FREE)), (0.5, 10.0)) + WhiteKernel(0.1, (1e-3, 1.0))
    moments = []
    for values in points.T:
        process = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0)
        process.fit((x - LOW) / (HIGH - LOW), values)
        mean, deviation = process.predict((draws - LOW) / (HIGH - LOW), return_std=True)
        moments.append((mean.mean(), np.sqrt(mean.var() + np.mean(deviation**2))))
    centre, spread = np.array(moments).T
    return centre, spread


def untrained(samples: Sequence[Sample], points: Sequence[float] = ()) -> dict[str, np.ndarray]:
    """Train on drained tests and compression; return what this says of the parameters and of the points of LEFT."""
    tests = fabric_tests(points_measured=points)
    draws = posterior_of(tests, samples).draws
    centre, spread = emulated(samples, draws[[*FREE]].to_numpy()[::20])
    half = 1.645 * np.hypot(spread, draws["misfit"].median() * np.array(DEVIATIONS))
    low, middle, high = np.quantile(draws[[*FREE]].to_numpy(), (0.05, 0.5, 0.95), axis=0)
    measured = tests.points(tests.measured)[-3:]
    parts = {"low": (low, centre - half), "middle": (middle, centre), "high": (high, centre + half)}
    return {name: np.concatenate(both) for name, both in parts.items()} | {"measured": measured}


def beside_the_first(intervals: dict[str, np.ndarray]) -> pandas.DataFrame:
    """Tabulate the untrained test: prediction, inside and interval score, beside the first study and a constant.

    The constant is the mean of the other extension tests. |q| is compared in kPa, as in the first study.
    """
    first = pandas.read_csv(RESULTS / "undrained.csv")
    first = first[first["test"].str.contains("extension")]
    rows = []
    for k, (feature, extension) in enumerate(first.groupby("feature", sort=False)):
        inside = (extension["test"] == LEFT).to_numpy()
        low, middle, high = (intervals[name][len(FREE) + k] for name in ("low", "middle", "high"))
        if feature.startswith("|q| at"):
            low, middle, high = (1e-3 * undrained_of(LEFT)[1] * np.exp([low, middle, high])).tolist()
        x, spread = extension["measured"].to_numpy(), extension["measured"].std(ddof=1)
        constant = [edge[inside] for edge in constant_intervals(x)]
        before = [extension[name].to_numpy()[inside] for name in ("low", "high")]
        row = {"feature": feature, "measured": x[inside][0], "predicted": middle, "low": low, "high": high}
        for name, edges in (("", (low, high)), (" before", before), (" of constant", constant)):
            edges = [np.atleast_1d(edge) for edge in edges]
            row[f"inside{name}"] = bool(edges[0] <= x[inside] <= edges[1])
            row[f"score{name}"] = float(interval_score(x[inside], *edges)[0] / spread)
        rows.append(row)
    return pandas.DataFrame(rows)


def hidden(samples: Sequence[Sample], sands: Sequence[Sample]) -> pandas.DataFrame:
    """Are parameters and the untrained test of synthetic sands recovered from the samples? A row per quantity.

    The assumed scatter of the laboratory is added to the points of each sand.
    """
    every = fabric_tests((DRAINED, TRAINED, LEFT)).deviations
    noise = np.random.default_rng(NOISE_SEED).multivariate_normal(np.zeros(len(every)), every, len(sands))
    scale = np.concatenate([HIGH - LOW, np.std([left_of(sample) for sample in samples], axis=0)])
    inside, widths, errors = [], [], []
    for sand, scatter in zip(sands, noise, strict=True):
        points = np.array(sand.points) + scatter
        intervals = untrained(samples, points.tolist())
        truth = np.array([*sand.parameters.values(), *points[-3:]])
        inside.append((intervals["low"] <= truth) & (truth <= intervals["high"]))
        widths.append((intervals["high"] - intervals["low"]) / scale)
        errors.append(np.abs(intervals["middle"] - truth) / scale)
    columns = {"inside": np.sum(inside, axis=0), "of": len(inside)}
    columns |= {"mean width": np.mean(widths, axis=0), "mean error": np.mean(errors, axis=0)}
    return pandas.DataFrame({"quantity": [*FREE, *POINTS], **columns})


def draw(table: pandas.DataFrame, file: Path) -> None:
    """Draw the undrained features of each test: measured, and the intervals of both studies."""
    before = pandas.read_csv(RESULTS / "undrained.csv")
    figure, panels = plt.subplots(1, 3, figsize=(11, 4.4), layout="constrained", sharey=True)
    names = [*undrained.MONOTONIC]
    for axes, feature in zip(panels, undrained.SCATTERS, strict=True):
        for study, offset, colour, label in ((before, 0.2, "0.6", "first study"), (table, -0.2, "C0", "this study")):
            rows = study[study["feature"] == feature].set_index("test").loc[names]
            y = np.arange(len(names)) + offset
            axes.hlines(y, rows["low"], rows["high"], color=colour, lw=3, label=label)
        axes.plot(rows["measured"], np.arange(len(names)), "k|", ms=14, mew=2, label="measured")
        axes.set_xlabel(feature)
        axes.grid(alpha=0.25)
    panels[2].set_xscale("symlog", linthresh=100.0)
    panels[0].set_yticks(np.arange(len(names)), [f"{n} *" if n == TRAINED else n for n in names], fontsize=8)
    panels[0].invert_yaxis()
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=8)
    save(figure, file, [*FILES.values()], "python -m analysis.sand.with_fabric_table", dpi=80)


def tables_of(samples: Sequence[Sample], draws: Sequence[dict], sands: Sequence[Sample]) -> dict[str, pandas.DataFrame]:
    """Compute the tables, name -> table."""
    filling, tested, sands = (
        [one for one in each if one.points is not None] for each in (samples[:FILLING], samples, sands)
    )
    tables = {"posteriors": posteriors(samples), "left": beside_the_first(untrained(tested))}
    tables["hidden"] = hidden(filling, sands)
    misfit = float(posterior_of(fabric_tests(), samples).draws["misfit"].median())
    tables["predictions"] = predictions(draws, misfit)
    return tables | {"score": scores(tables["predictions"])}


def main() -> None:
    """Compute the tables; write the figure and the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", action="store_true", help="only write the page, from the stored tables")
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # scikit-learn warns about parameters at the end of their range
    samples, sands = (read_samples(fabric_tests(), FILES[name]) for name in ("samples", "sands"))
    draws = lines_of(FILES["draws"])
    if not options.page:
        for name, table in tables_of(samples, draws, sands).items():
            table.to_csv(RESULTS / f"with_fabric_{name}.csv", index=False, float_format="%.4g")
    stored = {
        file.stem.removeprefix("with_fabric_"): pandas.read_csv(file) for file in RESULTS.glob("with_fabric_*.csv")
    }
    draw(stored["predictions"], RESULTS / "with_fabric.png")
    least = stored["predictions"].query("feature == 'least p/p_0'").set_index("test")
    by = stored["by_feature"] = by_feature(stored["predictions"])
    quantiles = stored["posteriors"].set_index(["training", "parameter"])
    values = {
        "modulus": lambda training, name: f"{10.0 ** (quantiles.loc[(training, 'log10 of E'), name] - 9.0):.2g}",  # GPa
        "least": least,
        "flat": by.query("direction == 'extension' and feature.str.startswith('largest')").iloc[0],
        "q": by.query("feature.str.contains('at 3')"),
        "over": lambda test: least.loc[test, "predicted"] - least.loc[test, "measured"],
        "samples": len(samples),
        "failed": sum(sample.points is None for sample in samples),
        "draws": len(draws),
        "misfit": quantiles.loc[("drained and compression", "misfit"), "50 %"],
        "cyclic_summary": cyclic.summary(stored["cyclic"]),
        "longer": cyclic.LONGER,
        "least_cycles": cyclic.LEAST_CYCLES,
        "filling": FILLING,
        "failed_sands": sum(sand.points is None for sand in sands),
        "sand_seconds": np.mean([sand.seconds for sand in sands]),
        # a | would divide the cells of a table
        **{name: table.replace(r"\|(q/p|q)\|", r"abs(\1)", regex=True) for name, table in stored.items()},
    }
    page = render(Path(__file__).with_name("with_fabric_page.md"), values)
    (RESULTS / "with_fabric.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
