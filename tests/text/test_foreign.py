"""Untrusted files that never end, or that expand when decompressed, are refused before they are read."""

import gzip
import io
import os
import struct
import zipfile
import zlib

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.grains.grading import read_grading
from labkit.plugins.exchange import read
from labkit.plugins.exchange.formats import format_of
from labkit.plugins.exchange.pairs import overlapping_pairs
from labkit.plugins.incremental.driver_file import read_test
from labkit.text import foreign

KNOWN = {"box": "4", "length_unit": "mm", "size": "radius"}


@pytest.fixture
def fifo(tmp_path):
    os.mkfifo(tmp_path / "f.csv")
    return tmp_path / "f.csv"


@pytest.mark.parametrize(
    "reader",
    [
        lambda file: read(file, **KNOWN),
        lambda file: read(file, format="vtk", **KNOWN),
        lambda file: read_grading(str(file)),
        lambda file: read_test(str(file), "kPa"),
        foreign.content_of,
    ],
)
def test_pipes_and_devices_are_refused(reader, fifo, tmp_path):
    endless = tmp_path / "endless.csv"
    endless.symlink_to("/dev/zero")
    for file in (fifo, endless):
        with pytest.raises(lk.InputError, match=file.name):
            reader(file)


def test_a_pipe_as_a_list_of_contacts_is_refused(fifo, tmp_path):
    (tmp_path / "a.txt").write_text("1 1 1 0.1\n2 2 2 0.1\n")
    with pytest.raises(lk.InputError, match=fifo.name):
        read(tmp_path / "a.txt", contacts=fifo, **KNOWN)


def test_a_command_with_a_pipe_ends_with_a_sentence(fifo, capsys):
    assert main(["statistics", str(fifo)]) == 2
    assert capsys.readouterr().err == f"labkit: {fifo} cannot be read (not a regular file): give another file\n"


@pytest.mark.parametrize("name", ["a.csv.gz", "a.npz"])
def test_what_fills_the_memory_is_refused(name, tmp_path, monkeypatch):
    monkeypatch.setattr(foreign, "FREE", 1_000_000)
    file, content = tmp_path / name, io.BytesIO()
    if name == "a.npz":
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            np.save(content, np.zeros((300_000, 4)))
            archive.writestr("position.npy", content.getvalue())
    else:
        file.write_bytes(gzip.compress(b"1 1 1 0.1\n" * 300_000))
    with pytest.raises(lk.InputError, match=r"holds more than \d+ MB when decompressed: give a smaller file"):
        read(file, **KNOWN)


@pytest.mark.parametrize("radius, message", [(0.9, "times the volume of the box"), (0.001, "has 29999 others within")])
def test_grains_with_too_many_pairs_to_list_are_refused(radius, message, tmp_path):
    """1e9 pairs in 300 kB, from a mistake in the unit of the radii or from a grain that is listed again and again."""
    file = tmp_path / "x.txt"
    file.write_text(f"1 1 1 {radius}\n" * 30_000)
    with pytest.raises(lk.InputError, match=message):
        read(file, **KNOWN)


def test_pairs_of_grains_of_very_different_sizes_are_listed():
    """A large grain reaches many small ones, and all of these count as pairs within its reach."""
    generator = np.random.default_rng(1)
    position, radius = generator.uniform(0.0, 1.0, (3000, 3)), np.full(3000, 0.01)
    radius[0] = 0.2
    pairs, _, overlap = overlapping_pairs(position, radius, np.eye(3))
    assert (pairs[:, 0] == 0).sum() > 80 and (overlap > 0.0).all()


@pytest.mark.parametrize(
    ("columns", "said"), [(2_000, "has 2000 columns: give a table of at most 1000"), (500_000, "cell that is too long")]
)
def test_a_table_with_too_many_columns_is_refused_at_once(columns, said, tmp_path):
    (tmp_path / "wide.txt").write_text(("1 " * columns + "\n") * 2)
    with pytest.raises(lk.InputError, match=said):
        read(tmp_path / "wide.txt", **KNOWN)


def test_only_its_name_gives_a_file_to_the_loader_of_yade(tmp_path):
    for name in ("a.txt", "notes.md"):
        file = tmp_path / name
        file.write_text("<!DOCTYPE boost_serialization> scene\n")
        with pytest.raises(lk.InputError, match="labkit does not read it"):
            format_of(file)
    assert format_of((tmp_path / "a.txt").rename(tmp_path / "a.xml")).name == "yade_save"


@pytest.mark.parametrize(
    "tag", ["!!set {a}", "!!omap {a: 1}", "!own {a: 1}", "!!python/object:os.system {a: 1}", "!!set []"]
)
def test_a_tag_in_yaml_changes_nothing(tag, tmp_path, capsys):
    (tmp_path / "c.yaml").write_text(f"specimens: {tag}\nruns: {tag}\n")
    assert main(["campaign", str(tmp_path / "c.yaml")]) == 2
    assert "\n  line 2: " in capsys.readouterr().err


def chunk(name, data):
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def picture(pixels=(1, 1), text=b""):
    """Return a PNG whose header says that it has this many pixels, with a compressed text."""
    size = chunk(b"IHDR", struct.pack(">IIBBBBB", *pixels, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + size + chunk(b"zTXt", b"provenance\0\0" + zlib.compress(text)) + chunk(b"IDAT", b"")


PICTURES = {
    "pixels": picture((100_000, 100_000)),
    "many": picture((12_000, 12_000)),
    "text": picture(text=bytes(10**7)),
    "cut": picture()[:30],
}


@pytest.mark.parametrize("content", PICTURES.values(), ids=PICTURES)
@pytest.mark.parametrize("words", [["info"], ["info", "--check"]])
def test_a_picture_that_would_fill_the_memory_is_refused(content, words, tmp_path, capsys):
    (tmp_path / "a.png").write_bytes(content)
    assert main([*words, str(tmp_path / "a.png")]) == 2
    assert "a.png is not a PNG that labkit wrote" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("pipe", "words"),
    [
        ("t.csv.provenance.json", ["info", "t.csv"]),
        ("t.png", ["info", "t.png"]),
        ("m.json", ["umat", "--parameters", "m.json", "-o", "u"]),
        ("m.json", "model cv --void-ratio 0.6 --pressure 100kPa --parameters m.json".split()),
    ],
)
def test_a_pipe_is_not_read(pipe, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.csv").write_text("1")
    os.mkfifo(pipe)
    assert main(words) == 2 and pipe in capsys.readouterr().err
