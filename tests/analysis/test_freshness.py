"""`./lab results` in a clone: a result is up to date until code that it depends on changes."""

import subprocess
import sys

import pytest

from analysis.manifest import provenance
from labkit.files import write_with_provenance
from tests.analysis.conftest import ROOT, in_the_clone

pytestmark = pytest.mark.slow

FILE = "results/critical_state/ends.csv"


def test_code_that_a_result_depends_on_makes_it_stale_and_words_do_not(tmp_path):
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "-q", "--shared", ROOT, clone], check=True)
    (clone / FILE).write_text((clone / FILE).read_text() + "\n")
    author = ["-c", "user.name=a", "-c", "user.email=a@b"]
    subprocess.run(["git", *author, "commit", "-q", "-a", "-m", "Write a table again"], cwd=clone, check=True)

    def results(*words):
        done = subprocess.run(
            [sys.executable, "-P", "-m", "analysis", "results", *(words or [FILE])],
            env=in_the_clone() | {"PYTHONPATH": str(clone)},
            cwd=tmp_path,
            capture_output=True,
            text=True,
        )
        assert not done.stderr, done.stderr
        return done.returncode, done.stdout.splitlines()[0].split(", ", 1)[1]

    def add(file, text):
        (clone / file).write_text((clone / file).read_text() + text)

    assert results() == (0, "up to date")
    assert results("results/rotation/") == (0, "0 of them written by code that has changed since")  # it has left
    add("analysis/critical_state/ends.py", "# a comment\n")
    add("labkit/plugins/umat/library.py", "x = 1\n")  # nothing that the study imports
    assert results() == (0, "up to date")
    add("analysis/critical_state/ends.py", "x = 1\n")
    add("analysis/pages.py", "x = 1\n")  # imported by the study
    assert results() == (1, "2 changed: analysis/critical_state/ends.py, analysis/pages.py")
    write_with_provenance(clone / FILE, "x\n", command="by hand")
    assert results(FILE, "--tidy")[0] == 1 and not (clone / f"{FILE}.provenance.json").exists()
    assert provenance(clone / FILE)["command"] == "by hand"
