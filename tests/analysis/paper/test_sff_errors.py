"""The error of C0 in real contacts: its parts add up."""

import pytest

import labkit
from analysis.paper.sff_errors import sff_errors
from labkit.sff.budget import PARTS

pytestmark = pytest.mark.long


def test_the_parts_add_up(run_file):
    row = sff_errors({"small": labkit.open_run(run_file)}).iloc[0]
    assert row["records"] > 0 and 0.0 < row["mean"] <= row["worst"] < 0.1
    assert row[list(PARTS)].sum() == pytest.approx(1.0)
    assert row["fourth"] < row["snapshot_error"] <= row["worst"] * (1 + 1e-9)
    assert bool(row["explanation"]) == (row["over"] > 0)
