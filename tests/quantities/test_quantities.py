"""Scalar quantities of a record against hand calculation, on one record and on many."""

import dataclasses

import numpy as np
import pytest

from labkit.errors import InputError
from labkit.quantities.recorded import quantity, record_table
from labkit.quantities.scalars import ALIASES, QUANTITIES, Facts

START = np.eye(3) * 200e3
FACTS = Facts(reference=START, cycles=lambda strain, stress: np.arange(float(len(strain))))
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
    "pore_pressure_mean": 0.0,
    "pore_pressure_axial": -100e3,
    "pore_pressure_radial": 50e3,
    "r_u": 0.0,
    "r_u_mean": 0.0,
    "r_u_axial": -0.5,
    "r_u_radial": 0.25,
    "volumetric_strain": 0.01,
    "deviatoric_strain": 2 / 3 * 0.055,
    "gamma_xz": 0.04,
    "strain": 0.04,
}


def test_every_quantity_has_its_value():
    record = {"stress": STRESS, "strain": STRAIN}
    assert set(EXPECTED) == {name for name, row in QUANTITIES.items() if not row.every_record and "sff" not in name}
    for name, expected in EXPECTED.items():
        assert quantity(name)(record, FACTS) == pytest.approx(expected, abs=1e-9), name


def test_records_along_time_give_the_same_as_one_by_one():
    stress, strain = np.stack([START, STRESS, 0.5 * STRESS]), np.stack([STRAIN * k for k in range(3)])
    records = {"stress": stress, "strain": strain}
    for name in EXPECTED:
        one_by_one = [quantity(name)({"stress": stress[k], "strain": strain[k]}, FACTS) for k in range(3)]
        np.testing.assert_array_equal(quantity(name)(records, FACTS), one_by_one)
    assert quantity("r_u")(records, FACTS)[2] == pytest.approx(0.5)
    assert quantity("pore_pressure")(records, FACTS)[2] == 100e3


def test_a_rotation_changes_no_invariant():
    angle = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turned = {"stress": angle @ STRESS @ angle.T, "strain": angle @ STRAIN @ angle.T}
    for name in ("p", "deviator", "sigma_1", "sigma_2", "sigma_3", "b", "lode_angle", "friction_angle", "r_u"):
        assert quantity(name)(turned, FACTS) == pytest.approx(EXPECTED[name], abs=1e-6)
    sheared = dataclasses.replace(FACTS, axisymmetric=False)
    for name in ("q", "stress_ratio", "deviatoric_strain"):
        value = quantity(name)({"stress": STRESS, "strain": STRAIN}, sheared)
        assert quantity(name)(turned, sheared) == pytest.approx(value) and value > abs(EXPECTED[name])


def test_a_quantity_without_meaning_is_refused_by_one_sentence():
    record = {"stress": STRESS, "strain": STRAIN}
    drained = Facts(run="this run of cp", undrained=False)
    for name in ("pore_pressure", "r_u", "r_u_radial"):
        with pytest.raises(InputError, match="this run of cp is drained: its volume changes"):
            quantity(name)(record, drained)
        assert np.isnan(quantity(name)(record, Facts()))  # in a drained step of a path with undrained ones
    with pytest.raises(InputError, match="this run of cp is monotonic, so it has no cycles"):
        quantity("cycles")(record, drained)


@pytest.mark.parametrize(
    ("rate", "expected"),
    [
        ((-0.7, -0.7, 1.0), np.degrees(np.arcsin(0.4 / 2.4))),  # compression: Schanz and Vermeer
        ((-1.2, 0.0, 1.0), np.degrees(np.arcsin(0.2 / 2.2))),  # plane strain: Mohr's circle
        ((0.4, 0.4, -1.0), np.degrees(np.arcsin(0.2 / 1.8))),  # extension
        ((0.5, 0.5, -1.0), 0.0),
    ],
)
def test_the_dilation_angle_suits_compression_and_extension(rate, expected):
    strain = np.diag(rate) * np.linspace(0.0, 0.05, 20)[:, None, None]
    np.testing.assert_allclose(quantity("dilation_angle")({"strain": strain}), expected, atol=1e-6)


def test_components_and_recorded_scalars_have_names():
    record = {"stress": np.arange(9.0).reshape(3, 3), "void_ratio": 0.6, "drift_velocity": np.arange(3.0)}
    assert quantity("stress_xz")(record) == quantity("sigma_xz")(record) == 2.0
    assert (
        quantity("e")(record) == quantity("void_ratio")(record) == 0.6 and quantity("drift_velocity_y")(record) == 1.0
    )
    table = record_table()
    for alias, name in ALIASES.items():
        assert name in QUANTITIES or name in table or quantity(alias).name == name, alias
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
