"""Folders of compiled code belong to one user: others cannot put code there that labkit would execute."""

import os
import pickle
import stat
import subprocess
import sys
import tempfile

import pytest

from labkit.engines.kernel import machine
from labkit.engines.kernel.machine import compiled_folder
from labkit.io import caches
from labkit.io.caches import cache_folder, private_folder
from labkit.io.children import without_current_folder
from labkit.model import compiled


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


class Planted:
    """A pickle that leaves a file if it is loaded."""

    def __init__(self, hit):
        self.hit = hit

    def __reduce__(self):
        return os.mkdir, (str(self.hit),)


def compile_twice():
    compiled_folder.cache_clear()
    function = compiled.cache_on_disk(twice, "stamp")
    return function(2.0), sum(function.stats.cache_hits.values()), function


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    yield tmp_path / "cache"
    compiled_folder.cache_clear()


@pytest.mark.parametrize("change", ["open", "link"])
def test_a_planted_pickle_is_not_loaded(change, own_cache, tmp_path, capsys):
    assert compile_twice()[:2] == (4.0, 0) and compile_twice()[:2] == (4.0, 1)
    (index,) = own_cache.rglob("*.nbi")
    index.write_bytes(pickle.dumps(Planted(tmp_path / "hit")))
    if change == "open":
        own_cache.chmod(0o777)
    else:
        own_cache.rename(tmp_path / "theirs")
        own_cache.symlink_to(tmp_path / "theirs")
    assert compile_twice()[:2] == (4.0, 0) and not (tmp_path / "hit").exists()
    assert "compiled anew" in capsys.readouterr().err


def test_code_that_cannot_be_kept_there_is_kept_nowhere(own_cache, monkeypatch):
    """Numba would choose the folder of the source instead."""
    monkeypatch.setattr(machine, "private_folder", lambda path: path)  # one that does not exist and cannot be made
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/proc/nowhere")
    value, hits, function = compile_twice()
    assert (value, hits) == (4.0, 0) and getattr(function._cache, "_cache_file", None) is None


NUMBA_SETTINGS = """
from labkit.model import compiled
function = compiled.cache_on_disk(compiled.hash_files, "stamp")
print(function._cache._cache_file._cache_path)
"""


@pytest.mark.slow
def test_settings_in_the_current_folder_do_not_move_the_cache(tmp_path):
    (tmp_path / ".numba_config.yaml").write_text(f"cache_dir: {tmp_path}/strangers\n")
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "own")}
    environment.pop("NUMBA_CACHE_DIR")
    words = [sys.executable, "-P", "-c", NUMBA_SETTINGS]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.stdout.startswith(f"{tmp_path}/own/labkit/compiled/"), done.stderr


def test_a_child_imports_nothing_from_the_current_folder():
    given = {"A": "b", "PYTHONPATH": os.pathsep.join(["", "/there", "here", ""])}
    places = os.pathsep.join(["/first", "/there", os.path.abspath("here")])
    assert without_current_folder(given, "/first") == {"A": "b", "PYTHONSAFEPATH": "1", "PYTHONPATH": places}
