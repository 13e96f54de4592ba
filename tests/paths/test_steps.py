"""Paths made of steps: variables, increments that are reached, early ends, and resumption to the last bit."""

import dataclasses
import json
import re

import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError, PhysicsError
from labkit.model import Model, drive, isotropic_state
from labkit.paths.mixed_step import LEAST, MixedStep
from labkit.paths.path import number_of_steps
from labkit.paths.registry import path_of
from labkit.paths.step import Here
from labkit.paths.steps import Steps, stress_errors
from labkit.paths.variables import VARIABLES, increments
from labkit.records.schedule import Options, Schedule
from tests.killed import run_killed

P = 0.3e6
FAST = {"progress": False, "snapshots": 0}
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:at the axial strain rate")]


@pytest.fixture(scope="module")
def specimen(loose_specimen):
    return loose_specimen


# --- variables --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", VARIABLES)
def test_variables_are_work_conjugate(name):
    """The strain is sum e_i T_i, so that sum (T_i : sigma) e_i is the work."""
    rng, tensors = np.random.default_rng(1), VARIABLES[name].tensors
    e, sigma = rng.normal(size=6), rng.normal(size=(3, 3))
    sigma = sigma + sigma.T
    strain = np.einsum("a,aij->ij", e, tensors)
    assert np.sum(sigma * strain) == pytest.approx(np.einsum("aij,ij->a", tensors, sigma) @ e)
    assert np.linalg.matrix_rank(tensors.reshape(6, 9)) == 6


def test_roscoes_variables_are_those_of_the_field():
    p, q, d = VARIABLES["roscoe"].tensors[:3]
    stress = np.diag([100.0, 140.0, 300.0])
    assert [np.sum(t * stress) for t in (p, q, d)] == pytest.approx([180.0, 180.0, -40.0])
    strain = np.diag([-0.01, -0.02, 0.05])
    v, shear, difference = np.trace(strain), 2 / 3 * (0.05 + 0.015), (-0.01 + 0.02) / 2
    np.testing.assert_allclose(v * p + shear * q + difference * d, strain)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"strain": {"ww": 1.0}}, "strain 'ww'"),
        ({"stress": {"v": 1e5}, "variables": "roscoe"}, "stress 'v'"),
        ({"stress": {"p": 1e5}, "strain": {"v": 0.1}, "variables": "roscoe"}, "are both given"),
        ({"strain": {"zz": 0.1}, "variables": "cambridge"}, "variables cambridge"),
        ({"strain": {"zz": np.nan}}, "strain has a value that is not finite"),
        ({"strain": {"zz": "1100 %"}}, "strain has an increment that is too large"),
        ({"strain": {"zz": 0.1}, "until": "q/p >"}, "until 'q/p >'"),
        ({"strain": {"zz": 0.1}, "over": 0.0}, "over 0 "),
    ],
)
def test_an_impossible_step_is_refused(values, said):
    with pytest.raises(InputError) as error:
        increments(**values)
    assert said in str(error.value)


def test_stresses_that_no_strain_rate_can_set_are_refused():
    x, z = (tuple(np.eye(6)[k]) for k in (0, 2))
    with pytest.raises(InputError, match="stresses"):
        MixedStep(measured=(*x, *x), free=(*x, *z), stress=(1.0, 2.0))
    with pytest.raises(InputError, match="is empty"):
        Schedule.of(Steps(rate=10.0), 1e-7, 200, Options())


# --- runs -------------------------------------------------------------------------------------------------------


def sequence(**values):
    """Drained compression, a stress path, an undrained step that ends early, one dimension, and a return to P."""
    steps = (
        increments(stress={"xx": 0.0, "yy": 0.0}, strain={"zz": 0.006}, records=6),
        increments(stress={"p": 20e3, "q": -60e3, "d": 0.0}, variables="roscoe", records=4),
        increments(strain={"q": 0.02}, variables="roscoe", until="deviatoric_strain > 0.9 %", records=40),
        increments(strain={"zz": -0.001, "xz": 0.002}, records=3),
        increments(stress={"xx": P, "yy": P, "zz": P, "xz": 0.0}, absolute=True, records=4),
    )
    return Steps(steps=steps, rate=30.0, pressure=P, **values)


