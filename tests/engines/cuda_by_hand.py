"""Checks of the cuda engine that are too slow for the tests, or need numba-cuda; none needs a GPU.

python tests/engines/cuda_by_hand.py compile                    # all laws, and one of a user, for an H100
NUMBA_ENABLE_CUDASIM=1 python tests/engines/cuda_by_hand.py run  # a CP test, records against `fused`; some minutes
NUMBA_ENABLE_CUDASIM=1 python tests/engines/cuda_by_hand.py campaign  # killed and resumed, some minutes

`compile` needs numba-cuda[cu12].
"""

import itertools
import re
import subprocess
import sys
import tempfile
import time
import types
from pathlib import Path

import netCDF4
import numba
import numpy as np

import labkit
from labkit.grains.laws import LAWS

CAPABILITY = (9, 0)  # compute capability of an H100


def compile_all():
    """Compile each kernel to PTX, and with ptxas to machine code; print the registers per thread and the spills."""
    import nvidia.cuda_nvcc
    from numba import cuda
    from numba.cuda import dispatcher

    from labkit.engines.cuda import arrays, build, servo
    from labkit.engines.cuda.memory import KINDS

    dispatcher.get_current_device = lambda: types.SimpleNamespace(compute_capability=CAPABILITY)
    arrays.cuda = types.SimpleNamespace(to_device=np.asarray)  # only the types of the arrays matter
    arrays.zeros = servo.zeros = np.zeros
    first, count = np.array([0, 128]), np.array([100, 100])
    known = {
        "states": arrays.new_states(first, count, 9),
        "grains": arrays.new_grains(np.array([0, 1])),
        "grid": arrays.new_grid(count, 256),
        "moving": 1.0,
        "sums": np.zeros((2, 9)),
        "totals": np.zeros((2, 9)),
        "plans": servo.new_plans(2, 4),
        "every": 1,
    }
    ptxas = Path(next(iter(nvidia.cuda_nvcc.__path__))) / "bin/ptxas"
    labkit.use("examples/own_law.py")
    for law, precision in itertools.product([law for law in LAWS if not LAWS[law]().keeps_links], ("double", "mixed")):
        scene = labkit.Scene(law=law)
        known["lists"] = arrays.new_lists(2, 256, KINDS[precision])
        kernels = build.kernels_of(type(scene.contact_law), build.shape_of(scene), precision == "mixed")
        for name, kernel in kernels._asdict().items():
            arguments = kernel.py_func.__code__.co_varnames[: kernel.py_func.__code__.co_argcount]
            signature = numba.void(*(numba.typeof(known[argument]) for argument in arguments))
            code, _ = cuda.compile_ptx(kernel.py_func, signature, cc=CAPABILITY)
            print(f"{law:22} {precision:7} {name:18} {resources(ptxas, code)}", flush=True)


def resources(ptxas, code):
    """Registers per thread and spills of a kernel in PTX, and how many of its instructions are in double precision."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "kernel.ptx"
        file.write_text(code)
        words = [ptxas, "-arch=sm_90", "-v", file, "-o", f"{file}.cubin"]
        said = subprocess.run(words, capture_output=True, text=True, check=True).stderr
    registers, spills = re.search(r"(\d+) registers", said)[1], re.search(r"(\d+) bytes spill stores", said)[1]
    kinds = [len(re.findall(rf"^\s*(?:add|sub|mul|fma|div|sqrt)\.\S*{kind}", code, re.M)) for kind in ("f64", "f32")]
    return f"{registers:>4} registers, {spills} bytes of spills, {kinds[0]} double and {kinds[1]} single operations"


def run():
    """Print the largest difference of each recorded quantity from that of `fused`, over its largest value."""
    scene = labkit.Scene(law="spring_dashpot")
    state = labkit.make_specimen(labkit.Recipe(0.67, 0.15, grains=100), scene, progress=False)
    pressure = float(np.trace(labkit.love_stress(state.snapshot()))) / 3.0
    path = labkit.paths.ConstantMeanStress(pressure=pressure, strain=6.5e-4, rate=100.0)
    cuda, fused = (
        labkit.run(state, path, engine=engine, progress=False, record_strain=3.25e-4, snapshots=1).data
        for engine in ("cuda", "fused")
    )
    for name in fused:
        a, b = cuda[name].values, fused[name].values
        if a.dtype.kind == "f":
            print(f"{name:28} {np.nanmax(np.abs(a - b)) / max(np.nanmax(np.abs(b)), 1e-300):.1e}")


CAMPAIGN = """\
engine: cuda
law: spring_dashpot
snapshots: 1
save_every: 1
specimens:
  a: {void_ratio: 0.67, grains: 100, seed: [1, 2], engine: fused}
runs:
  cv: {path: cv, specimen: a, strain: 1.24e-3, rate: 200, record_strain: 3.1e-4}
  wild: {path: cv, specimen: a, strain: 0.01, rate: 20, time_step_factor: 9}
"""


def campaign():
    """Kill a campaign while its batch runs, start it again, and compare its runs with those of an undisturbed one.

    The two runs `wild` fail, because their time step is too large.
    """
    folder = Path(tempfile.mkdtemp(prefix="labkit-"))
    (folder / "c.yaml").write_text(CAMPAIGN)
    command = [sys.executable, "-m", "labkit.cli", "campaign", "c.yaml", "--cores", "1", "--folder"]
    print(subprocess.run([*command, "whole"], cwd=folder, check=False).returncode, "expected: 1")
    first = subprocess.Popen([*command, "killed"], cwd=folder)
    unfinished = folder / "killed/unfinished"
    while len(list(unfinished.glob("*.run.nc"))) < 2 or min(map(records, unfinished.glob("*.run.nc"))) < 3:
        time.sleep(0.2)
    first.kill()
    first.wait()
    for file in sorted(unfinished.glob("*.run.nc")):
        print(file.name, records(file), "of", records(folder / f"whole/runs/{file.name.split('.')[0]}.run.nc"))
    print(subprocess.run([*command, "killed"], cwd=folder, check=False).returncode, "expected: 1")
    for file in sorted((folder / "whole/runs").glob("*.run.nc")):
        hashes = [labkit.open_run(one).attrs["data_sha256"] for one in (file, folder / "killed/runs" / file.name)]
        print(file.name, "same bits" if hashes[0] == hashes[1] else "DIFFERENT")


def records(file):
    """Number of records in a run file."""
    with netCDF4.Dataset(file) as dataset:
        return len(dataset.dimensions["time"])


if __name__ == "__main__":
    {"compile": compile_all, "run": run, "campaign": campaign}[sys.argv[1]]()
