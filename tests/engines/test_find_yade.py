"""YADE is found where Debian and conda put it."""

import os

import pytest

from labkit.engines import find_yade
from labkit.errors import InputError


@pytest.mark.parametrize("name", ["yade", "yadedaily"])
def test_in_a_conda_environment_that_is_not_active(name, tmp_path, monkeypatch):
    program = tmp_path / "bin" / name
    program.parent.mkdir()
    program.write_text("#!/bin/sh\n")
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("CONDA_PREFIX", str(tmp_path))
    with pytest.raises(InputError, match="YADE is not installed"):
        find_yade()  # not executable
    os.chmod(program, 0o755)
    assert find_yade() == str(program)


def test_what_is_on_the_path_comes_first(tmp_path, monkeypatch):
    for place in ("first", "second/bin"):
        (tmp_path / place).mkdir(parents=True)
        (tmp_path / place / "yade").write_text("#!/bin/sh\n")
        (tmp_path / place / "yade").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path / "first"))
    monkeypatch.setenv("CONDA_PREFIX", str(tmp_path / "second"))
    assert find_yade() == str(tmp_path / "first" / "yade")
