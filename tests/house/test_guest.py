"""labkit is a guest in its user's process: after its use, every setting of the process is what it was."""

import json
import re
import subprocess
import sys

import pytest

from tests.conftest import PATIENCE, ROOT

ADDRESS = re.compile(r" at 0x\w+")


def settings(how, folder):
    """Settings of a new process before and after its use of labkit (tests.house.guest)."""
    folder.mkdir(exist_ok=True)
    words = [sys.executable, "-m", "tests.house.guest", how, folder]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1]


def changes(before, after):
    """Settings that differ, by thread and name, with both values."""
    return [
        (thread, name, value, after[thread][name])
        for thread, known in before.items()
        for name, value in known.items()
        if after[thread][name] != value
    ]


@pytest.mark.slow
def test_labkit_changes_no_setting_of_its_users_process(tmp_path):
    before, after = json.loads(settings("before", tmp_path / "before"))
    assert len(before) == 2 and changes(before, after) == []


@pytest.mark.slow
def test_libraries_that_labkit_imports_first_are_as_without_labkit(tmp_path):
    texts = [settings(how, tmp_path / "same").replace(str(tmp_path), "") for how in ("alone", "after")]
    alone, after = (json.loads(ADDRESS.sub("", text))[1] for text in texts)
    assert len(alone) == 2 and changes(alone, after) == []
