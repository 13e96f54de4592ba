"""Fixtures that run the studies as a user does."""

import functools
import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def in_the_clone():
    """Environment in which `analysis` can be imported, as set by ./lab."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])}


@pytest.fixture(scope="session")
def study_command(forks):
    """Runs `./lab ARGUMENTS` for a study; the finished process with its output as text."""
    return functools.partial(forks.run, program="analysis", environment=in_the_clone())
