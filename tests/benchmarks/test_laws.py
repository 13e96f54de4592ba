"""The table of `./lab bench --what laws`."""

import pytest

from benchmarks.laws import laws
from labkit.engines.base import silent
from labkit.grains.laws import LAWS
from labkit.grains.state_file import read_state

pytestmark = pytest.mark.long


def test_every_law_is_timed_on_the_same_grains(specimen_file):
    lines = laws(read_state(specimen_file), 20, 1, silent).splitlines()
    rows = {line.split()[0]: [float(word) for word in line.split()[1:4]] for line in lines[2:]}
    assert set(rows) == set(LAWS)
    assert rows["rolling_resistance"][2] == 1.0
