"""The script ./lab, which installs what is missing."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parent.parent


def test_an_installation_that_was_cut_off_is_repeated(tmp_path):
    """An installation interrupted in its first seconds leaves an environment without pip; nothing is downloaded."""
    for name in ("lab", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / ".venv"], check=True)
    environment = {**os.environ, "PIP_NO_INDEX": "1"}
    done = subprocess.run([tmp_path / "lab", "--help"], env=environment, capture_output=True, text=True)
    assert "installing labkit" in done.stderr and "No module named pip" not in done.stderr
    subprocess.run([tmp_path / ".venv/bin/python", "-m", "pip", "--version"], check=True, capture_output=True)
