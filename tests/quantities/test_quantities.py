"""Scalar quantities of a record against hand calculation, on one record and on many."""

import numpy as np
import pytest

from labkit.errors import InputError
from labkit.quantities.recorded import record_table
from labkit.quantities.scalars import ALIASES, QUANTITIES, quantity

FIRST = {"stress": np.eye(3) * 200e3, "strain": np.zeros((3, 3))}
STRESS = np.diag([100e3, 200e3, 300e3])
STRAIN = np.array([[-0.01, 0.0, 0.02], [0.0, -0.02, 0.0], [0.02, 0.0, 0.04]])
EXPECTED = {
    "p": 200e3,
    "q": 150e3,
    "stress_ratio": 0.75,
    "deviator": np.sqrt(3.0) * 100e3,
    "sigma_1": 300e3,
    "sigma_2": 200e3,
    "sigma_3": 100e3,
    "b": 0.5,
    "lode_angle": 30.0,
    "friction_angle": 30.0,
    "pore_pressure": 0.0,
    "r_u": 0.0,
    "volumetric_strain": 0.01,
    "deviatoric_strain": 2 / 3 * 0.055,
    "gamma_xz": 0.04,
}


def test_every_quantity_has_its_value():
    record = {"stress": STRESS, "strain": STRAIN}
    assert set(EXPECTED) == set(QUANTITIES)
    for name, expected in EXPECTED.items():
        assert quantity(name)(record, FIRST) == pytest.approx(expected, abs=1e-9), name


def test_records_along_time_give_the_same_as_one_by_one():
    records = {
        "stress": np.stack([FIRST["stress"], STRESS, 0.5 * STRESS]),
        "strain": np.stack([STRAIN * k for k in range(3)]),
    }
    for known in QUANTITIES.values():
        first = {name: values[0] for name, values in records.items()}
        one_by_one = [known({name: values[k] for name, values in records.items()}, first) for k in range(3)]
        np.testing.assert_array_equal(known(records), one_by_one)
    assert quantity("r_u")(records)[2] == pytest.approx(0.5) and quantity("pore_pressure")(records)[2] == 100e3


def test_a_rotation_changes_no_invariant():
    angle = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turned = {"stress": angle @ STRESS @ angle.T}
    for name in ("p", "deviator", "sigma_1", "sigma_2", "sigma_3", "b", "lode_angle", "friction_angle", "r_u"):
        assert quantity(name)(turned, FIRST) == pytest.approx(EXPECTED[name], abs=1e-6)


def test_components_and_recorded_scalars_have_names():
    record = {"stress": np.arange(9.0).reshape(3, 3), "void_ratio": 0.6, "drift_velocity": np.arange(3.0)}
    assert quantity("stress_xz")(record) == quantity("sigma_xz")(record) == 2.0
    assert (
        quantity("e")(record) == quantity("void_ratio")(record) == 0.6 and quantity("drift_velocity_y")(record) == 1.0
    )
    table = record_table()
    for alias, name in ALIASES.items():
        assert name in QUANTITIES or name in table, alias
    for variable in table.values():
        if len(variable.dimensions) == 1:
            assert quantity(variable.name).unit == variable.units


@pytest.mark.parametrize(
    "name", ["stress", "sigma", "stress_xw", "stress_x", "void_ratio_x", "nothing", "", "_", "p_xx"]
)
def test_an_unknown_name_is_refused(name):
    with pytest.raises(InputError) as refused:
        quantity(name)
    assert refused.value.value == name and refused.value.allowed
