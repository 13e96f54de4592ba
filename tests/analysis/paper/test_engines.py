"""The table of both engines on the model's runs, where every test has a small scatter of its own."""

import numpy as np
import pytest

from analysis.paper.engines import KINDS, engine_table


def test_every_test_is_beside_that_on_yade(known):
    table = engine_table(known).set_index(["test", "kind"])
    assert len(table) == 3 * 7 and set(table.index.get_level_values("kind")) == set(KINDS.values())
    yade, fused = table.xs("YADE, law yade", level="kind"), table.xs("fused, law yade", level="kind")
    shear = ["share_cv", "share_cr", "share_cp"]
    assert yade["off_peak"][shear].eq(0.0).all() and fused["off_M"][shear].abs().between(1e-6, 0.02).all()
    assert fused["M"]["share_cp"] / yade["M"]["share_cp"] - 1.0 == pytest.approx(fused["off_M"]["share_cp"])
    assert np.isnan(yade["M"]["share_isoc"]) and np.isnan(yade["peak"]["share_isod"]) and yade["Z"]["share_isod"] > 0


def test_without_yade_there_is_nothing_to_be_off_from(known):
    table = engine_table({"share_cv-fused": known["share_cv-fused"], "cv-dense": known["cv-dense"]})
    assert list(table["test"]) == ["share_cv"] and np.isnan(table["off_M"][0]) and table["M"][0] > 0.9
    assert len(engine_table({})) == 0 and "off_M" in engine_table({})
