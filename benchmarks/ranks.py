"""Are runs on MPI ranks bitwise those of one thread, with every contact law?

    python -m benchmarks.ranks s.state.nc t.csv --copies 2 2 2 --ranks 2 3 4 2x2    # 2x2: two ranks of two threads
    python -m benchmarks.ranks s.state.nc t.csv --some                              # each law on one path

Each run of `fused` on ranks is compared with one on one thread: all variables of the run file, with snapshots and
checkpoint. The specimen is taken under each law, with random velocities, so that its copies differ. All laws and paths
come first on one number of ranks each. Give the same command again to continue; with LABKIT_MPIEXEC=mpiexec.gforker in
the environment, there may be more ranks than cores.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import warnings
from collections.abc import Iterator
from pathlib import Path

import netCDF4
import numpy as np

import labkit as lk
from benchmarks.kernel import copies
from benchmarks.laws import HERTZIAN_MODULUS
from labkit.engines.device import Device
from labkit.grains.bonds import bond
from labkit.grains.laws import LAWS
from labkit.grains.state import State
from labkit.paths.path import Path as StrainPath
from labkit.paths.registry import make_path

PATHS: dict[str, dict[str, object]] = {
    "cv": {},
    "cp": {},
    "simple_shear": {"spin": True},
    "undrained_cycles": {"ratio": 0.3, "cycles": 1, "rate": 100.0},  # q/p; slower, a cycle takes 10,000 steps
}
RATE = 25.0  # 1/s


def under(law: str, state: State) -> State:
    """Return a state under another law, with bonds if the law has them."""
    hertz = "mindlin" in law or law in ("dmt", "jkr")
    modulus = state.scene.young_modulus * (HERTZIAN_MODULUS if hertz else 1.0)
    twisting = 0.1 if "twisting_friction" in LAWS[law]().parameters else 0.0
    scene = state.scene.replace(law=law, young_modulus=modulus, twisting_friction=twisting)
    moved = state.replace(scene=scene, time_step=min(state.time_step, scene.time_step))
    return bond(moved, scene) if law == "bonded" else moved


def shaken(state: State, seed: int) -> State:
    """Return a state with random velocities of 1 % of the strain rate times the cell."""
    random = np.random.default_rng(seed)
    speed = 0.01 * RATE * state.cell[0, 0]
    return state.replace(velocity=state.velocity + speed * random.standard_normal(state.position.shape))


def variables(group: netCDF4.Dataset, place: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Yield all variables of a file, in all groups, as name and raw values."""
    group.set_auto_mask(False)
    for name, variable in group.variables.items():
        yield place + name, variable[:]
    for name, inner in group.groups.items():
        yield from variables(inner, f"{place}{name}/")


def differences(one: Path, other: Path) -> tuple[int, list[str]]:
    """Return the number of variables of a run file, and the names of those that differ in another by a bit."""
    with netCDF4.Dataset(one) as a, netCDF4.Dataset(other) as b:
        left, right = dict(variables(a)), dict(variables(b))
    return len(left), [name for name in left if name not in right or left[name].tobytes() != right[name].tobytes()]


def run_to(file: Path, state: State, path: StrainPath, engine: Device, steps: int) -> None:
    """Run a path for some time steps, with a record and a snapshot after every third of them."""
    assert path.rate is not None
    lk.run(
        state,
        path,
        engine=engine,
        file=file,
        progress=False,
        record_strain=path.rate * state.time_step * steps / 3,
        snapshots=3,
        save_every=1,
        guarded=False,
    )


def cases(laws: list[str], some: bool, ranks: list[str]) -> Iterator[tuple[str, str, str]]:
    """Yield law, path and number of ranks; with `some`, one path and one number of ranks for each law."""
    for turn in range(1 if some else len(ranks)):
        for number, (law, path) in enumerate(itertools.product(laws, PATHS)):
            row, column = divmod(number, len(PATHS))
            if not some or column == row % len(PATHS):
                yield law, path, ranks[(row + row // len(PATHS) + column + turn) % len(ranks)]


def path_of(name: str, state: State, steps: int) -> StrainPath:
    """Return one of PATHS; but for cycles, it ends after some time steps."""
    extent = {} if name == "undrained_cycles" else {"strain": RATE * state.time_step * steps}
    return make_path(name, {"rate": RATE, **PATHS[name], **extent})


def main() -> None:
    """Compare, and print one line for each run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("specimen")
    parser.add_argument("table", type=Path, help="rows of law, path, ranks, equal variables, variables, others")
    parser.add_argument("--copies", nargs=3, type=int, default=[1, 1, 1])
    parser.add_argument("--ranks", nargs="+", default=["2", "3", "4", "2x2"])
    parser.add_argument("--laws", nargs="+", default=list(LAWS))
    parser.add_argument("--steps", type=int, default=300, help="time steps of a run")
    parser.add_argument("--some", action="store_true", help="each law on one path and one number of ranks")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    specimen = copies(lk.read_state(asked.specimen), asked.copies)
    done = {tuple(row[:3]) for row in csv.reader(asked.table.open())} if asked.table.exists() else set()
    folder = asked.table.with_suffix(".runs")
    folder.mkdir(exist_ok=True)
    for case in cases(asked.laws, asked.some, asked.ranks):
        if case in done:
            continue
        law, name, number = case
        state = shaken(under(law, specimen), seed=1)
        path, ranks = path_of(name, state, asked.steps), [int(count) for count in number.split("x")]
        one, other = folder / f"{law}.{name}.run.nc", folder / "other.run.nc"
        run_to(one, state, path, lk.Fused(), asked.steps)  # returns at once if it is complete
        other.unlink(missing_ok=True)
        run_to(other, state, path, lk.Fused(ranks=ranks[0], threads=(*ranks, 1)[1]), asked.steps)
        count, odd = differences(one, other)
        with asked.table.open("a") as out:
            csv.writer(out).writerow([*case, count - len(odd), count, " ".join(odd)])
    rows = [row for row in csv.reader(asked.table.open())]
    wrong = sum(row[3] != row[4] for row in rows)
    print(f"{len(rows) - wrong} of {len(rows)} runs have all variables equal")
    raise SystemExit(wrong > 0)


if __name__ == "__main__":
    main()
