"""Time of a step on threads, ranks and in LAMMPS's own pair style of Hertz's law, with the same grains.

    python -m benchmarks.rank_speed s.state.nc t.csv --copies 4 2 2 --steps 100 --rounds 3
    python -m benchmarks.rank_speed s.state.nc tune.csv --tune            # LAMMPS's settings, on one process

Each measurement is a process of its own, because waiting ranks poll; the machines alternate. A row has the wall time,
the processor time of all processes, and that without the waiting of ranks for messages (of rank 0, times the number of
ranks), in ns per grain and step, and the mean stress afterwards, in Pa. On a busy computer only the third is of use.
Searches are included as they fall due. LAMMPS neither damps, nor sums energies, nor keeps the tangential forces of the
specimen; what its ranks wait is unknown.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import labkit as lk
from benchmarks.kernel import copies
from benchmarks.lammps import HEAD, TUNINGS, Tuning
from benchmarks.rank_kills import ranks_of
from benchmarks.rank_memory import is_rank
from labkit.engines.device import Device
from labkit.engines.followers import Ranks
from labkit.engines.mpi import launcher
from labkit.grains.state import State
from labkit.paths.standard import ConstantVolume
from labkit.servo.plan import prescribed_gradient

RATE, WARM_UP = 25.0, 30  # 1/s; at most so many time steps come first
DEVICES = {
    "fused, 1 thread": lk.Fused(),
    "fused, 2 threads": lk.Fused(threads=2),
    "fused, 2 ranks": lk.Fused(ranks=2),
    "lammps, 2 ranks": Device("lammps", ranks=2),
}
FASTEST = Tuning(skin=0.05, newton="off", sort=200)  # of --tune; the others take up to 1.2 times as long
INPUT = (
    HEAD
    + """\
box tilt large
region cell prism 0 {x} 0 {y} 0 {z} {xy} {xz} {yz} units box
create_box 1 cell
neighbor {skin} bin
neigh_modify every 1 delay 0 check yes
pair_style granular
pair_coeff * * hertz/material {young_modulus} 0.0 {poisson_ratio} &
    tangential mindlin/force NULL 0.0 {friction} damping velocity