@pytest.fixture(scope="module")
def run(specimen, tmp_path_factory):
    return lk.run(specimen, sequence(), file=tmp_path_factory.mktemp("steps") / "whole.run.nc", save_every=3, **FAST)


def errors_of(run):
    data = run.data
    return stress_errors(run.path, {name: data[name].values for name in ("stress", "path_step", "path_step_progress")})


def test_stresses_follow_their_targets_and_reach_them(run):
    errors = errors_of(run)
    assert set(errors) == {"sigma_xx", "sigma_yy", "sigma_zz", "sigma_xz", "p", "q", "1 sigma_xx - 1 sigma_yy"}
    assert max(np.nanmax(np.abs(error)) for error in errors.values()) < 0.005 * P
    (met,) = run.met_conditions
    assert re.fullmatch(
        r"step 3 ended when deviatoric_strain > 0\.9 % \(deviatoric_strain = 0\.9\d* %; .* one record before\)", met
    )
    stress = run.data["stress"].values[-1]
    assert np.abs(stress[[0, 1, 2, 0], [0, 1, 2, 2]] - [P, P, P, 0.0]).max() < 0.005 * P
    held = [finding for finding in lk.verify(run) if finding.name.startswith("prescribed")]
    assert len(held) == 14 and all(finding.holds for finding in held)


def test_strains_are_reached_exactly(run):
    strain, step = run.data["strain"].values, run.data["path_step"].values
    ends = [np.flatnonzero(step == number)[-1] for number in range(1, 6)]
    assert strain[ends[0], 2, 2] == pytest.approx(0.006, rel=1e-9)
    volume = np.trace(strain, axis1=1, axis2=2)
    assert np.ptp(volume[ends[1] : ends[2] + 1]) < 1e-12  # undrained
    assert strain[ends[3], 2, 2] - strain[ends[2], 2, 2] == pytest.approx(-0.001, abs=1e-6)  # logarithmic, with shear
    assert 2.0 * strain[ends[3], 0, 2] == pytest.approx(0.002, rel=0.02)


def test_a_step_ends_early_at_the_record_that_meets_its_condition(run):
    step, progress = run.data["path_step"].values, run.data["path_step_progress"].values
    shear = lk.quantities.quantity("deviatoric_strain")({"strain": run.data["strain"].values})
    third = shear[step == 3]
    assert third[-1] > 0.009 and (third[:-1] <= 0.009).all() and progress[step == 3][-1] < 0.5
    assert progress[step == 4][-1] == progress[step == 5][-1] == 1.0 and run.complete


def test_a_run_killed_in_any_step_resumes_to_the_same_bits(run, specimen, tmp_path):
    file = tmp_path / "r.run.nc"
    options = {**FAST, "save_every": 3}
    for saves, step in ((4, 2), (5, 4)):
        run_killed(saves, specimen, sequence(), file, options)
        with lk.open_run(file) as data:
            assert data["path_step"].values[-1] == step and not data.attrs["complete"]
    again = lk.run(specimen, sequence(), file=file, **options)
    for name in ("stress", "strain", "cell", "void_ratio", "path_step", "path_step_progress"):
        assert np.array_equal(again.data[name].values, run.data[name].values)


@pytest.mark.yade
def test_yade_runs_the_same_steps(specimen):
    steps = (
        increments(stress={"xx": 0.0, "yy": 0.0}, strain={"zz": 0.002}, until="q > 100 kPa", records=4),
        increments(stress={"p": 20e3, "q": -60e3, "d": 0.0}, variables="roscoe", records=3),
    )
    short = Steps(steps=steps, rate=60.0)
    found = {engine: lk.run(specimen, short, engine=engine, **FAST) for engine in ("fused", "yade")}
    for run in found.values():
        assert run.complete and max(np.nanmax(np.abs(error)) for error in errors_of(run).values()) < 0.005 * P
        assert (run.data["path_step"].values == 2).sum() == 3
    stress = [run.data["stress"].values[-1] for run in found.values()]
    np.testing.assert_allclose(*stress, atol=0.01 * P)


