"""Undrained cycles to r_u = 0.95: grains, labkit's models and peers.

`./lab hidden-state FOLDER --steps cycles` runs the grains' tests of analysis/plans/state_law.md that cycles.jsonl
lacks, a line each.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas
from scipy.stats import t

import labkit as lk
from analysis.hidden_state.contest import vector_of
from analysis.hidden_state.driving import values_of, with_digits
from analysis.hidden_state.law import Constants
from analysis.hidden_state.loading import DEVICE, PRESSURE, RATE, SEEDS, specimen
from analysis.hidden_state.table import Test
from labkit.errors import InputError, PhysicsError
from labkit.micro import to_six
from labkit.model import ConstitutiveLaw, as_run, drive

RATIOS = {"medium": (0.6, 0.5, 0.4), "loose": (0.2, 0.15, 0.1)}  # amplitude of q over p; CSR is half of it
MOST, LIQUEFIED = 30, "r_u > 0.95"
GRAINS = "grains"


def path_of(ratio: float) -> lk.Path:
    """Undrained cycles about q = 0."""
    return lk.paths.UndrainedCycles(amplitude=ratio * PRESSURE, cycles=MOST, rate=RATE)


def tests(file: Path) -> Iterator[str]:
    """Run the grains' tests that a file lacks, yielding a line about each."""
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    done = {(row["density"], row["seed"], row["ratio"]) for row in map(json.loads, text.splitlines())}
    for seed in SEEDS:
        for k in range(3):
            for density, ratios in RATIOS.items():
                if (density, seed, ratios[k]) in done:
                    continue
                state, ended = specimen(density, seed), ""
                snapshot = state.snapshot()
                start = {name: with_digits(values) for name, values in values_of(state).items()}
                start["stress"] = with_digits(to_six(lk.love_stress(snapshot)))
                try:
                    run = lk.run(
                        state, path_of(ratios[k]), engine=DEVICE, progress=False, snapshots=0, stop_when=LIQUEFIED
                    )
                except PhysicsError as error:
                    run, ended = error.run, str(error)
                row = {"density": density, "seed": seed, "ratio": ratios[k], "N": cycles_of(run.data), "ended": ended}
                with file.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(row | start) + "\n")
                yield f"{time.process_time():7.1f} s {density} s{seed} {ratios[k]} N {row['N']} {ended}"


def cycles_of(data: object) -> float:
    """Number of cycles to r_u = 0.95 by ASTM's count; MOST if it is not reached."""
    found = float(data.lab.liquefaction().cycles_to_ratio)  # type: ignore[attr-defined]
    return found if np.isfinite(found) else float(MOST)


def start_of(row: dict[str, object]) -> Test:
    """A test of one record, the start of the grains' cycles."""
    columns = {name: np.array([row[name]], float) for name in ("Z", "Lambda", "A", "F", "Ft", "stress")}
    columns = {name: values.reshape(1, -1) for name, values in columns.items()}
    columns |= {name: columns[name][:, 0] for name in ("Z", "Lambda")}
    e = np.array(row["e"], float).ravel()
    return Test("undrained", str(row["density"]), int(row["seed"]), {"e": e, **columns}, 0.0, "")  # type: ignore[call-overload]


def counted(
    rows: Sequence[dict[str, object]], laws: dict[str, ConstitutiveLaw], constants: Constants
) -> pandas.DataFrame:
    """N of grains and laws, a row per density, seed, CSR and law; NaN if a law is undefined at the start.

    Further columns of laws: `r_u`, the largest, and `end`, the number of cycles at the end of the test, which is at 5 %
    of axial strain at the latest.
    """
    found = []
    for row in rows:
        labels = {"density": row["density"], "seed": row["seed"], "CSR": 0.5 * float(row["ratio"])}  # type: ignore[arg-type]
        found.append(labels | {"law": GRAINS, "N": row["N"]})
        for name, law in laws.items():
            try:
                y = vector_of(name, law, start_of(row), constants)
                result = drive(law, path_of(float(row["ratio"])), y, stop_when=LIQUEFIED)  # type: ignore[arg-type]
                run = as_run(result)
            except InputError:
                found.append(labels | {"law": name, "N": np.nan})
                continue
            end = run.lab.liquefaction()
            found.append(labels | {"law": name, "N": cycles_of(run), "r_u": end.largest_ratio, "end": end.cycles})
    return pandas.DataFrame(found)


def errors_of_cycles(table: pandas.DataFrame) -> pandas.DataFrame:
    """Root mean square of ln N, law less grains, over CSR; mean over specimens with its 95 % interval (t).

    Further columns: factor (N over that of the grains, geometric mean), r_u (mean of the largest), strained (share of
    tests that ended by their strain).
    """
    keys = ["density", "seed", "CSR"]
    truth = table[table["law"] == GRAINS].set_index(keys)["N"]
    own = table[table["law"] != GRAINS]
    off = np.log(own["N"]) - np.log(truth.reindex(pandas.MultiIndex.from_frame(own[keys])).to_numpy())
    by_specimen = own.assign(square=off**2, off=off).groupby(["density", "law", "seed"], sort=False)
    square = by_specimen[["square", "off"]].mean()
    rows = []
    strained = own["end"].notna() & (own["end"] < MOST - 1.0) & ~(own["r_u"] > 0.95)
    further = own.assign(strained=strained).groupby(["density", "law"], sort=False)[["r_u", "strained"]].mean()
    for (density, law), each in square.groupby(level=[0, 1], sort=False):
        values, n = np.sqrt(each["square"].dropna()), int(each["square"].notna().sum())
        within = t.ppf(0.975, n - 1) * values.std() / np.sqrt(n) if n > 1 else np.nan
        rows.append((density, law, n, values.mean(), within, np.exp(each["off"].mean()), *further.loc[(density, law)]))
    return pandas.DataFrame(rows, columns="density law specimens error within factor r_u strained".split())
