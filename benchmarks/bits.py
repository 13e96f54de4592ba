"""Compares short tests bit by bit: do two versions of labkit compute the same numbers?

    python benchmarks/bits.py write before.json            # with the labkit that Python imports
    python benchmarks/bits.py compare before.json after.json
    python benchmarks/bits.py write some.json --only cp cv yade_cv

A case consists of a few labkit commands and the hashes of the variables in the file that the last one writes. The
hashes depend on the processor, Numba and NumPy. The cases yade_* and lammps_* need these programs; `--engines` adds
them, and compares the last values of their runs within a tolerance.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import math
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import llvmlite.binding
import netCDF4
import numba
import numpy as np

import labkit
from labkit.cli import main as labkit_command

GRAINS = 250
CELL = "--cell fixed" if hasattr(labkit.Recipe, "cell") else ""  # as all specimens of labkit before it had this field
LAWS = ("spring_dashpot", "springs_in_series", "hertz_mindlin", "hertz_mindlin_dashpot")
PATH_FILE = """\
path: steps
pressure: 300 kPa
steps:
  - {strain: {zz: 0.4 %}, stress: {xx: 0, yy: 0}, until: q/p > 0.5, records: 5}
  - repeat: 2
    steps:
      - {strain: {xz: 0.1 %}, stress: {zz: 0}, records: 3}
      - {strain: {xz: -0.1 %}, stress: {zz: 0}, records: 3}
  - {stress: {q: -30 kPa}, variables: roscoe, records: 3}
"""
DRIVER_TEST = """\
driver.out          # drained compression, undrained cycles, shear at constant p
*TriaxialE1 ? q > 100.0
100 10 1.0 : 10
-0.02
*Repetition
2 2
*TriaxialUq
50 10 0.5 : 10
-60.0
*TriaxialUq
50 10 0.5 : 10
60.0
*LinearLoad
100 10 1.0 : 10
*Roscoe
1 0.0
0 0.002
0 0.0
0 0.0
0 0.0
0 0.0
*End
"""
INITIAL = "6\n-200.0\n-200.0\n-200.0\n0.0\n0.0\n0.0\n1\n0.67\n"
STOPPED = """\
import os, labkit as lk
def stop(fraction, text):
    if fraction > 0.5:
        os.kill(os.getpid(), {signal})
