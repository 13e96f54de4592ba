"""The compiled functions of the laws: those of plain Python, kept for labkit's laws, and never for a user's."""

import os
import runpy
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import labkit.model
from analysis.peers.sanisand import Sanisand
from labkit.model import Model, RateLaw, isotropic_state, model_path
from labkit.model.compiled import SOURCES, entry
from labkit.model.controls import control_of, strain_control
from labkit.model.integrators import Adaptive, Problem
from labkit.model.rates import FINE, WORK, rates
from labkit.model.tensors import trace
from labkit.paths.step import Here
from labkit.sff import c0
from tests.conftest import ROOT

SHEAR = strain_control(np.diag([-0.4, -0.5, 1.0]))
HELD = control_of(next(iter(model_path("cp", 2e5).steps_from(Here(2e5 * np.eye(3))))))


@pytest.mark.slow
@pytest.mark.parametrize("control", [SHEAR, HELD], ids=["prescribed", "held"])
@pytest.mark.parametrize("kind", [Model, Sanisand], ids=lambda kind: kind.name)
def test_compiled_rates_are_those_of_plain_python(kind, control):
    law = kind()
    own = isinstance(law, Model)
    y = isotropic_state(law, 0.67, 2e5).vector() if own else law.start(0.75, 2e5 * np.eye(3))
    y = Adaptive().advance(Problem(law, SHEAR, law.floor(y)), y, 1e-3)
    found, expected = Problem(law, control, law.floor(y)).rates(y), np.empty(y.size)
    x = np.zeros(control.free.shape[1])
    assert rates(y, control, x, law.constants, expected, np.empty(WORK)) == FINE
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


def test_the_stamp_covers_the_whole_model():
    files = {*Path(labkit.model.__file__).parent.rglob("*.py"), Path(c0.__file__)}
    assert len(files) > 15 and files <= SOURCES


def test_the_stamp_covers_the_file_of_an_entry_outside_the_model(tmp_path):
    stamps = set()
    for number in range(2):
        file = tmp_path / f"{number}" / "mine.py"
        file.parent.mkdir()
        file.write_text(f"def answer(y: 'Pointer') -> int:\n    return {number}\n")
        stamps.add(entry(runpy.run_path(str(file))["answer"]).stamp(type(Model().constants)))
    assert len(stamps) == 2


class Fragile(RateLaw):
    """A law that is linear, and that fails in dilation."""

    name = "fragile"
    parameters: ClassVar = {"K": (80e6, 0.0, 1e12)}

    @staticmethod
    def rates(y, D, compressing, c, out):
        if trace(D) < 0.0:
            raise ArithmeticError("no dilation")
        work = np.zeros(6)  # a user's law may allocate memory
        work[:3] = c.K * trace(D)
        out[:7] = 0.0
        out[1:7] = work
        return FINE


@pytest.mark.slow
def test_a_users_law_is_not_kept_and_its_exceptions_arrive(monkeypatch, tmp_path):
    monkeypatch.setattr("labkit.engines.kernel.machine.compiled_folder", lambda: tmp_path)  # others write to the usual
    law = Fragile()
    y = law.start(0.7, 1e5 * np.eye(3))
    end = Adaptive().advance(Problem(law, strain_control(np.eye(3)), law.floor(y)), y, 1e-3)
    np.testing.assert_allclose(law.stress(end), (1e5 + 80e6 * 3e-3) * np.eye(3), rtol=1e-9)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ArithmeticError, match="no dilation"):
        Adaptive().advance(Problem(law, strain_control(-np.eye(3)), law.floor(y)), y, 1e-3)


def test_a_state_of_another_law_is_refused():
    problem = Problem(Model(), SHEAR)
    with pytest.raises(ValueError, match="a state of 40 numbers, for a law of 27"):
        problem.rates(np.zeros(40))


PROGRAM = """
import sys
from labkit.model import Model, drive, isotropic_state, model_path
result = drive(Model(), model_path("cp", 5e5, strain=0.01), isotropic_state(Model(), 0.67, 5e5)).require()
print(result.vector.tobytes().hex(), "numba" in sys.modules)
"""


@pytest.mark.slow
def test_two_processes_with_an_empty_cache_agree_and_a_third_imports_no_numba(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}

    def start():
        words = [sys.executable, "-c", PROGRAM]
        return subprocess.Popen(words, cwd=ROOT, env=environment, text=True, stdout=subprocess.PIPE)

    first, second = [process.communicate()[0].split() for process in [start() for _ in range(2)]]
    third = start().communicate()[0].split()
    assert first[0] == second[0] == third[0] and third[1] == "False"
    assert sorted(file.suffix for file in (tmp_path / "labkit").iterdir()) == [".o", ".o"]


@pytest.mark.slow
def test_the_stress_of_a_state_needs_no_other_import():
    program = "from labkit.model import Model; import numpy as np; print(Model().stress(np.ones(27))[0, 0])"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, text=True, capture_output=True, check=True)
    assert float(done.stdout) == Model().stress(np.ones(27))[0, 0]
