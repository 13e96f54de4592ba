"""Repeat undrained tests of Toyoura sand with the draws of with_fabric: `python -m analysis.sand.toyoura [FOLDER]`.

FOLDER (default: results/sand) keeps a line per draw and test. The plan is the end of
analysis/plans/karlsruhe_with_fabric.md.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas

import labkit as lk
from analysis.sand.cyclic import interval_of
from analysis.sand.karlsruhe import LIMITS, OTHERS, RESULTS
from analysis.sand.with_fabric import FIRST_DRAW, append, drained_of, limits_of, lines_of, repeated, scene_of
from labkit.errors import PhysicsError

VOID_RATIOS, PRESSURE, STRAIN = (0.735, 0.833, 0.907), 1e6, 0.25
TOYOURA = (0.597, 0.977)  # e_min, e_max
RATIO, QUASI_STEADY = 1.25, {0.833: 400e3}  # q/p at the critical state; least p, Pa


def critical_pressure(void_ratio: float) -> float:
    """Return the mean stress at the critical state, Pa: e_c = 0.934 - 0.019 (p/101 kPa)^0.7."""
    return float(101e3 * ((0.934 - void_ratio) / 0.019) ** (1.0 / 0.7))


def measured() -> pandas.DataFrame:
    """Tabulate the measured features."""
    rows: list[tuple[float, str, float]] = []
    for void_ratio in VOID_RATIOS:
        rows += [(void_ratio, "p at 25 % (kPa)", 1e-3 * critical_pressure(void_ratio))]
        rows += [(void_ratio, "q/p at 25 %", RATIO)]
    rows += [(void_ratio, "least p (kPa)", 1e-3 * pressure) for void_ratio, pressure in QUASI_STEADY.items()]
    return pandas.DataFrame(rows, columns=["void ratio", "feature", "measured"])


def run(file: Path) -> None:
    """Repeat the tests that the file lacks."""
    done = {(line["draw"], line["void ratio"]) for line in lines_of(file)}
    path = lk.paths.ConstantVolume(strain=STRAIN, rate=20)
    for number, draw in enumerate(lines_of(RESULTS / "with_fabric_draws.jsonl")):
        missing = [e for e in VOID_RATIOS if (number, e) not in done]
        parameters, seed = draw["parameters"], FIRST_DRAW + number
        limits = limits_of(drained_of(OTHERS), scene_of(parameters), seed) if missing else []
        for void_ratio in missing:
            begin, row = time.process_time(), dict[str, object](draw=number) | {"void ratio": void_ratio}
            density = (TOYOURA[1] - void_ratio) / (TOYOURA[1] - TOYOURA[0])
            same = LIMITS[1] - density * (LIMITS[1] - LIMITS[0])  # the void ratio of Karlsruhe sand at this density
            try:
                (test,) = dict(repeated({"": (path, PRESSURE, same)}, parameters, seed, limits)).values()
                p, q = test.data.lab.mean_stress().values, test.data.lab.q().values
                row |= {"p at 25 % (kPa)": 1e-3 * p[-1], "q/p at 25 %": q[-1] / p[-1], "least p (kPa)": 1e-3 * p.min()}
            except PhysicsError as error:
                row["failed"] = str(error)
            append(file, row | {"seconds": round(time.process_time() - begin, 1)})
            print(number, void_ratio, row.get("failed", ""), flush=True)


def table_of(lines: Sequence[dict]) -> pandas.DataFrame:
    """Tabulate measured and predicted features with their 90 % intervals."""
    rows = []
    for row in measured().to_dict("records"):
        own = [x[row["feature"]] for x in lines if x["void ratio"] == row["void ratio"] and "failed" not in x]
        low, middle, high = interval_of(np.log(np.maximum(own, 1e-3)))
        factor, largest = middle / row["measured"], 1.1 if row["feature"].startswith("q/p") else 1.5
        row |= {"predicted": middle, "low": low, "high": high, "inside": low <= row["measured"] <= high}
        rows.append(row | {"draws": len(own), "near": 1.0 / largest <= factor <= largest})
    return pandas.DataFrame(rows)


def main() -> None:
    """Repeat, tabulate."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=RESULTS)
    file = parser.parse_args().folder / "with_fabric_toyoura.jsonl"
    warnings.simplefilter("ignore")
    run(file)
    table = table_of(lines_of(file))
    table.to_csv(RESULTS / "with_fabric_toyoura.csv", index=False, float_format="%.4g")
    print(table.to_string(float_format="%.3g"))


if __name__ == "__main__":
    main()
