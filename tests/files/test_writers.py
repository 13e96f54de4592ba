"""Every output is written whole or not at all, and a failure names the file and quotes the system's message."""

import contextlib
import os

import numpy as np
import pytest

from labkit.cli import main
from labkit.errors import InputError
from labkit.files import atomic
from labkit.files.writable import require_writable
from labkit.plugins.exchange.formats import format_to_write
from labkit.process.interruption import is_being_written, lock_of, only_writer
from tests.full_disk import file_size_limit


def viewer(state, file):
    from labkit.plugins.pictures.viewer import Viewer

    Viewer(state).write(file)


def paraview(state, file):
    pytest.importorskip("h5py")
    from labkit.plugins.exchange.paraview import write_series

    write_series([state.snapshot()], file)


def exported(state, file):
    if file.suffix == ".vtkhdf":
        pytest.importorskip("h5py")
    format_to_write(file, None).write(state, file)


def sphere_pack(state, file):
    """Without the tilt of the cell, which a SpherePack cannot hold."""
    exported(state.replace(cell=np.diag(np.diag(state.cell))), file)


WRITERS = {
    "page.html": viewer,
    "series.vtkhdf": paraview,
    "grains.vtkhdf": exported,
    "grains.data": exported,
    "grains.spheres": sphere_pack,
}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("size", [0, 500, 5000])
def test_a_full_disk_leaves_the_earlier_file_and_nothing_else(name, size, soft_specimen, tmp_path):
    file = tmp_path / name
    file.write_text("what was there before")
    with file_size_limit(size), pytest.raises(OSError) as failure:
        WRITERS[name](soft_specimen, file)
    assert (failure.value.filename, failure.value.strerror) == (str(file), "File too large")
    assert [one.name for one in tmp_path.iterdir()] == [name] and file.read_text() == "what was there before"
    WRITERS[name](soft_specimen, file)
    assert file.stat().st_size > 5000


def test_a_file_for_paraview_keeps_no_space_that_it_does_not_need(soft_specimen, tmp_path):
    h5py = pytest.importorskip("h5py")
    file = tmp_path / "series.vtkhdf"
    paraview(soft_specimen, file)
    with h5py.File(file) as data:
        assert data["VTKHDF/grains/Points"].shape == (soft_specimen.number_of_grains, 3)
    assert file.stat().st_size < 1_000_000


def test_a_command_names_the_file_that_could_not_be_written(specimen_file, tmp_path, capsys):
    page = tmp_path / "p.html"
    with file_size_limit(1000):
        assert main(["picture", str(specimen_file), "-o", str(page)]) == 1
    assert capsys.readouterr().err == f"labkit: {page}: File too large\n" and not list(tmp_path.iterdir())


def test_the_files_of_the_material_law_are_whole(tmp_path, capsys):
    with file_size_limit(1000):
        assert main(["umat", "-o", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert (
        f"{tmp_path}/labkit_" in said and "cannot be written (File too large)" in said and not list(tmp_path.iterdir())
    )


def test_a_lock_does_not_follow_a_link(tmp_path):
    victim, file = tmp_path / "victim.txt", tmp_path / "r.run.nc"
    victim.write_text("precious")
    lock_of(file).symlink_to(victim)
    with pytest.raises(InputError, match="is a link: delete it"), only_writer(file):
        pass
    with pytest.raises(InputError, match=lock_of(file).name):
        is_being_written(file)
    assert victim.read_text() == "precious"


def test_a_temporary_file_is_new(tmp_path, monkeypatch):
    """Anyone who can guess its name might put a link there."""
    victim = tmp_path / "victim.txt"
    victim.write_text("precious")
    monkeypatch.setattr(atomic.secrets, "token_hex", lambda _: "guessed")
    link = tmp_path / f".a.txt.guessed.{os.getpid()}.tmp"
    link.symlink_to(victim)
    with pytest.raises(FileExistsError) as failure:
        atomic.write_text(tmp_path / "a.txt", "text")
    assert failure.value.filename == str(tmp_path / "a.txt") and victim.read_text() == "precious"


def test_two_threads_write_the_same_file_one_after_the_other(tmp_path):
    file = tmp_path / "a.txt"
    with contextlib.ExitStack() as stack:
        for text in ("first", "second"):
            stack.enter_context(atomic.whole_file(file)).write_text(text)
    assert file.read_text() == "first" and list(tmp_path.iterdir()) == [file]


def test_a_folder_is_tried_without_a_file_that_a_signal_could_leave(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "unlink", lambda *_, **__: None)
    require_writable(tmp_path / "a.txt")
    assert not list(tmp_path.iterdir())


def link_to(victim, link):
    victim.write_text("precious")
    link.symlink_to(victim)


def test_a_link_that_the_user_typed_is_followed(specimen_file, tmp_path):
    real, link = tmp_path / "real.html", tmp_path / "p.html"
    link_to(real, link)
    assert main(["picture", str(specimen_file), "-o", str(link)]) == 0
    assert link.is_symlink() and "<html" in real.read_text()


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["statistics", "s.state.nc", "--csv", "t.csv"], "t.csv.provenance.json"),
        (["picture", "s.state.nc"], "s.picture.png"),
        (["specimen", "--void-ratio", "0.7", "--grains", "100"], "e0.7_f0.15_r0.1_n100_s1.state.nc"),
        (["run", "cv", "s.state.nc"], "s_cv.run.nc"),
        (["umat", "-o", "."], "labkit_umat.f90"),
        (["export", "s.state.nc"], "s.contacts.csv"),
    ],
)
def test_a_link_that_the_user_did_not_type_is_refused(words, name, specimen_file, tmp_path, monkeypatch, capsys):
    """In a folder from somebody else it could lead to any file of the user."""
    (tmp_path / "s.state.nc").write_bytes(specimen_file.read_bytes())
    monkeypatch.chdir(tmp_path)
    link_to(tmp_path / "victim", tmp_path / name)
    assert main(words) == 2
    assert f"{name} is a link" in capsys.readouterr().err and (tmp_path / "victim").read_text() == "precious"


def test_a_folder_for_results_may_hold_no_links_to_them(tmp_path, monkeypatch, capsys):
    link_to(tmp_path / "victim", tmp_path / "demo.run.nc")
    assert main(["demo", "-o", str(tmp_path)]) == 2
    assert "demo.run.nc is a link" in capsys.readouterr().err and not (tmp_path / "demo.state.nc").exists()


def test_samples_are_not_added_to_the_target_of_a_link(tmp_path):
    pytest.importorskip("emcee")
    from labkit.plugins.laboratory_data.sampling import Sample, append_sample

    link_to(tmp_path / "victim", tmp_path / "samples.jsonl")
    with pytest.raises(InputError, match=r"samples.jsonl is a link"):
        append_sample(Sample({}, 100, 1, None, "", 1.0), tmp_path / "samples.jsonl")
    assert (tmp_path / "victim").read_text() == "precious"
