"""A sheared state, made once from the small run that all tests share."""

import pytest

from labkit.dem.checkpoint import read_checkpoint


@pytest.fixture(scope="session")
def sheared_state(run_file):
    """About 500 grains after 2 % of shear at constant volume."""
    return read_checkpoint(run_file)
