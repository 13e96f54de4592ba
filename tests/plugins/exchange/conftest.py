"""Files of other programs: written by YADE and LAMMPS themselves from a sheared state, or by hand."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import labkit as lk
from labkit.grains.state_file import write_state
from labkit.plugins.exchange import FORMATS
from tests.conftest import PATIENCE

IN_YADE = Path(__file__).resolve().parents[2] / "engines/in_yade"

INPUT = """
units si
atom_style sphere
comm_modify vel yes
newton off
atom_modify map array
read_data sheared.data
pair_style granular
pair_coeff * * hooke 20000.0 0.0 tangential linear_history 10000.0 0.0 0.5 damping velocity
neighbor 3e-5 bin
timestep 1e-7
fix motion all nve/sphere
compute f all pair/local dist force fx fy fz p1 p2 p3 cutoff radius
compute i all property/local patom1 patom2 cutoff radius
compute s all pressure NULL virial
thermo_style custom step c_s[1] c_s[2] c_s[3] c_s[4] c_s[5] c_s[6]
thermo_modify format float %20.15g
run 100
dump g all custom 100 grains.dump id type x y z diameter
dump s all custom 100 scaled.dump id type xs ys zs radius
dump c all local 100 contacts.local index c_i[1] c_i[2] c_f[1] c_f[2] c_f[3] c_f[4] c_f[5] c_f[6] c_f[7] c_f[8]
dump_modify g sort id format float %20.15g
dump_modify s sort id format float %20.15g
dump_modify c format float %20.15g
run 0
write_data final.data
"""


@pytest.fixture(scope="session")
def straight(tmp_path_factory):
    """About 300 grains after 0.5 % of shear in a cuboid, with grains outside of it."""
    file = tmp_path_factory.mktemp("sheared") / "cv.run.nc"
    state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=300, cell="fixed"), lk.Scene(), progress=False)
    lk.run(state, lk.paths.ConstantVolume(strain=0.005), file=file, progress=False).data.close()
    return lk.read_state(file)


@pytest.fixture(scope="session")
def sheared(straight):
    """The same grains, turned, and with an equivalent cell that is tilted by one cell vector."""
    turn, _ = np.linalg.qr(np.array([[0.9, 0.1, 0.3], [-0.2, 1.0, 0.1], [-0.2, 0.1, 0.8]]))
    turn *= np.sign(np.linalg.det(turn))
    names = ("position", "velocity", "angular_velocity", "tangential_force", "rolling_moment")
    rotated = {name: getattr(straight, name) @ turn.T for name in names}
    cell, shift = turn @ straight.cell, straight.contact_shift.copy()
    cell[:, 1] += cell[:, 0]
    shift[:, 0] -= shift[:, 1]
    return straight.replace(cell=cell, contact_shift=shift, **rotated)


@pytest.fixture(scope="session")
def yade_files(straight, tmp_path_factory):
    """(folder, results): files that YADE wrote after it had loaded an exported script, and its own stress."""
    folder = tmp_path_factory.mktemp("yade")
    write_state(folder / "s.state.nc", straight)
    FORMATS["yade_script"]().write(straight, folder / "load.py")
    output = folder / "result.json"
    command = ["yade", "-n", "-x", IN_YADE / "write_files.py", output, folder / "load.py", folder]
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder, json.loads(output.read_text())


@pytest.fixture(scope="session")
def lammps_files(straight, tmp_path_factory):
    """(folder, stress): dumps and data that LAMMPS wrote after it had read an exported data file, and its virial."""
    if shutil.which("lmp") is None:
        pytest.skip("LAMMPS is not installed: apt-get install lammps")
    folder = tmp_path_factory.mktemp("lammps")
    gradient = np.eye(3)
    gradient[0, 1], gradient[0, 2], gradient[1, 2] = 0.1, -0.05, 0.02  # a triclinic box; LAMMPS finds the contacts
    position, cell = straight.position @ gradient.T, gradient @ straight.cell
    FORMATS["lammps_data"]().write(straight.replace(position=position, cell=cell), folder / "sheared.data")
    (folder / "in.lmp").write_text(INPUT)
    done = subprocess.run(["lmp", "-in", "in.lmp", "-log", "none"], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    last = [line.split() for line in done.stdout.splitlines() if line.split()[:1] == ["100"]][-1]
    return folder, np.array([float(word) for word in last[1:]])
