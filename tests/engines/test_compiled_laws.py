"""Machine code of users' laws: code that could fail is refused, and stale code is never used."""

import math
import os
import subprocess
import sys
import types

import llvmlite.binding as llvm
import numpy as np
import pytest

import labkit as lk
from labkit.engines.fused import needs_of
from labkit.engines.kernel import blocks, frozen, machine, object_code
from labkit.engines.kernel.sources import stamp_of
from labkit.errors import InputError
from labkit.grains.laws import LAWS
from tests.conftest import ROOT

TABLE, ARRAY, LIMIT = (1.0,) * 12, np.ones(12), 1e3


def check(overlap):
    assert overlap < LIMIT
    return 0.0


def allocate(stiffness, overlap):
    terms = np.zeros(2)
    terms[0] = stiffness * overlap
    return terms[0] + terms[1]


def show(stiffness, overlap):
    if overlap > LIMIT:
        print("deep")
    return stiffness * overlap


FAILING = {
    "an array": allocate,
    "a dict": lambda stiffness, overlap: stiffness * overlap * {0: 1.0}[0],
    "print": show,
    "an index of a tuple": lambda stiffness, overlap: stiffness * overlap * TABLE[int(overlap / 2e-6)],
    "an index of an array": lambda stiffness, overlap: stiffness * overlap * ARRAY[int(overlap / 2e-6)],
    "an assert in a callee": lambda stiffness, overlap: stiffness * overlap + check(overlap),
    "an empty list": lambda stiffness, overlap: stiffness * overlap + ([][0] if overlap > LIMIT else 0.0),
}
SAFE = {
    "a limited index": lambda stiffness, overlap: stiffness * overlap * ARRAY[min(max(int(overlap / 2e-6), 0), 11)],
    "integer division": lambda stiffness, overlap: stiffness * overlap * (1 + 0 * (5 // (int(overlap) + 1))),
    "functions of math": lambda stiffness, overlap: stiffness * math.sinh(overlap) ** 1.5 + math.atan2(overlap, 1.0),
}


def law_of(force, name="own"):
    """A law whose spring has the force of a function."""
    function = {"force": staticmethod(force), "energy": staticmethod(lambda stiffness, d: 0.5 * stiffness * d * d)}
    spring = type("Spring", (lk.laws.LinearSpring,), function)
    parts = spring() + lk.laws.Coulomb() + lk.laws.LocalDamping()
    return type("Own", (lk.ContactLaw,), {"name": name, "parts": parts})()


def functions_of(law):
    """The code for Numba of the forces of a law with default parameters."""
    scene = lk.Scene(law="spring_dashpot", rolling_friction=0.0)
    needs = blocks.Needs(law.composition(scene), law.numbers(scene), False, True, True, False)
    return blocks.law_functions(law, needs)[0][1]()


@pytest.mark.slow
@pytest.mark.parametrize("kind", FAILING)
def test_code_that_could_fail_is_refused_before_it_runs(kind):
    law = law_of(FAILING[kind])
    with pytest.raises(InputError, match="contact law own cannot be compiled"), blocks.explain_refusal(law):
        machine.address_of("forces", lambda: functions_of(law), None)


@pytest.mark.slow
@pytest.mark.parametrize("kind", SAFE)
def test_code_that_cannot_fail_is_compiled(kind):
    assert machine.address_of("forces", lambda: functions_of(law_of(SAFE[kind])), None)


# --- the code from LLVM ---------------------------------------------------------------------------------------------

MODULE = """
declare double @{outside}(double)
declare void @PyErr_Clear()
define i32 @inner(double %x, double* %result) noinline {{
  %y = call double @{outside}(double %x)
  store double %y, double* %result
  ret i32 {status}
}}
define double @"cfunc.f"(double %x) {{
  %result = alloca double
  %status = call i32 @inner(double %x, double* %result)
  %good = icmp eq i32 %status, 0
  br i1 %good, label %end, label %report
report:
  call void @PyErr_Clear()
  br label %end
end:
  %y = load double, double* %result
  ret double %y
}}
"""


def module(outside="cos", status="0"):
    parsed = llvm.parse_assembly(MODULE.format(outside=outside, status=status))
    machine.target_processor()
    return parsed


def test_only_the_renamed_function_is_visible():
    changed = module()
    object_code.only_visible(changed, "cfunc.f", "f")
    visible = [one.name for one in changed.functions if one.linkage == llvm.Linkage.external and not one.is_declaration]
    assert visible == ["f"]


@pytest.mark.parametrize(("status", "left"), [("0", []), ("1", ["PyErr_Clear"])])
def test_reports_are_removed_if_the_status_is_always_0(status, left):
    changed = module(status=status)
    object_code.only_visible(changed, "cfunc.f", "f")
    object_code.remove_reports(changed, machine.new_machine())
    assert object_code.needed_by(changed) == left


@pytest.mark.parametrize("outside", ["NRT_Allocate", "labkit_unused", "cosine"])
def test_a_function_that_is_not_arithmetic_is_refused(outside):
    text = MODULE.format(outside=outside, status="0")
    with pytest.raises(object_code.MayFail):
        object_code.emit_object(text, "cfunc.f", "f", machine.new_machine())


def test_code_without_the_function_is_compiled_again():
    code = object_code.emit_object(MODULE.format(outside="cos", status="0"), "cfunc.f", "f", machine.new_machine())
    assert machine.load_function("f", code) and not machine.load_function("g", code)


def test_a_file_of_code_under_another_name_is_not_read(tmp_path, monkeypatch):
    tmp_path.chmod(0o700)
    machine.write_code(tmp_path / "move-1.o", b"code")
    assert machine.read_code(tmp_path / "move-1.o") == b"code"
    (tmp_path / "move-1.o").rename(tmp_path / "stress-1.o")
    assert machine.read_code(tmp_path / "stress-1.o") is None
    os.mkfifo(tmp_path / "pipe-1.o")  # without a writer, which an ordinary read would wait for
    assert machine.read_code(tmp_path / "pipe-1.o") is None


# --- what is frozen in it -------------------------------------------------------------------------------------------

FACTOR = 1.0
UNITS = types.ModuleType("units")
UNITS.FACTOR = 1.0


def of_a_default(factor):
    def function(overlap, factor=factor):
        return overlap * factor

    return function


def of_a_closure(factor):
    return lambda overlap: overlap * factor


def of_a_module(factor):
    function = types.FunctionType((lambda overlap: overlap * UNITS.FACTOR).__code__, {"UNITS": types.ModuleType("u")})
    function.__globals__["UNITS"].FACTOR = factor
    return function


def of_a_callee(factor):
    inner = of_a_closure(factor)
    return lambda overlap: inner(overlap)


@pytest.mark.parametrize("make", [of_a_default, of_a_closure, of_a_module, of_a_callee])
@pytest.mark.parametrize("kind", [float, int, np.float32, np.int64, lambda x: np.array([x]), lambda x: (x, str(x))])
def test_every_frozen_value_changes_the_description(make, kind):
    one, same, other = (frozen.describe(make(kind(value))) for value in (1, 1, 2))
    assert one == same and one.complete and one.text != other.text


def test_exchanged_values_and_other_code_change_the_description():
    first, second = of_a_closure(1.0), of_a_closure(2.0)
    assert frozen.describe(first, second).text != frozen.describe(second, first).text
    plus, minus = (eval(f"lambda x: x {sign} x", {"__name__": "mine"}) for sign in "+-")
    assert frozen.describe(plus).text != frozen.describe(minus).text


def test_code_with_a_value_that_cannot_be_described_is_not_stored():
    described = frozen.describe(of_a_closure(object()))
    assert not described.complete


@pytest.mark.parametrize("law", list(LAWS))
def test_code_of_labkits_laws_is_stored(law):
    scene = lk.Scene(law=law)
    assert stamp_of(scene.contact_law, needs_of(scene, "double").law)


PROGRAM = """
import numpy as np, labkit as lk
from labkit.grains.state import grains_in_cell
FACTOR = 1.0

class Spring(lk.laws.LinearSpring):
    @staticmethod
    def force(stiffness, overlap):
        return stiffness * overlap * FACTOR

    @staticmethod
    def energy(stiffness, overlap):
        return 0.5 * stiffness * overlap * overlap * FACTOR

@lk.register_law
class Own(lk.ContactLaw):
    name = "own"
    parts = Spring() + lk.laws.Coulomb() + lk.laws.LocalDamping()

def stress():
    grains = grains_in_cell(scene, np.full(2, 1e-4), np.array([[0, 0, 0], [0, 0, 1.9e-4]]), np.eye(3) * 1e-3)
    return FusedEngine(grains).stress()[2, 2]

from labkit.engines.fused import FusedEngine
scene = lk.Scene(law="own", rolling_friction=0.0)
before = stress()
FACTOR = 2.0
print(stress() / before)
"""


@pytest.mark.slow
def test_a_global_that_is_changed_in_a_notebook_changes_the_law():
    done = subprocess.run([sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=True)
    assert np.isclose(float(done.stdout), 2.0)
