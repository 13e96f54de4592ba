"""Does one modulus serve drained and undrained tests? `python -m analysis.sand.moduli [FOLDER]`, a line per specimen.

The parameters are those of the draw of analysis.sand.with_fabric that is nearest to the measured features; law and
modulus are replaced. The plan is the last part of analysis/plans/karlsruhe_with_fabric.md.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas

from analysis.sand.karlsruhe import RESULTS
from analysis.sand.with_fabric import GRAINS, LAW, append, fabric_tests, lines_of
from analysis.sand.with_fabric_table import FILES, compared
from labkit.errors import InputError, PhysicsError

MODULI = {  # GPa: the tangent of a contact at 100 kPa is the same in each column
    LAW: (0.1, 0.2, 0.4, 0.8, 1.6),
    "hertz_mindlin_rolling": (2.0, 5.0, 12.0, 30.0, 80.0),
}
SEEDS = (6001, 6002)
PARTS = {"drained": slice(0, 24), "compression": slice(24, 27)}  # of the points
NEAR = 1.5  # a modulus serves a kind of test if its misfit is within this factor of the least


def nearest(draws: Sequence[dict]) -> dict[str, float]:
    """Return the parameters of the draw whose features deviate least, in units of the scatter (root mean square)."""
    distances = [
        np.sqrt(np.mean([((values[0] - x) / scatter) ** 2 for *_, x, values, scatter in compared([draw]) if scatter]))
        for draw in draws
    ]
    return draws[int(np.argmin(distances))]["parameters"]


def run(file: Path) -> None:
    """Test the specimens that the file lacks."""
    parameters = nearest(lines_of(FILES["draws"]))
    done = {(line["law"], line["modulus"], line["seed"]) for line in lines_of(file)}
    for seed in SEEDS:
        for law, moduli in MODULI.items():
            tests = dataclasses.replace(fabric_tests(), law=law)
            for modulus in moduli:
                if (law, modulus, seed) in done:
                    continue
                begin, row = time.process_time(), {"law": law, "modulus": modulus, "seed": seed}
                try:
                    changed = parameters | {"log10 of E": 9.0 + float(np.log10(modulus))}
                    row["points"] = np.round(tests.points(tests.repeat(changed, GRAINS, seed)), 4).tolist()
                except (PhysicsError, InputError) as error:  # stiff grains: p deviates, so q is 0 before the reversal
                    row["failed"] = str(error)
                append(file, row | {"seconds": round(time.process_time() - begin, 1)})
                print(law, modulus, seed, row.get("failed", ""), flush=True)


def table_of(lines: Sequence[dict]) -> pandas.DataFrame:
    """Tabulate the misfits, root mean square over specimens and points, of each law and modulus."""
    tests = fabric_tests()
    measured, scale = tests.points(tests.measured), np.sqrt(np.diag(tests.deviations))
    rows = []
    for law, moduli in MODULI.items():
        for modulus in moduli:
            own = [x["points"] for x in lines if (x["law"], x["modulus"]) == (law, modulus) and "points" in x]
            if own:
                deviations = (np.array(own) - measured) / scale
                misfits = {name: float(np.sqrt(np.mean(deviations[:, part] ** 2))) for name, part in PARTS.items()}
                rows.append({"law": law, "modulus (GPa)": modulus, "specimens": len(own)} | misfits)
    table = pandas.DataFrame(rows)
    least = table.groupby("law")[[*PARTS]].transform("min")
    return table.assign(both=(table[[*PARTS]] <= NEAR * least).all(axis=1))


def main() -> None:
    """Test, tabulate."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=RESULTS)
    file = parser.parse_args().folder / "with_fabric_moduli.jsonl"
    warnings.simplefilter("ignore")
    run(file)
    table = table_of(lines_of(file))
    table.to_csv(RESULTS / "with_fabric_moduli.csv", index=False, float_format="%.4g")
    print(table.to_string(float_format="%.3g"))


if __name__ == "__main__":
    main()
