"""The RO-Crate of a campaign, read back with ro-crate-py; a folder like that of a finished campaign."""

import hashlib

import pytest

import labkit as lk
from labkit.cli import main

pytestmark = pytest.mark.slow

rocrate = pytest.importorskip("rocrate.rocrate")


@pytest.fixture(scope="module")
def folder(tmp_path_factory, soft_specimen):
    """Make the files of a campaign with one specimen and one run, by labkit's functions."""
    place = tmp_path_factory.mktemp("crate")
    (place / "mine.yaml").write_text(
        "specimens: {soft: {void_ratio: 0.66, grains: 200}}\nruns: {cv: {path: cv, specimen: soft}}\n"
    )
    folder = place / "mine"
    for name in ("specimens", "runs", ".snakemake", "logs"):
        (folder / name).mkdir(parents=True)
    (folder / "campaign.yaml").write_text((place / "mine.yaml").read_text())
    (folder / "logs" / "left_out.md").write_text("log")
    specimen = folder / "specimens" / "soft.state.nc"
    lk.write_state(specimen, soft_specimen)
    assert main(["run", "cv", str(specimen), "--strain", "1e-3", "--engine", "fused", "-o",
                 str(folder / "runs" / "cv.run.nc")]) == 0  # fmt: skip
    return place


def test_lists_every_result_with_its_hash_and_what_made_it(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert main(["campaign", "mine.yaml", "--crate"]) == 0
    crate = rocrate.ROCrate(folder / "mine")
    files = {entity.id: entity for entity in crate.data_entities}
    assert set(files) == {"campaign.yaml", "specimens/soft.state.nc", "runs/cv.run.nc"}
    for name, entity in files.items():
        assert entity["sha256"] == hashlib.sha256((folder / "mine" / name).read_bytes()).hexdigest()
    action = crate.dereference("#made-runs/cv.run.nc")
    assert action["name"].startswith("labkit run cv") and action["result"] == files["runs/cv.run.nc"]
    assert (
        action["object"] == [files["specimens/soft.state.nc"]] or action["object"] == files["specimens/soft.state.nc"]
    )
    assert action["instrument"]["softwareVersion"] == lk.__version__


def test_another_folder_is_refused(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(["campaign", "mine.yaml", "--folder", "elsewhere", "--crate"]) == 2
    assert "is not the folder of a campaign" in capsys.readouterr().err
