"""Exit conditions of the Incremental Driver, evaluated on records in labkit's conventions."""

import numpy as np
import pytest

from labkit.errors import InputError
from labkit.plugins.incremental.exit_condition import translate
from labkit.quantities.conditions import condition

RECORD = {
    "stress": np.array([[100e3, 6e3, 4e3], [6e3, 200e3, 5e3], [4e3, 5e3, 300e3]]),
    "strain": np.array([[-0.01, 0.003, 0.001], [0.003, -0.02, 0.002], [0.001, 0.002, 0.05]]),
    "void_ratio_nominal": 0.6,
    "coordination_number": 5.0,
    "mean_normalised_force": 0.01,
    "contact_anisotropy": np.diag([-0.1, -0.2, 0.3]),
}
VALUES = {  # conditions in the driver's variables, stresses in kPa
    **{"s1": -300, "s2": -100, "s3": -200, "s12": -4, "s13": -5, "s23": -6},
    **{"p": 200, "q": 100, "P": 600 / 3**0.5},
    **{"e1": -0.05, "e2": 0.01, "e3": 0.02, "g12": -0.002, "g13": -0.004, "g23": -0.006},
    **{"ev": 0.02, "eq": 2 / 3 * 0.07, "eP": 0.02 / 3**0.5, "eQ": (2 / 3) ** 0.5 * 0.07},
    **{"v1": 0.6, "v2": 5.0, "v3": 0.01, "v4": 0.3, "v5": -0.1, "v6": -0.2},
}


def met(text):
    return condition(translate(text, "kPa")).holds(RECORD, RECORD)


@pytest.mark.parametrize("name", VALUES)
def test_every_variable_has_its_value_and_sign(name):
    value, little = VALUES[name], 1e-6 * abs(VALUES[name])
    assert met(f" {name} > {value - little!r}") and not met(f"{name} > {value + little!r}")
    fortran = f"{-value - little:.12e}".replace("e", "d")
    assert met(f"-{name} > {fortran}") and met(f"2.0d0*{name} < {2 * value + 3 * little!r}")


def test_sums():
    assert met("s1 - s3 < -99.9") and not met("s1 - s3 < -100.1") and met("-0.5*s1 + 2*e1 + v2 > 154.8")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("s1", "no single < or >"),
        ("s1 > 1 < 2", "'s1 > 1 < 2'"),
        ("", "''"),
        ("> 5", "no variable"),
        ("s1 > x", "'x'"),
        ("s1 > ", "''"),
        ("s7 > 1", "'s7' is not a variable of an exit condition: use s1, s2"),
        ("s1 s2 > 1", "'s2'"),
        ("(s1) > 1", "is not understood"),
        ("Q > 1", "write q instead"),
        ("1e999*s1 > 1", "too large"),
    ],
)
def test_anything_else_is_refused(text, said):
    with pytest.raises(InputError) as error:
        translate(text, "kPa")
    assert said in str(error.value)


@pytest.mark.parametrize(
    "sum_of", ["1" * 300_000, " " * 300_000 + "!", "1" * 300_000 + "x"], ids=["digits", "blanks", "word"]
)
def test_a_sum_of_any_length_is_refused_in_one_reading(sum_of):
    with pytest.raises(InputError, match="is not understood"):
        translate(f"{sum_of} > 1", "kPa")
