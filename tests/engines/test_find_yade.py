"""YADE is found where Debian and conda put it."""

import os

import pytest

from benchmarks.engines import variants
from labkit.engines import find_yade, yade_program
from labkit.errors import InputError
from labkit.grains.scene import Scene


@pytest.mark.parametrize("name", ["yade", "yadedaily"])
def test_in_a_conda_environment_that_is_not_active(name, tmp_path, monkeypatch):
    program = tmp_path / "bin" / name
    program.parent.mkdir()
    program.write_text("#!/bin/sh\n")
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("CONDA_PREFIX", str(tmp_path))
    with pytest.raises(InputError, match="YADE is not installed"):
        find_yade()  # not executable
    assert yade_program() is None and not any("YADE" in name for name in variants(Scene()))
    os.chmod(program, 0o755)
    assert find_yade() == yade_program() == str(program)
    assert "labkit on YADE, 1 thread" in variants(Scene())  # the benchmark finds it too


def test_what_is_on_the_path_comes_first(tmp_path, monkeypatch):
    for place in ("first", "second/bin"):
        (tmp_path / place).mkdir(parents=True)
        (tmp_path / place / "yade").write_text("#!/bin/sh\n")
        (tmp_path / place / "yade").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path / "first"))
    monkeypatch.setenv("CONDA_PREFIX", str(tmp_path / "second"))
    assert find_yade() == str(tmp_path / "first" / "yade")
