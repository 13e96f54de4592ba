"""The servo in the compiled loop of the fused engine, against the same formula in Python."""

import subprocess
import sys

import numpy as np
import pytest

import labkit as lk
from labkit.engines import Device
from labkit.engines.fused import FusedEngine
from labkit.paths.registry import make_path
from labkit.paths.step import Here
from labkit.servo.correction import STANDARD, cell_stiffness
from labkit.servo.plan import correcting_of, corrections_of
from labkit.specimens.recipe import Recipe
from labkit.specimens.specimen import prepare_specimen

RATE = 20.0
INTERVALS = (5, 5, 2, 5)  # steps


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def specimen():
    return prepare_specimen(lk.Scene(), Recipe(0.67, grains=200), Device("fused"))


def plan_of(path, state):
    """The first step of a path and Corrections of INTERVALS."""
    step = next(iter(path.steps_from(Here())))
    stiffness = None if step.held is None else cell_stiffness(state.snapshot(), step.held.components)
    servo = correcting_of(step, RATE, stiffness, state.time_step, STANDARD)
    accumulated = [RATE * state.time_step * sum(INTERVALS[:number]) for number in range(len(INTERVALS))]
    return corrections_of(step, RATE, state.time_step, servo, INTERVALS, accumulated)


@pytest.mark.parametrize("precision", ["double", "mixed"])
@pytest.mark.parametrize("name", ["cv", "cp", "cr", "simple_shear", "simple_shear_cv", "stress_rotation"])
def test_the_compiled_loop_takes_the_rates_of_the_formula_in_python(specimen, name, precision):
    path = make_path(name, {"rate": RATE}).starting_at(1.001 * float(lk.mean_stress(FusedEngine(specimen).stress())))
    corrections = plan_of(path, specimen)
    compiled, python = (FusedEngine(specimen, precision=precision) for _ in range(2))
    compiled.follow(corrections)
    before = specimen.velocity_gradient
    for row, steps in enumerate(INTERVALS):
        before = corrections.velocity_gradient(row, specimen.time_step, python.stress(), before)
        python.advance(steps, before)
    ours, expected = compiled.state(), python.state()
    assert ours.step == expected.step
    assert ours.time == expected.time
    largest = np.abs(expected.velocity_gradient).max()
    np.testing.assert_allclose(ours.velocity_gradient, expected.velocity_gradient, rtol=0.0, atol=1e-10 * largest)
    if corrections.servo is None:  # nothing may differ by a bit
        np.testing.assert_array_equal(ours.position, expected.position)
    else:
        np.testing.assert_allclose(ours.cell, expected.cell, rtol=0.0, atol=1e-14 * expected.cell.max())


def test_corrections_do_not_depend_on_how_a_run_is_divided(specimen):
    path = make_path("cp", {"rate": RATE}).starting_at(1.001 * float(lk.mean_stress(FusedEngine(specimen).stress())))
    corrections = plan_of(path, specimen)
    whole, parts = FusedEngine(specimen), FusedEngine(specimen)
    whole.follow(corrections)
    for row in range(len(INTERVALS)):
        rows = {name: getattr(corrections, name)[row : row + 1] for name in ("steps", "given", "target", "gradient")}
        parts.follow(type(corrections)(**rows, servo=corrections.servo))
    for name in ("position", "velocity", "tangential_force", "cell"):
        np.testing.assert_array_equal(getattr(whole.state(), name), getattr(parts.state(), name))


def test_the_engine_starts_without_scipys_linear_algebra():
    code = (
        "import sys, labkit.engines.fused; from numba.core.registry import cpu_target; cpu_target.target_context; "
        "assert 'scipy.linalg' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_numba_still_finds_linear_algebra():
    """This is in the same process, which started without linear algebra."""
    code = (
        "import labkit.engines.fused, numba, numpy as np; a = np.diag([2.0, 4.0]); "
        "assert (numba.njit(lambda m: np.linalg.inv(m) @ m)(a) == np.eye(2)).all()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
