"""The first start of the fused engine: processes that compile the same kernel at once share the work."""

import os
import subprocess
import sys
from collections import Counter

import pytest

from labkit.grains.scene import Scene
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

PIECES = {"branch_force_rolling_resistance", "domain_grains", "search_is_due", "add_to_sites"}

PROGRAM = """
import hashlib, sys
from labkit.engines import fused
from labkit.engines.kernel.build import kernel_of
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
import numpy as np
grains = grains_in_cell(Scene(), np.full(2, 1e-4), np.array([[0, 0, 0], [0, 0, 1.9e-4]]), np.eye(3) * 1e-3)
engine = fused.FusedEngine(grains, precision=sys.argv[1])
engine.advance(100, np.diag([0.0, 0.0, 10.0]))
state, stats = engine.state(), kernel_of(Scene().contact_law, sys.argv[1] == "mixed").advance.stats
data = b"".join(part.tobytes() for part in (state.position, state.velocity, state.tangential_force, engine.stress()))
print(hashlib.sha256(data).hexdigest(), sum(stats.cache_misses.values()))
"""

HELPER = "import sys; from labkit.engines.kernel.precompiling import serve; serve(*sys.argv[1:])"


def start(folder, *words):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder)}
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    return subprocess.Popen([sys.executable, "-c", *words], cwd=ROOT, env=environment, text=True, **pipes)


def output(process):
    out, error = process.communicate()  # ends the standard input
    assert process.returncode == 0 and error == "", error
    return out.split()


def kept(folder):
    """Number of signatures kept of each function."""
    return Counter(file.name.split(".")[1].split("-")[0] for file in folder.rglob("*.nbc"))


def test_two_processes_with_an_empty_cache_compile_each_function_once(tmp_path):
    both = [output(process) for process in [start(tmp_path, PROGRAM, "double") for _ in range(2)]]
    (first, misses), (second, more) = both
    assert first == second and int(misses) + int(more) == 1
    number = kept(tmp_path)
    assert number["advance_rolling_resistance"] == 1
    assert {number[name] for name in PIECES} == {1}


def test_the_second_process_compiles_what_the_first_one_calls_in_mixed_precision(tmp_path):
    process = start(tmp_path, HELPER, Scene().to_json(), "1")
    process.wait()
    compiled = {name: number for name, number in kept(tmp_path).items() if name.split("_single")[0] in PIECES}
    output(start(tmp_path, PROGRAM, "mixed"))
    assert len(compiled) == len(PIECES) and compiled.items() <= kept(tmp_path).items()


def test_the_second_process_ends_with_the_first(tmp_path):
    process = start(tmp_path, HELPER, Scene().to_json(), "0")
    process.communicate()
    assert process.returncode == 0
    assert not PIECES & set(kept(tmp_path))
