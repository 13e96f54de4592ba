"""A specimen in LAMMPS: pair style granular with the same grains, stiffness, friction, dashpots and rolling.

LAMMPS has one set of coefficients per pair of atom types, labkit one per pair of grains. The grains are therefore
sorted into `classes` of equal width in radius, and a pair gets the coefficients computed from its class midpoints. In
the notation of LAMMPS, with r* = Ra Rb/(Ra + Rb):

    hooke kn eta, damping velocity      fn = kn delta + eta ddelta/dt               eta = 2 beta_n sqrt(m* kn)
    linear_history kt xgammat mu        |kt xi + xgammat eta dxi/dt| <= mu |fn|     xgammat = ct/cn
    rolling sds k gamma mu              M = k r*^2 theta, |M| <= mu r* |fn|         k = kr/r*^2, gamma = 0, mu = mu_r

The `tsuji` dashpot would use m* of the actual grains, but it accepts only the restitution coefficient, through a
polynomial fitted for Hertz's law.

Differences from the contact law `spring_dashpot`: the friction and rolling limits cap the sum of spring and dashpot,
and their fn includes the dashpot; the springs do not turn about the normal; the contact forces stored in the State are
not transferred.
"""

from __future__ import annotations

import dataclasses
import itertools
import os
import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from labkit.errors import InputError, PhysicsError
from labkit.grains.laws.named import SpringDashpot
from labkit.grains.scene import Scene
from labkit.grains.state import State


@dataclasses.dataclass(frozen=True)
class Tuning:
    """Settings that change the speed of LAMMPS but not its results, apart from rounding.

    Args:
        skin: Skin as a fraction of the mean diameter.
        newton: "on" to compute a pair across two processes once.
        sort: Steps between two sorts of the grains by place.
    """

    skin: float = 0.05
    newton: str = "off"
    sort: int = 1000

    def __str__(self) -> str:
        return f"skin {self.skin:g} D, newton {self.newton}, sort {self.sort}"


STANDARD = Tuning()
TUNINGS = tuple(Tuning(*each) for each in itertools.product((0.03, 0.05, 0.1), ("off", "on"), (200, 1000)))

HEAD = """\
units si
atom_style sphere
atom_modify sort {sort} 0.0
boundary p p p
comm_modify vel yes
newton {newton}
"""

# remap v: grains keep their positions and velocities, and images move with the cell. No fix adds the velocity of the
# mean field, so the input adds it once at the start.
INPUT = (
    HEAD
    + """\
read_data "{data}"
neighbor {skin:.17g} bin
neigh_modify every 1 delay 0 check yes
pair_style granular
{coefficients}
fix motion all nve/sphere
timestep {time_step:.17g}
compute stress all pressure NULL virial
thermo_style custom step lx ly lz &
    c_stress[1] c_stress[2] c_stress[3] c_stress[4] c_stress[5] c_stress[6]
thermo_modify format float %.15g
thermo {settle}
run {settle}
reset_timestep 0
velocity all ramp vx {start[0]:.17g} {end[0]:.17g} x 0 {size[0]:.17g} sum yes units box
velocity all ramp vy {start[1]:.17g} {end[1]:.17g} y 0 {size[1]:.17g} sum yes units box
velocity all ramp vz {start[2]:.17g} {end[2]:.17g} z 0 {size[2]:.17g} sum yes units box
fix cell all deform 1 x trate {rates[0]:.17g} y trate {rates[1]:.17g} z trate {rates[2]:.17g} remap v
thermo {every}
run {steps}
"""
)


@dataclasses.dataclass(frozen=True)
class LammpsRun:
    """Records of LAMMPS while the cell deforms.

    Args:
        size: Sides of the cell, (record, 3), m.
        stress: Sum over all contact forces, (record, 3, 3), Pa, compression positive.
        seconds: Wall time of the loop, s.
        steps: Number of steps of the loop.
    """

    size: np.ndarray
    stress: np.ndarray
    seconds: float
    steps: int


def write_input(
    folder: str | os.PathLike[str],
    state: State,
    rates: np.ndarray,
    steps: int,
    settle: int,
    every: int,
    classes: int,
    tuning: Tuning = STANDARD,
) -> Path:
    """Write the LAMMPS data and input files for a State into a folder; return the input file.

    Raises InputError if the cell vectors are not those of LAMMPS, a triangular matrix.

    Args:
        folder: Folder to write to.
        state: The specimen.
        rates: Logarithmic strain rates of the cell, (3,), 1/s, expansion positive.
        steps: Number of steps.
        settle: Number of steps at rest before the deformation.
        every: Number of steps between records.
        classes: Number of grain-size classes.
        tuning: Settings that change the speed.
    """
    cell = state.cell
    if np.abs(np.tril(cell, -1)).max() > 1e-12 * cell.max():
        raise InputError("the cell of the specimen is rotated: use a specimen that has not been sheared")
    size, rates = np.diag(cell), np.asarray(rates, dtype=float)
    kind, middle = size_classes(state.radius, classes)
    data = Path(folder) / "grains.data"
    data.write_text(_grains(state, kind, classes))
    file = Path(folder) / "in.shear"
    file.write_text(
        INPUT.format(
            data=data,
            skin=tuning.skin * state.scene.mean_diameter,
            newton=tuning.newton,
            sort=tuning.sort,
            coefficients="\n".join(pair_coefficients(state.scene, middle)),
            time_step=state.time_step,
            settle=settle,
            every=every,
            steps=steps,
            size=size,
            rates=rates,
            start=-0.5 * rates * size,
            end=0.5 * rates * size,
        )
    )
    return file


