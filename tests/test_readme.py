"""Every Python and shell snippet of README.md is run in a scratch folder, with fewer grains and less strain."""

import os
import re
import shlex
import subprocess

import pytest

from tests.conftest import ROOT

pytestmark = pytest.mark.slow

README = (ROOT / "README.md").read_text()
SMALLER = {
    "grains=2000": "grains=300",
    "strain=0.05": "strain=0.01",
    "--grains 2000": "--grains 1000",
    "--strain 0.05": "--strain 0.02",
}


def snippets(language):
    text = README
    for old, new in SMALLER.items():
        assert old in text
        text = text.replace(old, new)
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def commands():
    lines = [line.partition("#")[0].strip() for block in snippets("sh") for line in block.splitlines()]
    return [line.removeprefix("./lab ") for line in lines if line]


def test_snippets_run_and_git_ignores_what_they_write(forks, tmp_path):
    """When run from the root of a clone, they leave `git status` empty."""
    folder = tmp_path / "clone"
    folder.mkdir()
    (folder / "examples").symlink_to(ROOT / "examples")
    for code in snippets("python"):
        (tmp_path / "first.py").write_text(code)
        environment = {**os.environ, "MPLBACKEND": "Agg"}
        done = forks.run(program=tmp_path / "first.py", cwd=folder, environment=environment)
        assert done.returncode == 0, done.stderr
        assert "True" in done.stdout  # run.complete
    for command in commands():
        done = forks.run(*shlex.split(command), cwd=folder)
        assert done.returncode == 0, (command, done.stdout + done.stderr)
    written = [str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file() and not file.is_symlink()]
    written = [name for name in written if not name.startswith("examples/")]
    command = ["git", "check-ignore", "--no-index", "--stdin"]
    done = subprocess.run(command, cwd=ROOT, input="\n".join(written), capture_output=True, text=True)
    assert len(written) > 4 and sorted(done.stdout.splitlines()) == sorted(written)


def test_it_is_read_in_three_minutes():
    assert len(README.splitlines()) <= 110
