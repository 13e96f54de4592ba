"""The rules that tools check: ruff (rules and format), mypy and codespell, as .pre-commit-config.yaml lists them.

mypy also knows the public names: it accepts a user's program and finds mistakes in it before it runs.
"""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.house.source import ROOT, files

pytestmark = pytest.mark.long

TABLES = 40  # lines that may keep their own layout

PROGRAM = """
import numpy as np

import labkit as lk

scene = lk.Scene(friction=0.5, rolling_friction=0.0, young_modulus="150 MPa")
recipe = lk.Recipe(void_ratio=0.67, grains=1000)
state = lk.make_specimen(recipe, scene, engine=lk.Fused(threads=2))
path = lk.paths.ConstantMeanStress(pressure="300 kPa", strain=0.05)
run = lk.run(state, path, engine=lk.Fused(threads=2, precision="mixed"), file="cp.run.nc", snapshots=2)
if not run.complete:
    print([str(limit) for limit in run.exceeded], run.exceeded[0].largest)
snapshot = run.snapshots[-1]
stress: np.ndarray = lk.love_stress(snapshot)
fabric = lk.statistics(snapshot)
error = float(np.abs(lk.sff_stress(snapshot) - stress).max() / lk.mean_stress(stress))
A = lk.micro.contact_anisotropy(snapshot.contacts.normal)
print(scene.friction + 1.0, run.data.sizes, error, A - fabric.contact_anisotropy)
run.plot()
"""

MISTAKES = {
    "lk.there_is_no_such_name": "attr-defined",
    "lk.paths.ThereIsNoSuchPath()": "attr-defined",
    "lk.micro.there_is_no_such_name": "attr-defined",
    "lk.Scene(fricton=0.5)": "call-arg",
    "run.snapshots[-1].contcts": "attr-defined",
    "run.plot().savefigg()": "attr-defined",
    "lk.Scene(friction=[0.5])": "arg-type",
    'lk.run(state, "cp")': "arg-type",
    "lk.make_specimen(recipe, engin='fused')": "call-arg",
    "lk.paths.ConstantMeanStress(presure=0.3e6)": "call-arg",
    "scene.friction = 0.4": "misc",
    "lk.consolidate(state)": "call-arg",
    'lk.Fused(precision="half")': "arg-type",
    "lk.Lammps(threads=2)": "call-arg",
}


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="pre-commit needs a git checkout")
def test_pre_commit_is_clean():
    tools = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    command = (sys.executable, "-m", "pre_commit", "run", "--all-files")
    environment = {**os.environ, "PATH": tools, "SKIP": "mypy"}  # mypy runs once, for the tests below
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def checked(tmp_path_factory):
    """Return the lines that mypy prints about the repository and a user's program, and the text of the program.

    The program has all mistakes at its end.
    """
    file = tmp_path_factory.mktemp("user") / "program.py"
    file.write_text(PROGRAM + "\n".join(MISTAKES) + "\n")
    rooms = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]["files"]
    done = subprocess.run([sys.executable, "-m", "mypy", *rooms, file], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stdout.splitlines()[:-1], file.read_text()


@pytest.fixture(scope="module")
def errors(checked):
    """Line -> code of the error that mypy finds there, in the program."""
    said, program = checked
    lines = program.splitlines()
    found = [re.search(r"program\.py:(\d+): error: .*\[([a-z-]+)\]$", line) for line in said]
    return {lines[int(one[1]) - 1]: one[2] for one in found if one}


def test_mypy_finds_no_mistake_in_the_repository(checked):
    said, _ = checked
    assert [line for line in said if ": error: " in line and "/program.py:" not in line] == []


def test_a_program_without_mistakes_has_no_errors(errors):
    assert {line: code for line, code in errors.items() if line not in MISTAKES} == {}


def test_every_mistake_is_found(errors):
    assert {line: code for line, code in errors.items() if line in MISTAKES} == MISTAKES


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