def test_a_target_beyond_the_strength_stops_the_run_and_names_the_component(specimen, tmp_path):
    step = increments(stress={"q": 2e6, "p": 0.0, "d": 0.0}, variables="roscoe", label="too much", over=0.05)
    with pytest.raises(PhysicsError, match=r"^too much: q is .* Pa and cannot follow its target"):
        lk.run(specimen, Steps(steps=(step,), pressure=P, rate=30.0), file=tmp_path / "r.run.nc", **FAST)
    assert not lk.open_run(tmp_path / "r.run.nc").attrs["complete"]


def test_servo_errors_do_not_add_up_over_many_steps(specimen):
    swing = tuple(increments(stress={"q": q, "p": 0.0, "d": 0.0}, variables="roscoe", records=1) for q in (1e4, -1e4))
    run = lk.run(specimen, Steps(steps=swing, order=(0, 1) * 6, pressure=P, rate=60.0), **FAST)
    q = run.data.lab.deviatoric_stress().values
    assert np.abs(q[2::2] - q[0]).max() < 0.005 * P and np.abs(q[1::2] - q[0] - 1e4).max() < 0.005 * P


# --- model and files --------------------------------------------------------------------------------------------


def test_the_model_takes_the_same_steps():
    result = drive(Model(), sequence(), isotropic_state(Model(), 0.67, P))
    assert result.failure is None and number_of_steps(result.path) == 5
    errors = stress_errors(result.path, {"stress": result.stress, **result.progress})
    assert max(np.nanmax(np.abs(error)) for error in errors.values()) < 1e-6 * P
    step = result.progress["path_step"]
    shear = 2 / 3 * (result.strain[:, 2, 2] - (result.strain[:, 0, 0] + result.strain[:, 1, 1]) / 2)
    assert shear[step == 3][-1] > 0.009 and (shear[step == 3][:-1] <= 0.009).all()
    assert np.abs(result.stress[-1][[0, 1, 2, 0], [0, 1, 2, 2]] - [P, P, P, 0.0]).max() < 1e-6 * P


def test_steps_are_restored_from_a_file_to_the_last_bit():
    path = sequence(order=(0, 1, 1, 0, 2, 3, 4)).starting_at(P)
    again = path_of("steps", json.loads(json.dumps({**dataclasses.asdict(path), "record_strain": 1e-3})))
    assert again == path and number_of_steps(again) == 7 and again.order == (0, 1, 1, 0, 2, 3, 4)
    text = json.dumps([dataclasses.asdict(step) for step in path.steps])
    assert lk.paths.Steps(steps=text).steps == path.steps
    for wrong in ("[", "{}", "[1]", '[{"strain": [1]}]', '[{"nothing": 1}]', 7):
        with pytest.raises(InputError, match=r"strain|steps"):
            lk.paths.Steps(steps=wrong)


def test_a_step_without_changes_still_takes_time():
    path = Steps(steps=(increments(), increments(strain={"zz": 0.02})), rate=10.0)
    assert [step.length for step in path.steps_from(Here())] == pytest.approx([LEAST, 0.02])


@pytest.mark.parametrize("records", [1, 3, 7, 200])
def test_each_step_has_its_own_number_of_records(records):
    path = Steps(steps=(increments(strain={"zz": 0.01}, records=records), increments(strain={"zz": 0.013})), rate=10.0)
    schedule = Schedule.of(path, 1.19e-7, 200, Options())
    step, steps = 0, []
    while step < schedule.steps:
        step = schedule.next_stop(step)
        steps += [step] if schedule.is_record(step) else []
    first = [step for step in steps if step <= schedule.turns[0]]
    assert abs(len(first) - records) <= max(1, 0.05 * records) and len(steps) - len(first) == 13
    assert schedule.records == len(steps)
