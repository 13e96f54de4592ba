"""Every Python and shell snippet of README.md is run in a scratch folder."""

import os
import re
import shlex
import subprocess
import sys

import pytest

from tests.conftest import PATIENCE, ROOT

pytestmark = pytest.mark.slow

README = (ROOT / "README.md").read_text()


def snippets(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def commands():
    lines = [line.partition("#")[0].strip() for block in snippets("sh") for line in block.splitlines()]
    return [line.removeprefix("./lab ") for line in lines if line]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("readme")
    (folder / "examples").symlink_to(ROOT / "examples")
    return folder


def test_python(folder):
    for code in snippets("python"):
        done = subprocess.run(
            [sys.executable, "-c", code],
            cwd=folder,
            env={**os.environ, "MPLBACKEND": "Agg"},
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )
        assert done.returncode == 0, done.stderr
        assert "True" in done.stdout  # run.complete


@pytest.mark.parametrize("command", commands())
def test_shell(folder, labkit_process, command):
    done = labkit_process(*shlex.split(command), cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr


def test_what_the_snippets_write_is_ignored_by_git(folder):
    """When run from the root of a clone, they leave `git status` empty."""
    written = [str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file() and not file.is_symlink()]
    written = [name for name in written if not name.startswith("examples/")]
    command = ["git", "check-ignore", "--no-index", "--stdin"]
    done = subprocess.run(command, cwd=ROOT, input="\n".join(written), capture_output=True, text=True)
    assert written and sorted(done.stdout.splitlines()) == sorted(written)


def test_it_is_read_in_three_minutes():
    assert len(README.splitlines()) <= 110
