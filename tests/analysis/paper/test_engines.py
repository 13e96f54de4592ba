"""The table of both engines for runs of the model, each with a small random scatter."""

import numpy as np
import pytest

from analysis.paper.engines import KINDS, engine_table

pytestmark = pytest.mark.long


def test_every_test_is_compared_with_yade(known):
    table = engine_table(known).set_index(["test", "kind"])
    assert len(table) == 3 * 7 and set(table.index.get_level_values("kind")) == set(KINDS.values())
    yade, fused = (table.xs(KINDS[kind], level="kind") for kind in ("yade", "fused"))
    shear = ["share_cv", "share_cr", "share_cp"]
    assert yade["off_peak"][shear].eq(0.0).all() and fused["off_M"][shear].abs().between(1e-6, 0.02).all()
    assert fused["M"]["share_cp"] / yade["M"]["share_cp"] - 1.0 == pytest.approx(fused["off_M"]["share_cp"])
    assert np.isnan(yade["M"]["share_isoc"]) and np.isnan(yade["peak"]["share_isod"]) and yade["Z"]["share_isod"] > 0


def test_without_yade_there_are_no_differences(known):
    table = engine_table({"share_cv-fused": known["share_cv-fused"], "cv-dense": known["cv-dense"]})
    assert list(table["test"]) == ["share_cv"] and np.isnan(table["off_M"][0]) and table["M"][0] > 0.9
    assert len(engine_table({})) == 0 and "off_M" in engine_table({})
