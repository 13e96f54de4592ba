"""Fixtures that run the studies as a user does."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def run_study(*arguments, cwd=None):
    """Runs `./lab ARGUMENTS` for a study with the Python of the tests; the finished process with its output as text."""
    return subprocess.run(
        [sys.executable, "-P", "-m", "analysis", *map(str, arguments)],
        cwd=cwd,
        env=in_the_clone(),
        capture_output=True,
        text=True,
        timeout=600,
    )


def in_the_clone():
    """Environment in which `analysis` can be imported, as set by ./lab."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])}


@pytest.fixture(scope="session")
def study_command():
    return run_study