def pair_coefficients(scene: Scene, radius: np.ndarray) -> list[str]:
    """Return the pair_coeff command of each pair of classes.

    The contact law is the spring-dashpot law.
    Raises InputError for beta_t without beta_n.

    Args:
        scene: Scene of the grains.
        radius: Radius of each class, (class,), in m.
    """
    lines = []
    for first, a in enumerate(radius):
        for second, b in enumerate(radius[first:], first):
            kn, kt, kr = (
                stiffness(a, b)
                for stiffness in (scene.normal_stiffness, scene.tangential_stiffness, scene.rolling_stiffness)
            )
            *_, cn, ct = SpringDashpot().tangents(scene, a, b, np.zeros(()))
            if cn == 0.0 < ct:
                raise InputError("LAMMPS does not support beta_t without beta_n: set beta_n above 0, or beta_t = 0")
            share = ct / cn if cn > 0.0 else 0.0
            rolling = kr / (a * b / (a + b)) ** 2
            lines.append(
                f"pair_coeff {first + 1} {second + 1} hooke {kn:.17g} {cn:.17g} "
                f"tangential linear_history {kt:.17g} {share:.17g} {scene.friction:.17g} "
                f"rolling sds {rolling:.17g} 0.0 {scene.rolling_friction:.17g} damping velocity"
            )
    return lines


def size_classes(radius: np.ndarray, classes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the class of each grain (grain,), from 0, and the midpoint radius of each class (classes,), m."""
    low, high = radius.min(), radius.max()
    width = (high - low) / classes
    kind = np.minimum(((radius - low) / width).astype(int), classes - 1) if width > 0.0 else np.zeros(len(radius), int)
    return kind, low + width * (np.arange(classes) + 0.5)


def _grains(state: State, kind: np.ndarray, classes: int) -> str:
    """Text of the data file: cell and grains."""
    cell = state.cell
    lines = [f"grains\n\n{state.number_of_grains} atoms\n{classes} atom types\n"]
    lines += [f"0.0 {length!r} {axis}lo {axis}hi" for axis, length in zip("xyz", np.diag(cell).tolist(), strict=True)]
    lines += ["{!r} {!r} {!r} xy xz yz".format(*cell[(0, 0, 1), (1, 2, 2)].tolist())]
    lines += ["\nAtoms # sphere\n"]
    position = np.mod(np.linalg.solve(cell, state.position.T).T, 1.0) @ cell.T
    grains = zip(kind.tolist(), state.radius.tolist(), position.tolist(), strict=True)
    for number, (of, radius, place) in enumerate(grains, 1):
        x, y, z = place
        lines.append(f"{number} {of + 1} {2.0 * radius!r} {state.scene.density!r} {x!r} {y!r} {z!r}")
    return "\n".join(lines) + "\n"


def deform(
    program: str,
    state: State,
    rates: np.ndarray,
    steps: int,
    settle: int,
    every: int,
    classes: int,
    tuning: Tuning = STANDARD,
) -> LammpsRun:
    """Run LAMMPS on one core; arguments as in write_input. Raises PhysicsError with LAMMPS's message if it fails."""
    with tempfile.TemporaryDirectory() as folder:
        file = write_input(folder, state, rates, steps, settle, every, classes, tuning)
        command = [program, "-in", str(file), "-log", "none"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    loops = re.findall(r"\n *Step .*\n((?:[ \d.e+-]+\n)+)Loop time of (\S+) on", done.stdout)
    if done.returncode or len(loops) != 2:
        raise PhysicsError(f"{program} ended with exit status {done.returncode}: {(done.stdout + done.stderr)[-300:]}")
    rows, seconds = loops[1]
    values = np.array([line.split() for line in rows.splitlines()], dtype=float)
    xx, yy, zz, xy, xz, yz = values[:, 4:].T
    stress = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
    return LammpsRun(values[:, 1:4], stress, float(seconds), steps)


def steps_per_second(program: str, state: State, rates: np.ndarray, steps: int, tuning: Tuning = STANDARD) -> float:
    """Measure the speed of LAMMPS on one core with one class of grains. Raises PhysicsError as `deform` does."""
    run = deform(program, state, rates, steps, max(1, steps // 5), steps, 1, tuning)
    return run.steps / run.seconds


def fastest(program: str, state: State, rates: np.ndarray, steps: int, rounds: int) -> Tuning:
    """The Tuning of TUNINGS with the highest speed in `rounds` alternating rounds of `steps` steps."""
    speeds = [
        (steps_per_second(program, state, rates, steps, tuning), number)
        for _ in range(rounds)
        for number, tuning in enumerate(TUNINGS)
    ]
    return TUNINGS[max(speeds)[1]]
