"""The first start of the fused engine compiles; later ones read machine code from files and import no Numba."""

import os
import shutil
import subprocess
import sys

import pytest

from tests.conftest import ROOT

pytestmark = pytest.mark.slow

PROGRAM = """
import hashlib, sys
from labkit.engines import fused
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
import numpy as np
grains = grains_in_cell(Scene(), np.full(2, 1e-4), np.array([[0, 0, 0], [0, 0, 1.9e-4]]), np.eye(3) * 1e-3)
engine = fused.FusedEngine(grains, precision=sys.argv[1])
engine.advance(100, np.diag([0.0, 0.0, 10.0]))
state = engine.state()
data = b"".join(part.tobytes() for part in (state.position, state.velocity, state.tangential_force, engine.stress()))
print(hashlib.sha256(data).hexdigest(), "numba" in sys.modules)
"""


def start(folder, precision="double"):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder)}
    pipes = dict.fromkeys(("stdout", "stderr"), subprocess.PIPE)
    return subprocess.Popen([sys.executable, "-c", PROGRAM, precision], cwd=ROOT, env=environment, text=True, **pipes)


def output(process):
    out, error = process.communicate()
    assert process.returncode == 0 and error == "", error
    return out.split()


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A folder with machine code in mixed precision, and the hash that the program prints."""
    folder = tmp_path_factory.mktemp("compiled")
    return folder, output(start(folder, "mixed"))[0]


def test_two_processes_with_an_empty_cache_agree_and_a_third_compiles_nothing(tmp_path):
    (first, _), (second, _) = [output(process) for process in [start(tmp_path) for _ in range(2)]]
    names = sorted(file.name for file in tmp_path.rglob("*.o"))
    assert output(start(tmp_path)) == [first, "False"] and first == second
    assert names == sorted(file.name for file in tmp_path.rglob("*.*"))  # nothing half-written


def test_a_second_process_compiles_what_all_laws_share(tmp_path):
    words = [sys.executable, "-P", "-m", "labkit.engines.kernel.ahead", "False", "True", "True", "False"]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(ROOT)}
    subprocess.run(words, env=environment, check=True)
    shared = {file.name for file in tmp_path.rglob("*.o")}
    output(start(tmp_path))
    further = {file.name for file in tmp_path.rglob("*.o")} - shared
    assert len(shared) == 4 and {name.partition("-")[0] for name in further} == {"forces", "stress"}


@pytest.mark.parametrize("left", [0, 100, -1])
def test_a_damaged_file_of_machine_code_is_compiled_again(left, compiled, tmp_path):
    folder, expected = compiled
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    (file,) = tmp_path.rglob("forces-*.o")
    whole = file.read_bytes()
    file.write_bytes(whole[:left])
    assert output(start(tmp_path, "mixed")) == [expected, "True"]
    assert len(file.read_bytes()) > 1000 and output(start(tmp_path, "mixed")) == [expected, "False"]


def test_without_a_folder_it_compiles_and_keeps_nothing(compiled):
    process = start("/proc/nowhere", "mixed")
    out, error = process.communicate()
    assert process.returncode == 0 and out.split() == [compiled[1], "True"] and "compiled anew" in error
