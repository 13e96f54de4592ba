"""The scene of `labkit bench` for LAMMPS: pair style granular with the same grains, stiffness, friction and rolling.

LAMMPS has one stiffness for all pairs: that of two mean grains. Energy leaves through its normal dashpot.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from labkit.errors import InputError, PhysicsError

SKIN = 0.05  # of the mean diameter: the fastest of 0.02 to 0.2 on the full specimen
DASHPOT = 0.2  # of the critical damping of a mean pair

INPUT = """\
units si
atom_style sphere
boundary p p p
comm_modify vel yes
newton off
read_data {data}
neighbor {skin:.17g} bin
neigh_modify every 1 delay 0 check yes
pair_style granular
pair_coeff * * hooke {kn:.17g} {damping:.17g} tangential linear_history {kt:.17g} 0.0 {friction:.17g} &
    rolling sds {kr:.17g} 0.0 {rolling:.17g} damping velocity
fix motion all nve/sphere
fix cell all deform 1 x trate {x:.17g} y trate {y:.17g} z trate {z:.17g} remap v
timestep {dt:.17g}
thermo_style custom step atoms pxx pzz
thermo {warm}
run {warm}
run {steps}
"""


def write_input(folder, state, rates, steps):
    """Writes data and input file of a State into a folder; returns the input file. rates (3,): of the cell, 1/s.

    Raises InputError for a cell that is no box.
    """
    cell = state.cell
    if np.abs(cell - np.diag(np.diag(cell))).max() > 1e-12 * cell.max():
        raise InputError("the specimen's cell is not rectangular: bench a specimen, not a sheared state")
    scene = state.scene
    mean = 0.5 * scene.mean_diameter
    kn, kt = scene.normal_stiffness(mean, mean), scene.tangential_stiffness(mean, mean)
    size = np.diag(cell)
    lines = [f"grains\n\n{state.number_of_grains} atoms\n1 atom types\n"]
    lines += [f"0.0 {length!r} {axis}lo {axis}hi" for axis, length in zip("xyz", size.tolist())]
    lines += ["\nAtoms # sphere\n"]
    position = np.mod(state.position, size)
    for number, (radius, place) in enumerate(zip(state.radius.tolist(), position.tolist()), 1):
        lines.append(f"{number} 1 {2.0 * radius!r} {scene.density!r} " + " ".join(map(repr, place)))
    data = Path(folder) / "grains.data"
    data.write_text("\n".join(lines) + "\n")
    file = Path(folder) / "in.shear"
    file.write_text(INPUT.format(
        data=data, skin=SKIN * scene.mean_diameter, kn=kn, kt=kt, kr=scene.rolling_stiffness(mean, mean),
        damping=2.0 * DASHPOT * np.sqrt(0.5 * scene.mass(mean) * kn), friction=scene.friction,
        rolling=scene.rolling_friction * mean / 2.0, x=rates[0], y=rates[1], z=rates[2], dt=state.time_step,
        warm=max(1, steps // 5), steps=steps,
    ))  # fmt: skip
    return file


def steps_per_second(program, state, rates, steps):
    """Speed of LAMMPS on one core. Raises PhysicsError with its message when it fails."""
    with tempfile.TemporaryDirectory() as folder:
        command = [program, "-in", str(write_input(folder, state, rates, steps)), "-log", "none"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    loops = re.findall(r"Loop time of (\S+) on", done.stdout)
    if done.returncode or len(loops) != 2:
        raise PhysicsError(f"{program} ended with exit status {done.returncode}: {(done.stdout + done.stderr)[-300:]}")
    return steps / float(loops[1])
