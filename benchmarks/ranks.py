"""Are runs on MPI ranks bitwise those of one thread, with every contact law?

    python -m benchmarks.ranks s.state.nc --copies 2 2 2 --ranks 2 3 4 2x2    # 2x2: two ranks of two threads
    python -m benchmarks.ranks s.state.nc --some                              # each law on one path and number of ranks
    python -m benchmarks.ranks s.state.nc --copies 2 2 2 --speed 200          # times of steps and records

Each run of `fused` on ranks is compared with one on one thread: all variables of the run file, with snapshots and
checkpoint. The specimen is taken under each law, with random velocities, so that its copies differ.
"""

from __future__ import annotations

import argparse
import tempfile
import time
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
from labkit.paths.standard import ConstantVolume
from labkit.servo.plan import prescribed_gradient

PATHS: dict[str, dict[str, object]] = {
    "cv": {},
    "cp": {},
    "simple_shear": {"spin": True},
    "undrained_cycles": {"amplitude": 5e3, "cycles": 1},
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
    lk.run(
        state,
        path,
        engine=engine,
        file=file,
        progress=False,
        record_strain=RATE * state.time_step * steps / 3,
        snapshots=3,
        save_every=1,
        guarded=False,
    )


def cases(laws: list[str], some: bool, ranks: list[str]) -> Iterator[tuple[str, str, list[str]]]:
    """Yield law, path and numbers of ranks; with `some`, one path and one number of ranks for each law."""
    for number, law in enumerate(laws):
        for place, path in enumerate(PATHS):
            if not some or place == number % len(PATHS):
                turn = (number + number // len(PATHS)) % len(ranks)
                yield law, path, ranks[turn : turn + 1] if some else ranks


def speed(state: State, steps: int, rounds: int) -> None:
    """Print the time of a step in CV shear, and of a State for a record, on threads and ranks of two cores.

    The least of many short measurements, taken alternately, is nearly that of a quiet computer.
    """
    devices: dict[str, Device] = {
        "1 thread": lk.Fused(),
        "2 threads": lk.Fused(threads=2),
        "2 ranks": lk.Fused(ranks=2),
    }
    devices |= {"lammps, 2": Device("lammps", ranks=2)}
    engines = {name: device(state) for name, device in devices.items()}
    gradient = prescribed_gradient(ConstantVolume(RATE), state.time_step)
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in engines}
    for _ in range(rounds):
        for name, engine in engines.items():
            begin = time.perf_counter()
            engine.advance(steps, gradient)
            middle = time.perf_counter()
            engine.state()
            seconds[name].append(((middle - begin) / steps, time.perf_counter() - middle))
    for name, values in seconds.items():
        step, record = np.min(values, axis=0)
        single = min(values for values, _ in seconds["1 thread"])
        print(
            f"{state.number_of_grains} grains, {name:10} {1e3 * step:8.3f} ms a step, {single / step:.2f} times "
            f"1 thread, {1e3 * record:6.1f} ms a State"
        )


def main() -> None:
    """Compare, and print one line for each run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("specimen")
    parser.add_argument("--copies", nargs=3, type=int, default=[1, 1, 1])
    parser.add_argument("--ranks", nargs="+", default=["2", "3", "4", "2x2"])
    parser.add_argument("--laws", nargs="+", default=list(LAWS))
    parser.add_argument("--steps", type=int, default=300, help="time steps of a run")
    parser.add_argument("--some", action="store_true", help="each law on one path and one number of ranks")
    parser.add_argument("--speed", type=int, metavar="ROUNDS", help="measure times instead")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    specimen, wrong = copies(lk.read_state(asked.specimen), asked.copies), 0
    if asked.speed:
        return speed(specimen, asked.steps, asked.speed)
    with tempfile.TemporaryDirectory() as place:
        for law, name, numbers in cases(asked.laws, asked.some, asked.ranks):
            state = shaken(under(law, specimen), seed=1)
            strain = RATE * state.time_step * asked.steps
            extent = {} if name == "undrained_cycles" else {"strain": strain}
            path, one = make_path(name, {**PATHS[name], **extent, "rate": RATE}), Path(place) / "one.run.nc"
            one.unlink(missing_ok=True)
            run_to(one, state, path, lk.Fused(), asked.steps)
            for number in numbers:
                ranks, _, threads = number.partition("x")
                other = Path(place) / "other.run.nc"
                other.unlink(missing_ok=True)
                run_to(other, state, path, lk.Fused(ranks=int(ranks), threads=int(threads or 1)), asked.steps)
                count, odd = differences(one, other)
                wrong += bool(odd)
                print(
                    f"{law:24} {name:17} {number:>4}  {count - len(odd)} of {count} equal {' '.join(odd)}", flush=True
                )
    raise SystemExit(f"{wrong} runs differ" if wrong else 0)


if __name__ == "__main__":
    main()
