"""q of a test means one thing: signed about z in an axisymmetric test, the invariant in every other test."""

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.micro.stress import deviatoric_stress, equivalent_stress
from labkit.paths.steps import Steps, is_symmetric
from labkit.paths.variables import increments
from labkit.results.info import run_summary

COMPRESSION = increments(strain={"zz": 0.01}, stress={"xx": 0.0, "yy": 0.0}, records=20)
EXTENSION = increments(strain={"zz": -0.01}, stress={"xx": 0.0, "yy": 0.0}, records=20)
LEVEL = increments(stress={"xz": 0.0, "yz": 0.0, "xy": 0.0}, absolute=True, over=0.005)
SHEAR = increments(strain={"xz": 0.01}, stress={"zz": 0.0}, until="q > 50 kPa", records=20)
PLANE = increments(strain={"zz": 0.01}, stress={"xx": 0.0}, records=20)
RATIO = increments(strain={"xz": 0.01}, stress={"zz": 0.0}, until="eta > 0.5", records=20)


@pytest.mark.parametrize(
    "steps, symmetric",
    [
        ((COMPRESSION,), True),
        ((LEVEL, COMPRESSION, EXTENSION), True),
        ((increments(stress={"p": 0.0}, strain={"q": 0.01}, variables="roscoe"),), True),
        ((increments(stress={"d": 1e4}, strain={"q": 0.01}, variables="roscoe"),), False),
        ((COMPRESSION, SHEAR), False),
        ((PLANE,), False),
        ((increments(stress={"xz": 1e4}, over=0.01),), False),
    ],
)
def test_a_path_of_steps_is_symmetric_if_every_step_is(steps, symmetric):
    assert is_symmetric(Steps(pressure=1e5, steps=steps)) == symmetric


@pytest.mark.parametrize("step, of", [(SHEAR, lambda p, q: q), (RATIO, lambda p, q: 1e5 * q / p)])
def test_q_of_a_test_whose_axes_turn_is_the_invariant(step, of, loose_specimen):
    run = lk.run(loose_specimen, Steps(pressure=1e5, steps=(step,)), progress=False)
    stress = run.data["stress"].values
    q = equivalent_stress(stress)
    np.testing.assert_array_equal(run.data.lab.q(), q)
    values = of(run.data.lab.mean_stress().values, q)
    assert (values[:-1] <= 50e3).all() and values[-1] > 50e3 and abs(deviatoric_stress(stress)[-1]) < 0.8 * q[-1]
    assert run_summary(run.data)["deviatoric stress, invariant q"] == f"{q[-1]:.6g} Pa"


def test_stop_when_reads_the_same_q(loose_specimen):
    path = lk.paths.SimpleShear(pressure=1e5, strain=0.05)
    run = lk.run(loose_specimen, path, stop_when="q > 50 kPa", progress=False)
    q = equivalent_stress(run.data["stress"].values)
    assert q[-1] > 50e3 and (q[:-1] <= 50e3).all() and np.array_equal(run.data.lab.q(), q)


def test_q_is_negative_in_extension(loose_specimen):
    run = lk.run(loose_specimen, Steps(pressure=1e5, steps=(EXTENSION,)), progress=False)
    assert run.data.lab.q()[-1] < -20e3


def test_info_shows_the_six_stresses_of_a_specimen_and_what_is_not_isotropic(loose_specimen, tmp_path, capsys):
    file = tmp_path / "s.state.nc"
    lk.write_state(file, loose_specimen)
    assert main(["info", str(file)]) == 0
    stress = lk.love_stress(loose_specimen.snapshot())
    share = float(equivalent_stress(stress)) / (np.trace(stress) / 3.0)
    shown = capsys.readouterr().out
    assert f"{share:.2%}" in shown and f"{0.5 * (stress[0, 2] + stress[2, 0]):.6g}" in shown
    assert "farthest from isotropic" in shown
