"""Conditions on recorded quantities: their grammar and units, and the runs that they end."""

import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.model import Model, drive, isotropic_state
from labkit.paths.steps import Steps
from labkit.paths.variables import increments
from labkit.quantities.conditions import condition
from labkit.quantities.scalars import Facts
from labkit.results.info import run_summary

FACTS = Facts(reference=np.eye(3) * 200e3)
RECORD = {"stress": np.diag([100e3, 100e3, 300e3]), "axial_strain": 0.03, "void_ratio": 0.6}


@pytest.mark.parametrize(
    ("text", "met"),
    [
        ("q/p > 1.1", True),
        ("q/p > 1.3", False),
        ("q >= 200 kPa", True),
        ("q > 0.2MPa", False),
        ("q >= 200 kN/m2 and q <= 200 kN/m^2", True),
        ("q/2 bar >= 1 and q < 0.21N/mm\u00b2", True),
        ("stress_ratio < 1.3 and axial_strain>2%", True),
        ("stress_ratio < 1.1 or e < 0.7", True),
        ("-stress_zz < -299 kPa", True),
        ("2*sigma_3 + 100 kPa >= p*1.8", True),
        ("abs(-q) / (p + 0) <= 1.2001", True),
        ("r_u > 0.16 and r_u < 0.17", True),
        ("1e5 < q", True),
        ("b > 0 or b <= 0", True),
        ("lode_angle/0 > 1e3", False),
    ],
)
def test_conditions(text, met):
    assert condition(text).holds(RECORD, FACTS) is met


def test_a_comparison_with_nan_is_not_met():
    isotropic = {"stress": np.eye(3)}
    for text in ("b > 0", "b <= 0", "r_u < 1"):  # r_u of a drained step
        assert not condition(text).holds(isotropic, Facts())


REFUSED = {  # part of the message -> conditions
    "give comparisons": (
        "",
        "q",
        "1 < q < 2",
        "q == 1",
        "not q > 1",
        "(" * 200,
        "q > \0",
        "q > 5 kN",
        "e > 5and p > 5 kPa",
    ),
    "is longer than": ("q > 1" + " " * 300,),
    "write 0.3 MPa or kPa": ("q > 0.3",),
    "a quantity in Pa cannot be compared": ("p > 5 %", "p + e > 5 kPa"),
    " in 1 ": ("q/p > 100 kPa",),
    "neither a quantity nor a number": ("__import__('os') > 1", "p.real > 1", "9**9 > e", "True > e", "1e999 > e"),
    "quantity 'pp'": ("q/pp > 1",),
    "'inertial_number'": ("inertial_nmber > 1",),
    "`_0` is neither": ("_0 > 1", "p > 5 kPa and _0 < q", "abs(_0) < 5 kPa"),
    "no quantity is compared": ("1 > 0.5", "q > 1 kPa or 5 kPa > 1 kPa", "abs(-1) > 0.5 and q > 1 kPa"),
    "is compared with itself": ("q > q", "q/p > 1 and abs(e) <= abs( e )"),
    "a number is too large": ("p > 1e400 kPa", "q/p > 1e308*1e308", "q < 1e306 kPa*1e3 and p > 5 kPa", "q/p > 1/0"),
    "depends on all records": ("cycles > 3", "accumulated_strain > 1 %", "dilation_angle > 10"),
}


@pytest.mark.parametrize(("text", "said"), [(text, said) for said, texts in REFUSED.items() for text in texts])
def test_anything_else_is_refused_in_a_sentence(text, said):
    with pytest.raises(InputError) as error:
        condition(text, "until")
    assert said in str(error.value) and str(error.value).startswith("until ")
    assert "\n" not in str(error.value).replace(repr(text), "")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:at the axial strain rate")
def test_a_run_ends_at_the_record_that_meets_its_condition(tmp_path):
    state = lk.make_specimen(lk.Recipe(0.67, grains=150), progress=False)
    path, file = lk.paths.ConstantVolume(strain=0.02, rate=60.0), tmp_path / "r.run.nc"
    with pytest.raises(InputError, match="is already met at the start"):
        lk.run(state, path, file=file, stop_when="p > 1 kPa", progress=False)
    assert not file.exists()
    run = lk.run(state, path, file=file, stop_when="q/p > 0.2", snapshots=2, progress=False)
    ratio = run.data.lab.stress_ratio().values
    assert run.complete and ratio[-1] > 0.2 and (ratio[:-1] <= 0.2).all() and len(ratio) < 20
    assert int(run.data["record"][-1]) == len(ratio) - 1  # with contacts
    assert run.met_conditions[0].startswith("it ended when q/p > 0.2 (q/p = 0.2") and "q/p > 0.2" in repr(run)
    with pytest.raises(InputError, match=r"stop_when is q/p > 0\.2 "):
        lk.run(state, path, file=file, snapshots=2, progress=False)


def test_a_test_of_the_model_ends_too():
    start = isotropic_state(Model(), 0.67, 3e5)
    result = drive(Model(), lk.paths.ConstantVolume(strain=0.3), start, stop_when="q/p > 0.5 or Z < 3")
    ratio = result.q / result.p
    assert ratio[-1] > 0.5 and (ratio[:-1] <= 0.5).all() and result.failure is None
    with pytest.raises(InputError, match="needs inertial_number, which is not recorded here"):
        drive(Model(), lk.paths.ConstantVolume(strain=0.3), start, stop_when="inertial_number > 1")


def test_the_values_at_the_end_of_a_step_and_one_record_before_are_said(loose_specimen):
    """A step ends at a record beyond its condition: the overshoot is the difference of the two values at most."""
    step = increments(strain={"zz": 0.02}, stress={"xx": 0.0, "yy": 0.0}, until="sigma_1 > 200e3", records=10)
    run = lk.run(loose_specimen, Steps(pressure=1e5, steps=(step,)), progress=False, snapshots=0)
    largest = [np.linalg.eigvalsh(0.5 * (one + one.T))[-1] for one in run.data["stress"].values[-2:]]
    before, at = (f"sigma_1 = {1e-3 * value:.4g} kPa" for value in largest)
    said = f"step 1 ended when sigma_1 > 200e3 ({at}; {before} one record before)"
    assert run.met_conditions == (said,) and largest[0] <= 200e3 < largest[1]
    assert run_summary(run.data)["ended"] == said


def test_the_values_of_a_condition_have_their_units():
    one = condition("abs(axial_strain) > 5 % and q/p < 0.9 or p - q > 20 kPa and 100 > Z")
    record = {
        "axial_strain": 0.06,
        "strain": 0.06 * np.diag([0.0, 0.0, 1.0]),
        "stress": np.diag([1e5, 1e5, 4e5]),
        "coordination_number": 5.0,
    }
    assert one.reached(record, FACTS) == "abs(axial_strain) = 6 %, q/p = 1.5, p - q = -100 kPa, Z = 5"
