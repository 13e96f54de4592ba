"""Simulations need no library but NumPy (and llvmlite, which loads machine code), as in a browser."""

import hashlib
import json
import subprocess
import sys

import numpy as np
import pytest

import labkit as lk
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

PROGRAM = """
import sys

class Only:
    def find_spec(name, path=None, target=None):
        if path is None and name not in {*sys.stdlib_module_names, "labkit", "numpy", "llvmlite"}:
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Only)
import hashlib, json
import labkit as lk
import labkit.cli.simulate
from labkit.simulation.tasks import RunTask, execute

state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=200), progress=False)
path = lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.002, rate=100.0)
task = RunTask(state=state, path=path, options=lk.Options(0.001), device=lk.Fused(), output=None)
execute(task, lambda fraction, text: None)
last = task.memory.state.snapshot()
records = list(task.memory.recordings.records.values())
print(json.dumps({
    "specimen": hashlib.sha256(state.position.tobytes()).hexdigest(),
    "end": hashlib.sha256(task.memory.state.position.tobytes()).hexdigest(),
    "Z": [lk.statistics(last).coordination_number, float(records[-1]["coordination_number"])],
    "love": lk.love_stress(last).tolist(),
    "c0": [lk.sff_stress(last).tolist(), records[-1]["stress_sff"].tolist()],
}))
"""


def test_a_specimen_a_run_and_its_statistics_need_only_numpy(loose_specimen):
    words = [sys.executable, "-W", "ignore", "-c", PROGRAM]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    alone = json.loads(done.stdout)
    path = lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.002, rate=100.0)
    run = lk.run(loose_specimen, path, progress=False, record_strain=0.001)
    positions = {"specimen": loose_specimen, "end": run.state}
    hashes = {name: hashlib.sha256(state.position.tobytes()).hexdigest() for name, state in positions.items()}
    assert {name: alone[name] for name in positions} == hashes
    assert alone["Z"] == [float(run.data["coordination_number"][-1])] * 2
    np.testing.assert_allclose(alone["love"], run.data["stress"][-1], rtol=1e-9, atol=1e-6)
    for c0 in alone["c0"]:
        np.testing.assert_allclose(c0, run.data["stress_sff"][-1], rtol=1e-9, atol=1e-6)
