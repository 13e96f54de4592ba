"""Is the engine lammps equal to fused, with every contact law? Give the same command again to continue.

    python -m benchmarks.lammps_matrix s.state.nc m.csv --ranks 2 1 4
    python -m benchmarks.lammps_matrix s.state.nc 5.csv --laws jkr --paths cp --steps 30000 --other s2.state.nc

A row has the largest differences of q/p, the coordination number and the void ratio from `fused` in all records,
relative to their largest values. The row `bit 0` is fused itself, with another last bit of one coordinate of grain 0:
the growth of rounding. The row `other` is fused with another specimen: the scatter of specimens.
"""

from __future__ import annotations

import argparse
import csv
import warnings
from pathlib import Path

import numpy as np

import labkit as lk
from benchmarks.ranks import PATHS, path_of, shaken, under
from labkit.engines.device import Device
from labkit.grains.laws import LAWS
from labkit.grains.state import State
from labkit.paths.path import Path as StrainPath

RECORDS = 10


def with_another_bit(state: State, grain: int) -> State:
    """Return a state with one coordinate of one grain changed by its last bit."""
    position = state.position.copy()
    position[grain, 0] = np.nextafter(position[grain, 0], np.inf)
    return state.replace(position=position)


def records(state: State, path: StrainPath, engine: Device, steps: int) -> np.ndarray:
    """Return q/p, the coordination number and the void ratio in the records of a run, (3, record)."""
    assert path.rate is not None
    every = path.rate * state.time_step * steps / RECORDS
    run = lk.run(state, path, engine=engine, progress=False, record_strain=every, snapshots=0, guarded=False)
    return np.array([run.data.lab.stress_ratio(), run.data["coordination_number"], run.data["void_ratio"]])


def apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the largest differences of `records`, (3,), relative to their largest values."""
    same = min(one.shape[1], other.shape[1])
    differences: np.ndarray = np.abs(one - other)[:, :same].max(axis=1) / np.abs(one).max(axis=1)
    return differences


def main() -> None:
    """Compare, and append one row for each run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("specimen")
    parser.add_argument("table", type=Path)
    parser.add_argument("--ranks", nargs="+", type=int, default=[2, 1, 4])
    parser.add_argument("--bits", nargs="+", type=int, default=[0], help="grains that get another bit, one at a time")
    parser.add_argument("--steps", type=int, default=3000, help="time steps of a run")
    parser.add_argument("--laws", nargs="+", default=list(LAWS))
    parser.add_argument("--paths", nargs="+", default=list(PATHS))
    parser.add_argument("--other", help="another specimen, to compare with")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    done = {tuple(row[:3]) for row in csv.reader(asked.table.open())} if asked.table.exists() else set()
    specimen = lk.read_state(asked.specimen)
    with asked.table.open("a") as out:
        write = csv.writer(out).writerow
        for law in asked.laws:
            state = shaken(under(law, specimen), seed=1)
            for name in asked.paths:
                runs: dict[str, tuple[State, Device]] = {
                    f"bit {grain}": (with_another_bit(state, grain), lk.Fused()) for grain in asked.bits
                }
                runs |= {str(ranks): (state, Device("lammps", ranks=ranks)) for ranks in asked.ranks}
                if asked.other:
                    runs["other"] = shaken(under(law, lk.read_state(asked.other)), seed=1), lk.Fused()
                left = [case for case in runs if (law, name, case) not in done]
                path = path_of(name, state, asked.steps)
                fused = records(state, path, lk.Fused(), asked.steps) if left else None
                for case in left:
                    assert fused is not None
                    row = apart(fused, records(runs[case][0], path, runs[case][1], asked.steps))
                    write([law, name, case, *(f"{value:.1e}" for value in row)])
                    out.flush()


if __name__ == "__main__":
    main()