path = lk.paths.ConstantMeanStress(pressure="300 kPa", strain=0.01, rate=100.0)
lk.run(lk.read_state("s.state.nc"), path, file="r.run.nc", progress=stop, record_strain=0.001, save_every=1)
"""

CP = "cp s.state.nc --pressure 300kPa --strain 0.01 --record-strain 0.001"


def run(words: str) -> list[str]:
    """Return the command of a test of the specimen s.state.nc at a high rate."""
    return [f"run {words} --engine fused --rate 100 -o r.run.nc"]


def specimen(words: str = "", void_ratio: float = 0.67) -> str:
    """Return the command that makes the specimen s.state.nc."""
    return f"specimen --void-ratio {void_ratio} --grains {GRAINS} --engine fused -o s.state.nc {CELL} {words}"


CASES = {
    # the paths of the paper
    "cv": run("cv s.state.nc --strain 0.01 --record-strain 0.001"),
    "cr": run("cr s.state.nc --pressure 300kPa --strain 0.01 --record-strain 0.001"),
    "cp": run(CP),
    "isoc": run("isoc s.state.nc --pressure 1MPa --record-strain 0.0005"),
    "isod": run("isod s.state.nc --pressure 300kPa --record-strain 0.0005"),
    "cyclic_cp": run("cyclic_cp s.state.nc --pressure 300kPa --reversals 0.004,-0.004,0.002 --record-strain 0.001"),
    # other element tests
    "c1": run("c1 s.state.nc --pressure 300kPa --strain 0.005 --record-strain 0.001"),
    "true_triaxial": run("true_triaxial s.state.nc --b 0.5 --pressure 300kPa --strain 0.005 --record-strain 0.001"),
    "lode_angle": run("true_triaxial s.state.nc --lode-angle 45 --pressure 300kPa --strain 0.005"),
    "plane_strain": run("plane_strain s.state.nc --pressure 300kPa --strain 0.005 --record-strain 0.001"),
    "oedometer": run("oedometer s.state.nc --strain 0.005 --record-strain 0.001"),
    "simple_shear": run("simple_shear s.state.nc --pressure 300kPa --strain 0.01 --record-strain 0.001"),
    "pure_shear": run("simple_shear s.state.nc --spin false --pressure 300kPa --strain 0.01 --record-strain 0.001"),
    "simple_shear_cv": run("simple_shear_cv s.state.nc --strain 0.01 --record-strain 0.001"),
    "stress_rotation": run("stress_rotation s.state.nc --pressure 300kPa --strain 0.01 --record-strain 0.001"),
    "proportional": run("proportional s.state.nc --ratios=-0.3,-0.2,1 --strain 0.005 --record-strain 0.001"),
    "mixed": run(
        "mixed s.state.nc --strain-rate 0,0,1,0,0,0 --free 1,0,0,0,0,0,0,1,0,0,0,0 "
        "--measured 1,0,0,0,0,0,0,1,0,0,0,0 --target 300kPa,250kPa --strain 0.005"
    ),
    # reloading and cycles
    "isotropic_reloading": run("isotropic_reloading s.state.nc --pressures 500kPa,300kPa,600kPa"),
    "oedometer_reloading": run("oedometer_reloading s.state.nc --stresses 500kPa,300kPa,600kPa"),
    "undrained_cycles": run("undrained_cycles s.state.nc --pressure 200kPa --amplitude 40kPa --cycles 2"),
    "undrained_cycles_by_ratio": run("undrained_cycles s.state.nc --pressure 200kPa --ratio 0.2 --cycles 1"),
    "drained_cycles": run("drained_cycles s.state.nc --pressure 200kPa --amplitude 40kPa --cycles 2"),
    "strain_cycles": run("strain_cycles s.state.nc --pressure 200kPa --strain-amplitude 0.002 --cycles 2"),
    "shear_cycles_by_stress": run("shear_cycles s.state.nc --pressure 200kPa --amplitude 30kPa --cycles 2"),
    "shear_cycles_by_strain": run(
        "shear_cycles s.state.nc --pressure 200kPa --strain-amplitude 0.002 --drained false --cycles 2"
    ),
    # steps from files
    "path_file": ["run phases.yaml s.state.nc --engine fused --rate 50 -o r.run.nc"],
    "driver": ["driver test.inp --on s.state.nc --initial initial.inp --engine fused --rate 100 -o r.run.nc"],
    # endings, rates and records of a run
    "stop_when": run(f"{CP} --stop-when 'q/p>0.4'"),
    "inertial_number": [f"run {CP} --engine fused --inertial-number 1e-2 -o r.run.nc"],
    "no_snapshots": run(f"{CP} --snapshots 0 --save-every 2"),
    # precision, threads, signals
    "mixed_cp": run(f"{CP} --precision mixed"),
    "mixed_undrained_cycles": run("undrained_cycles s.state.nc --pressure 200kPa --cycles 1 --precision mixed"),
    "two_threads": run(f"{CP} --threads 2"),
    "undisturbed": run(f"{CP} --save-every 1"),  # the next two cases must give the bits of this one
    "killed": ["SIGKILL", *run(f"{CP} --save-every 1")],
    "terminated": ["SIGTERM", *run(f"{CP} --save-every 1")],
    # specimens
    "insertion": [specimen("--seed 2")],
    "compression": [specimen("--preparation compression --pressure 200kPa")],
    "lognormal": [specimen("--grading 'lognormal median=0.2mm sigma=0.3 smallest=0.1mm largest=0.5mm'", 0.58)],
    "free_insertion": [specimen("--cell free")],  # these two are not computed where labkit has no free cell
    "free_consolidation": ["consolidate s.state.nc --pressure 400kPa --cell free --engine fused -o c.state.nc"],
    "consolidation": ["consolidate s.state.nc --pressure 400kPa --engine fused -o c.state.nc"],
    "friction": [specimen("--friction 0.2 --rolling-friction 0")],
    **{f"law_{law}": [specimen(f"--law {law}", 0.6), *run(CP)] for law in LAWS},
    "mixed_law_hertz_mindlin": [specimen("--law hertz_mindlin", 0.6), *run(f"{CP} --precision mixed")],
    # clumps
    "clumps": [specimen("--shape rod --rolling-friction 0", 0.5), *run(CP)],
    "clumps_mixed": [specimen("--shape 'tetrapod, sphere' --rolling-friction 0", 0.5), *run(f"{CP} --precision mixed")],
    # probes
    "elastic_probe": ["probe s.state.nc --elastic --directions 4 --engine fused -o p.probes.nc"],
    # the constitutive model
    "model_cp": ["model cp --void-ratio 0.67 --pressure 300kPa --strain 0.1 -o m.run.nc"],
    "model_cv": ["model cv --void-ratio 0.67 --pressure 300kPa --strain 0.1 -o m.run.nc"],
    "model_undrained_cycles": ["model undrained_cycles --void-ratio 0.67 --pressure 300kPa --cycles 3 -o m.run.nc"],
    "model_path_file": ["model phases.yaml --void-ratio 0.67 --pressure 300kPa -o m.run.nc"],
    "model_driver": ["driver test.inp --on model --initial initial.inp -o m.run.nc"],
    # other engines, if named
    "yade_cv": ["run cv s.state.nc --strain 0.01 --record-strain 0.001 --engine yade --rate 100 -o r.run.nc"],
    "yade_cp": [f"run {CP} --engine yade --rate 100 -o r.run.nc"],
    "yade_specimen": [f"specimen --void-ratio 0.67 --grains 250 --engine yade -o s.state.nc {CELL}"],
    "yade_clumps": [
        specimen("--shape rod --rolling-friction 0", 0.5),
        f"run {CP} --engine yade --rate 100 -o r.run.nc",
    ],
    "lammps_cv": [
        specimen("--law spring_dashpot --size-classes 5"),
        "run cv s.state.nc --strain 0.01 --record-strain 0.001 --engine lammps --rate 100 -o r.run.nc",
    ],
    "lammps_cp": [
        specimen("--law spring_dashpot --size-classes 5"),
        f"run {CP} --engine lammps --rate 100 -o r.run.nc",
    ],
}
OTHER_ENGINES = ("yade_", "lammps_")
LAST = ("volume", "void_ratio_nominal", "coordination_number", "stress")  # values of the last record to store
TOLERANCE = 1e-6  # relative difference of these values that `compare` accepts from another engine


def write(file: Path, names: Sequence[str]) -> None:
    """Compute cases and write their hashes as JSON, with the versions and the processor that they depend on."""
    with tempfile.TemporaryDirectory() as scratch:
        common = Path(scratch) / "s.state.nc"
        with contextlib.chdir(scratch):
            command(specimen())
        cases = {}
        for name in names:
            folder = Path(scratch) / name
            folder.mkdir()
            start = time.perf_counter()
            try:
                cases[name] = compute(name, folder, common)
            except Exception as error:  # the other cases are still computed
                print(f"{name}: {type(error).__name__}: {error}", flush=True)
                continue
            print(f"{name:28} {str(cases[name]['data_sha256'])[:16]} {time.perf_counter() - start:6.1f} s", flush=True)
    file.write_text(json.dumps({"made_with": surroundings(), "cases": cases}, indent=1) + "\n")


def compute(name: str, folder: Path, common: Path) -> dict[str, object]:
    """Carry out the commands of a case in a folder; return the hashes of the file written last."""
    shutil.copy(common, folder)
    for file, text in {"phases.yaml": PATH_FILE, "test.inp": DRIVER_TEST, "initial.inp": INITIAL}.items():
        (folder / file).write_text(text)
    with contextlib.chdir(folder):
        for words in CASES[name]:
            if words in ("SIGKILL", "SIGTERM"):
                stop_by(signal.Signals[words])
            else:
                command(words)
    written = max(folder.glob("*.nc"), key=lambda file: file.stat().st_mtime_ns)
    return hashes(written)


def command(words: str) -> None:
    """Run a labkit command in this process. Raises RuntimeError with its output if it fails."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        code = labkit_command(shlex.split(words))
    if code != 0:
        raise RuntimeError(f"labkit {words}: exit code {code}\n{output.getvalue()}")


