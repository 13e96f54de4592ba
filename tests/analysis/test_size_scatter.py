"""Scatter and bias against the number of grains, with planted laws."""

import numpy as np
import pandas
import pytest

from analysis.size_scatter.sizes import MEASURED, bias_table, scatter_table, size_table

pytestmark = pytest.mark.long


def planted(exponent, bias, specimens=40):
    """Ends of tests with scatter 0.02 (N/1000)^-exponent about 1 + bias 1000/N."""
    rng = np.random.default_rng(4)
    rows = [
        {"size": f"n{grains}", "grains": grains}
        | {name: 1.0 + bias * 1000 / grains + rng.normal(0.0, 0.02) * (grains / 1000) ** -exponent for name in MEASURED}
        for grains in (1000, 4000, 14000)
        for _ in range(specimens)
    ]
    return pandas.DataFrame(rows)


@pytest.mark.parametrize("exponent", [0.5, 0.2])
def test_the_exponent_of_the_scatter_is_found(exponent):
    table = scatter_table(size_table(planted(exponent, 0.0)))
    assert (abs(table["exponent"] - exponent) < 0.65 * (table["high"] - table["low"])).all()
    assert ((table["corrected"] < 0.05) == (exponent == 0.2)).all()
    if exponent == 0.5:
        assert table["relative"].to_numpy() == pytest.approx(0.02, rel=0.15)
        assert table["needed"].to_numpy() == pytest.approx(4000, rel=0.3)


def test_a_bias_is_found_and_none_is_invented():
    for bias in (0.03, 0.0):
        table = bias_table(planted(0.5, bias))
        known = table[table["power"] == "1/N"]
        assert ((known["verdict"] == "differs") == (bias > 0.0)).all()
        assert (abs(known["bias"] - bias) < 1.5 * known["within"]).all()
