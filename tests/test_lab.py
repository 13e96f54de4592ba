"""The script ./lab, which installs what is missing."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from analysis.__main__ import STUDIES

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


@pytest.mark.yade
@pytest.mark.parametrize(("name", "program"), [*((name, "-m analysis") for name in STUDIES), ("specimen", "labkit")])
def test_a_study_of_studies_yaml_is_a_command_and_all_else_goes_to_labkit(tmp_path, name, program):
    """The installation consists of scripts that say how they were called."""
    (tmp_path / "analysis").mkdir()
    for file in ("lab", "pyproject.toml", "analysis/studies.yaml"):
        shutil.copy(ROOT / file, tmp_path / file)
    (tmp_path / ".venv/bin").mkdir(parents=True)
    for script, line in (("python", 'case "$*" in *-m\\ analysis*) echo "$@" ;; esac'), ("labkit", 'echo labkit "$@"')):
        (tmp_path / ".venv/bin" / script).write_text(f"#!/bin/sh\n{line}\n")
        (tmp_path / ".venv/bin" / script).chmod(0o755)
    shutil.copy(ROOT / "pyproject.toml", tmp_path / ".venv/installed")
    done = subprocess.run([tmp_path / "lab", name, "-o", "x y"], capture_output=True, text=True, check=True)
    assert done.stdout == f"{'-P ' * (program != 'labkit')}{program} {name} -o x y\n"


TOX = {
    "test": "",
    "test --all": " -e py,docs,oldest -- -n 3 --dist loadfile --no-loadscope-reorder",
    "test --all tests/umat": " -- -n 3 --dist loadfile --no-loadscope-reorder tests/umat",
    "test --fast": " -- -m not slow -n 2 --dist loadfile",
    "docs": " -e docs",
}
PROGRAMS = "chromium clang++ g++ gcc gfortran liggghts npm sbatch yade"  # otherwise they would be installed


@pytest.mark.parametrize("words", TOX)
def test_all_tests_include_the_site_and_the_oldest_libraries(tmp_path, words):
    shutil.copy(ROOT / "lab", tmp_path)
    for folder, names in ((tmp_path / ".venv/bin", "python tox"), (tmp_path / "bin", PROGRAMS)):
        folder.mkdir(parents=True)
        for name in names.split():
            (folder / name).write_text('#!/bin/sh\necho "$@"\n')
            (folder / name).chmod(0o755)
    environment = {**os.environ, "PATH": f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        [tmp_path / "lab", *words.split()], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout == f"-I -m tox run -q{TOX[words]}\n"