def stop_by(number: signal.Signals) -> None:
    """Start the run of STOPPED in another process, which sends itself a signal halfway."""
    ended = subprocess.run([sys.executable, "-c", STOPPED.format(signal=number.value)], capture_output=True, text=True)
    if ended.returncode == 0 or not Path("r.run.nc").exists():
        raise RuntimeError(f"the run was not stopped by {number.name}: {ended.stderr}")


def hashes(file: Path) -> dict[str, object]:
    """Return data_sha256, a hash of each variable, and some values of the last record of a netCDF file."""
    with netCDF4.Dataset(file) as data:
        variables = {}
        for group in (data, *(group for name, group in data.groups.items() if name != "checkpoint")):
            for name in set(group.variables) - {"i", "j"}:  # labels of components
                variable = group[name]
                values = np.ascontiguousarray(np.ma.getdata(variable[...]))
                variables[f"{group.path}/{name}".replace("//", "/")] = hashlib.sha256(values.tobytes()).hexdigest()[:16]
        recorded = [name for name in LAST if "time" in data.dimensions and name in data.variables]
        last = {name: np.ravel(data[name][-1]).tolist() for name in recorded}
        return {"data_sha256": data.data_sha256, "variables": dict(sorted(variables.items())), "last": last}


def surroundings() -> dict[str, str]:
    """Return what the bits depend on: versions of labkit, Numba and NumPy, and the processor."""
    source = Path(labkit.__file__).parents[1]
    described = subprocess.run(["git", "-C", source, "rev-parse", "HEAD"], capture_output=True, text=True)
    versions = {"labkit": labkit.__version__, "numba": numba.__version__, "numpy": np.__version__}
    return {
        "commit": described.stdout.strip(),
        **versions,
        "python": platform.python_version(),
        "processor": llvmlite.binding.get_host_cpu_name(),
    }


