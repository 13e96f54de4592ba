"""The rules that tools check: ruff (rules and format), mypy and codespell, as .pre-commit-config.yaml lists them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.house.source import ROOT, files

pytestmark = pytest.mark.slow

TABLES = 40  # lines that may keep a layout of their own


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="pre-commit needs a git checkout")
def test_pre_commit_is_clean():
    tools = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    command = (sys.executable, "-m", "pre_commit", "run", "--all-files")
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env={**os.environ, "PATH": tools})
    assert done.returncode == 0, done.stdout + done.stderr


def test_only_tables_keep_a_layout_of_their_own():
    rooms = ("labkit", "analysis", "examples", "yade_scripts", "tests")
    skipped = [
        file
        for room in rooms
        for file in files(room)
        for line in file.read_text().splitlines()
        if line.rstrip().endswith("# fmt: " + "skip")
    ]
    assert len(skipped) < TABLES
