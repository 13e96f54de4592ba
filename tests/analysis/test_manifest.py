"""A manifest keeps the provenance of each file of its folder, and a figure of few colours its own."""

import json

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from analysis.manifest import MANIFEST, collect, provenance
from analysis.pictures import COLOURS, reduce_colours, save
from labkit.files import file_sha256, provenance_of, write_with_provenance


def test_a_manifest_says_common_parts_once_and_nothing_is_lost(tmp_path):
    (tmp_path / "data.csv").write_text("x\n1\n")
    names = ("a.csv", "b.csv", "page.md")
    for name in names:
        write_with_provenance(tmp_path / name, name, [tmp_path / "data.csv"], f"./lab {name == 'page.md'}")
    known = {name: provenance_of(tmp_path / name) for name in names}
    collect(tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {"data.csv", MANIFEST, *names}
    assert {name: provenance(tmp_path / name) for name in names} == known
    assert len(json.loads((tmp_path / MANIFEST).read_text())) == 2
    assert provenance(tmp_path / "data.csv") is None


def test_a_file_that_is_written_again_or_is_gone(tmp_path):
    for name in ("a.csv", "b.csv", "c.csv"):
        write_with_provenance(tmp_path / name, "first", command="first")
    collect(tmp_path)
    write_with_provenance(tmp_path / "a.csv", "second", command="second")
    assert provenance(tmp_path / "a.csv")["command"] == "second"  # before it is collected
    (tmp_path / "c.csv").unlink()
    collect(tmp_path)
    assert provenance(tmp_path / "a.csv")["sha256"] == file_sha256(tmp_path / "a.csv")
    assert [provenance(tmp_path / name)["command"] for name in ("a.csv", "b.csv")] == ["second", "first"]
    assert "c.csv" not in (tmp_path / MANIFEST).read_text()


def test_a_figure_keeps_its_look_provenance_and_resolution(tmp_path):
    figure, axes = plt.subplots(figsize=(4, 3))
    axes.imshow(np.linspace(0.0, 1.0, 1200).reshape(30, 40))
    axes.plot([0, 39], [0, 29], "r")
    figure.savefig(tmp_path / "all.png", dpi=120)
    save(figure, tmp_path / "few.png", [tmp_path / "all.png"], "./lab x", 120)
    with Image.open(tmp_path / "all.png") as every, Image.open(tmp_path / "few.png") as few:
        assert few.mode == "P" and len(few.getcolors()) <= COLOURS and few.info["dpi"] == every.info["dpi"]
        first, second = (np.asarray(image.convert("RGB"), dtype=int) for image in (every, few))
    assert np.abs(first - second).mean() < 1.0 and (tmp_path / "few.png").stat().st_size < len(first.tobytes()) / 10
    known = provenance_of(tmp_path / "few.png")
    assert known["command"] == "./lab x" and known["inputs"][0]["file"] == "all.png"
    before = (tmp_path / "few.png").read_bytes()
    reduce_colours(tmp_path / "few.png")
    assert (tmp_path / "few.png").read_bytes() == before