def compare(before: Path, after: Path) -> int:
    """Print the differences between two files of `write`; return 1 if bits differ that must not, else 0."""
    one, other = (json.loads(file.read_text()) for file in (before, after))
    for name, value in one["made_with"].items():
        if other["made_with"][name] != value:
            print(f"{name}: {value} -> {other['made_with'][name]}")
    differences = 0
    for name, case in one["cases"].items():
        if name not in other["cases"]:
            print(f"{name}: not computed")
            continue
        message = difference(case, other["cases"][name], name.startswith(OTHER_ENGINES))
        if message:
            differences += 1
            print(f"{name}: {message}")
    same = len(one["cases"].keys() & other["cases"].keys()) - differences
    print(f"{same} cases are equal, {differences} differ")
    return 1 if differences else 0


def difference(case: dict[str, Any], again: dict[str, Any], tolerant: bool) -> str:
    """Describe the unacceptable differences between two results of a case; empty if there are none."""
    if case["data_sha256"] == again["data_sha256"]:
        return ""
    old, new = case["variables"], again["variables"]
    changes = [f"{name} gone" for name in old if name not in new] + [f"{name} new" for name in new if name not in old]
    changes += [name for name in old if name in new and old[name] != new[name]]
    largest = max((spread(case["last"][name], again["last"].get(name)) for name in case["last"]), default=math.inf)
    if tolerant and largest < TOLERANCE:
        return ""
    listed = ", ".join(changes[:6]) + (f" and {len(changes) - 6} more" if len(changes) > 6 else "")
    return f"{listed or 'type or shape of a variable'}; last record within {largest:.1e}"


def spread(one: list[float], other: list[float] | None) -> float:
    """Largest difference of the values of a variable, divided by the largest value."""
    if other is None or len(one) != len(other):
        return math.inf
    return float(np.abs(np.subtract(one, other)).max() / max(np.abs(one).max(), 1e-300))


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    writing = commands.add_parser("write")
    writing.add_argument("file", type=Path)
    writing.add_argument("--only", nargs="+", default=[], metavar="CASE", choices=list(CASES))
    writing.add_argument("--engines", action="store_true", help="also the cases of YADE and LAMMPS")
    comparing = commands.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    options = parser.parse_args()
    if options.command == "compare":
        return compare(options.before, options.after)
    own = [name for name in CASES if options.engines or not name.startswith(OTHER_ENGINES)]
    write(options.file, options.only or own)
    return 0


if __name__ == "__main__":
    sys.exit(main())