fix motion all nve/sphere
timestep {time_step}
thermo_style custom step press
"""
)


def processor_time(processes: list[int]) -> float:
    """Return the processor time of all threads of some processes, in s."""
    tasks = [task for process in processes for task in Path(f"/proc/{process}/task").glob("*/schedstat")]
    return 1e-9 * sum(int(task.read_text().split()[0]) for task in tasks)


class Waiting:
    """Processor time, in s, that this rank has waited for messages."""

    seconds = 0.0
    _wait = Ranks.wait

    @classmethod
    def wait(cls, ranks: Ranks, *requests: object) -> None:
        """Wait as Ranks does."""
        begin = time.thread_time()
        cls._wait(ranks, *requests)
        cls.seconds += time.thread_time() - begin


def measure(advance: Callable[[int], object], steps: int, processes: list[int]) -> tuple[float, float]:
    """Return wall time and processor time, in s, of some time steps after WARM_UP."""
    advance(min(WARM_UP, steps))
    before, begin = processor_time(processes), time.perf_counter()
    advance(steps)
    return time.perf_counter() - begin, processor_time(processes) - before


def of_labkit(state: State, device: Device, steps: int) -> tuple[float, float, float, float]:
    """Return wall time, processor time, and that without waiting, s, and mean stress, Pa, of an engine of labkit."""
    engine, gradient = device(state), prescribed_gradient(ConstantVolume(RATE), state.time_step)
    processes = [process for process in ranks_of(os.getpid()) if is_rank(process)]
    Ranks.wait = lambda *words: Waiting.wait(*words)  # type: ignore[method-assign]
    first: list[float] = []

    def advance(count: int) -> None:
        Waiting.seconds, begin = 0.0, processor_time(processes[:1])
        engine.advance(count, gradient)
        first[:] = [processor_time(processes[:1]) - begin - Waiting.seconds]

    wall, processor = measure(advance, steps, processes)
    return wall, processor, first[0] * len(processes), float(np.trace(engine.stress())) / 3.0


def of_lammps(state: State, tuning: Tuning, steps: int) -> tuple[float, float, float, float]:
    """Return the same of LAMMPS's own pair style, on all processes of mpiexec."""
    from lammps import lammps
    from mpi4py import MPI

    comm, gradient = MPI.COMM_WORLD, prescribed_gradient(ConstantVolume(RATE), state.time_step)
    of = dataclasses.asdict(tuning) | {"skin": tuning.skin * 2.0 * state.radius.mean()}
    box = np.linalg.qr(state.cell).R
    box *= np.sign(np.diag(box))[:, None]
    (x, xy, xz), (_, y, yz), (_, _, z) = box.tolist()
    scene = {name: getattr(state.scene, name) for name in ("young_modulus", "poisson_ratio", "friction")}
    program = lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"], comm=comm)
    sides = {"x": x, "y": y, "z": z, "xy": xy, "xz": xz, "yz": yz}
    program.commands_list(INPUT.format(**of, **sides, **scene, time_step=state.time_step).splitlines())
    inside, number = np.linalg.solve(state.cell, state.position.T).T % 1.0, state.number_of_grains
    program.create_atoms(number, list(range(1, number + 1)), [1] * number, (inside @ box.T).ravel())
    label = program.numpy.extract_atom("id")[: program.extract_global("nlocal")] - 1
    place = program.numpy.extract_atom("x")[: len(label)]
    for name, values in (
        ("radius", state.radius[label]),
        ("rmass", state.scene.mass(state.radius[label])),
        ("v", (place - 0.5 * np.diag(box)) @ gradient.T),
    ):
        array = program.numpy.extract_atom(name)[: len(label)]
        array[:] = values.reshape(array.shape)
    rates = " ".join(f"{axis} trate {rate!r}" for axis, rate in zip("xyz", np.diag(gradient).tolist(), strict=True))
    program.command(f"fix cell all deform 1 {rates} remap v")
    program.command("run 0 post no")
    times = measure(lambda count: program.command(f"run {count} pre no post no"), steps, [os.getpid()])
    program.command("run 0 post no")
    processor = comm.allreduce(times[1])
    return comm.allreduce(times[0], MPI.MAX), processor, processor, float(program.get_thermo("press"))


def main() -> None:
    """Measure, and append one row for each measurement."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("specimen")
    parser.add_argument("table", type=Path)
    parser.add_argument("--copies", nargs=3, type=int, default=[2, 1, 1])
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--tune", action="store_true", help="compare settings of LAMMPS")
    parser.add_argument("--only", help=argparse.SUPPRESS)  # one measurement, in a process of its own
    asked = parser.parse_args()
    if asked.only:
        state, (name, _, settings) = copies(lk.read_state(asked.specimen), asked.copies), asked.only.partition("; ")
        if name in DEVICES:
            values = of_labkit(state, DEVICES[name], asked.steps)
        else:
            tuning = next(tuning for tuning in TUNINGS if str(tuning) == settings)
            values = of_lammps(state, tuning, asked.steps)
            if int(os.environ.get("PMI_RANK", "0")) > 0:
                return
        times = [f"{1e9 * seconds / asked.steps / state.number_of_grains:.1f}" for seconds in values[:3]]
        with asked.table.open("a") as out:
            csv.writer(out).writerow([state.number_of_grains, asked.only, *times, f"{values[3]:.7g}"])
        return
    own = [f"LAMMPS, 1 process; {settings}" for settings in (TUNINGS if asked.tune else [FASTEST])]
    names = own if asked.tune else [*DEVICES, *own, f"LAMMPS, 2 processes; {FASTEST}"]
    for name in names * asked.rounds:
        start = [*launcher(), "-n", name[8]] if name.startswith("LAMMPS") else []
        words = [sys.executable, "-m", "benchmarks.rank_speed", *sys.argv[1:], "--only", name]
        subprocess.run([*start, *words], check=True, env={**os.environ, "OMP_NUM_THREADS": "2"})


if __name__ == "__main__":
    main()
