"""Folders of compiled code belong to one user: others cannot put code there that labkit would execute."""

import ctypes
import functools
import os
import stat
import subprocess
import sys
import tempfile

import pytest

from labkit.engines.kernel import machine
from labkit.engines.kernel.machine import address_of, compiled_folder
from labkit.engines.kernel.translate import load_numba
from labkit.files import caches
from labkit.files.caches import cache_folder, private_folder
from labkit.process.children import without_current_folder


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture(autouse=True)
def says_again():
    caches._refuse.cache_clear()


@pytest.fixture
def careless():
    """A user whose new files can be changed by everybody."""
    before = os.umask(0)
    yield
    os.umask(before)


def test_a_new_folder_belongs_to_its_user_whatever_the_umask(tmp_path, monkeypatch, careless):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    folder = cache_folder("compiled")
    assert folder == tmp_path / "caches/labkit/compiled"
    assert mode(folder) == mode(folder.parent) == 0o700


def link(path):
    (path.parent / "theirs").mkdir(mode=0o700)
    path.symlink_to(path.parent / "theirs")


def open_to_others(bits):
    def make(path):
        path.mkdir()
        path.chmod(bits)

    return make


REFUSED = {
    "is a link": link,
    "can be changed by other users": open_to_others(0o777),
    "can be changed by other users (delete it)": open_to_others(0o770),
    "cannot be used (File exists)": lambda path: path.write_text("a file"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_folder_that_others_may_have_filled_is_refused_in_one_sentence(why, tmp_path, capsys):
    path = tmp_path / "cache"
    REFUSED[why](path)
    assert private_folder(path) is None and private_folder(path) is None
    said = capsys.readouterr().err
    assert f"the cache {path} {why}" in said and said.count("\n") == 1


def test_a_folder_of_another_user_is_refused(tmp_path, capsys, monkeypatch):
    (tmp_path / "cache").mkdir(mode=0o700)
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    assert private_folder(tmp_path / "cache") is None
    assert "belongs to another user" in capsys.readouterr().err


def test_a_home_folder_that_cannot_be_written_is_as_none(tmp_path, monkeypatch, capsys):
    """A container gives a user without a name the home folder /."""
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    assert cache_folder("compiled") == tmp_path / ".cache/labkit/compiled"
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # what root is never told
    assert cache_folder("compiled") == tmp_path / f"temporary/labkit-{os.geteuid()}/compiled"
    assert not capsys.readouterr().err


def test_a_relative_folder_is_refused(tmp_path, capsys, monkeypatch):
    """It would lie in the folder of a stranger as soon as labkit runs there."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", "caches")
    assert cache_folder("compiled") is None and not list(tmp_path.iterdir())
    assert "is not an absolute path" in capsys.readouterr().err


def twice(x):
    return 2.0 * x


def thrice(x):
    return 3.0 * x


def compiled_value(function):
    """The value at 2.0 of a function that is compiled under the name of `twice`, and whether its file was read."""
    compiled_folder.cache_clear()
    written = []

    def write():
        written.append(function)
        float64 = load_numba().float64
        return function, float64(float64)

    place = address_of("twice", write, "stamp")
    return ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(place)(2.0), not written


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    yield tmp_path / "cache"
    compiled_folder.cache_clear()


@pytest.mark.parametrize("change", ["open", "link"])
def test_planted_code_is_not_executed(change, own_cache, tmp_path, capsys):
    assert compiled_value(thrice) == (6.0, False) and compiled_value(twice) == (6.0, True)  # as if planted
    if change == "open":
        own_cache.chmod(0o777)
    else:
        own_cache.rename(tmp_path / "theirs")
        own_cache.symlink_to(tmp_path / "theirs")
    assert compiled_value(twice) == (4.0, False)
    assert "compiled anew" in capsys.readouterr().err


def test_code_that_cannot_be_kept_there_is_kept_nowhere(monkeypatch, tmp_path):
    monkeypatch.setattr(machine, "private_folder", lambda path: path)  # one that does not exist and cannot be made
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/proc/nowhere")
    monkeypatch.chdir(tmp_path)
    assert [compiled_value(twice) for _ in range(2)] == [(4.0, False)] * 2 and not list(tmp_path.iterdir())
    compiled_folder.cache_clear()


@pytest.mark.slow
def test_settings_in_the_current_folder_do_not_move_the_cache(tmp_path):
    (tmp_path / ".numba_config.yaml").write_text(f"cache_dir: {tmp_path}/strangers\n")
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "own")}
    environment.pop("NUMBA_CACHE_DIR")
    program = "import numpy, labkit.model as m; m.isotropic_state, m.stress_rate; m.Model().stress(numpy.ones(27))"
    subprocess.run([sys.executable, "-P", "-c", program], cwd=tmp_path, env=environment, check=True)
    assert [file.suffix for file in (tmp_path / "own/labkit/compiled").iterdir()] == [".o"]
    assert not (tmp_path / "strangers").exists()


def test_a_child_imports_nothing_from_the_current_folder():
    given = {"A": "b", "PYTHONPATH": os.pathsep.join(["", "/there", "here", ""])}
    places = os.pathsep.join(["/first", "/there", os.path.abspath("here")])
    assert without_current_folder(given, "/first") == {"A": "b", "PYTHONSAFEPATH": "1", "PYTHONPATH": places}


@pytest.mark.parametrize("change", ["mode", "owner", "link"])
def test_code_that_others_put_into_a_checked_folder_is_not_executed(change, own_cache, tmp_path, monkeypatch):
    """Whoever may write to the folder above can replace the folder after labkit has checked it."""
    assert compiled_value(thrice) == (6.0, False)
    (file,) = (own_cache / "labkit").glob("*.o")
    assert mode(file) == 0o600
    folder = compiled_folder()
    if change == "mode":
        file.chmod(0o666)
    elif change == "link":
        file.rename(tmp_path / "theirs.o")
        file.symlink_to(tmp_path / "theirs.o")
    else:
        monkeypatch.setattr(caches, "user_number", lambda: os.geteuid() + 1)
    monkeypatch.setattr(machine, "compiled_folder", functools.cache(lambda: folder))
    assert compiled_value(twice) == (4.0, False)
