"""Provenance: every output contains it, and the hashes reveal changes."""

import json
import shutil
import subprocess
import sys

import netCDF4
import numpy as np
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

import labkit as lk
from labkit.files import provenance
from labkit.grains.state import grains_in_cell
from labkit.model import Model
from tests.changed import changed

pytestmark = pytest.mark.slow

KNOWN = ("command", "made", "labkit_version", "commit", "python", "libraries", "machine", "inputs", "seed")


@pytest.fixture(scope="module")
def made(tmp_path_factory, labkit_command):
    """A folder with a specimen, a run and figures, simulated with the fused engine."""
    folder = tmp_path_factory.mktemp("made")
    for words in (
        "specimen --void-ratio 0.606 --step1-friction 0.06 --grains 120 --seed 7 --engine fused -o s.state.nc",
        "consolidate s.state.nc --pressure 0.5e6 --engine fused -o c.state.nc",
        "bond s.state.nc --bond-strength 2MPa --bond-shear-strength 2MPa -o b.state.nc",
        "run cv c.state.nc --strain 0.01 --rate 40 --snapshots 1 --engine fused -o r.run.nc",
        "figure shares r.run.nc -o f.png",
        "figure shares r.run.nc -o f.svg --csv t.csv",
    ):
        done = labkit_command(*words.split(), cwd=folder)
        assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def folder(made, tmp_path):
    """A copy of it."""
    return shutil.copytree(made, tmp_path / "copy")


def test_every_output_has_its_provenance_and_changes_are_detected(folder, labkit_command):
    inputs = {"s.state.nc": [], "b.state.nc": ["s.state.nc"], "c.state.nc": ["s.state.nc"], "r.run.nc": ["c.state.nc"]}
    drawn = {key: ["r.run.nc"] for key in ("f.png", "f.svg", "t.csv")}
    inputs |= drawn
    for name, sources in inputs.items():
        known = provenance.provenance_of(folder / name)
        assert set(KNOWN) - set(known) <= ({"seed"} if name in drawn else set())
        assert [item["file"] for item in known["inputs"]] == sources
        assert known["command"].startswith("labkit ") and known["libraries"]["numpy"] and known["machine"]["cores"]
        assert known.get("seed", 7) == 7
        for source in known["inputs"]:
            assert source["sha256"] == provenance.file_sha256(folder / source["file"])
        done = labkit_command("info", name, "--check", cwd=folder)
        assert done.returncode == 0 and "same" in done.stdout and known["command"] in done.stdout

    (folder / "t.csv").write_text("changed")
    done = labkit_command("info", "t.csv", "--check", cwd=folder)
    assert done.returncode == 1 and "differs" in done.stdout
    with netCDF4.Dataset(folder / "c.state.nc", "a") as state:
        state["velocity"][0, 0] = 1e-9
    for name, item in (("c.state.nc", "the data of this file"), ("r.run.nc", "input c.state.nc")):
        done = labkit_command("info", name, "--check", cwd=folder)
        assert done.returncode == 1 and any(item in line and "differs" in line for line in done.stdout.splitlines())
    (folder / "c.state.nc").unlink()
    done = labkit_command("info", "r.run.nc", "--check", cwd=folder)
    assert done.returncode == 1 and "missing" in done.stdout


def test_the_data_hash_covers_only_the_data(folder, labkit_command):
    """A specimen that is prepared again has the same data hash, although the provenance in the file differs."""
    (folder / "again").mkdir()
    words = "specimen --void-ratio 0.606 --step1-friction 0.06 --grains 120 --seed 7 --engine fused -o again/s.state.nc"
    assert labkit_command(*words.split(), cwd=folder).returncode == 0
    hashes = {}
    for name in ("s.state.nc", "again/s.state.nc"):
        with netCDF4.Dataset(folder / name) as state:
            hashes[name] = state.data_sha256, provenance.file_sha256(folder / name)
    assert hashes["s.state.nc"][0] == hashes["again/s.state.nc"][0]
    assert hashes["s.state.nc"][1] != hashes["again/s.state.nc"][1]


def test_checking_a_file_without_hashes_fails(folder, labkit_command):
    with netCDF4.Dataset(folder / "s.state.nc", "a") as state:
        del state.data_sha256, state.provenance
    done = labkit_command("info", "s.state.nc", cwd=folder)
    assert done.returncode == 0 and "provenance" not in done.stdout
    done = labkit_command("info", "s.state.nc", "--check", cwd=folder)
    assert done.returncode == 2 and "holds no hashes" in done.stderr


def test_only_a_checkout_of_labkit_has_a_commit(tmp_path):
    """A copy of labkit inside another repository has no commit of labkit."""
    root = provenance.Path(provenance.__file__).parents[1]
    shutil.copytree(root, tmp_path / "site" / "labkit", ignore=shutil.ignore_patterns("__pycache__"))
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b.c", "-C", str(tmp_path)]
    for words in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "x"]):
        subprocess.run([*git, *words], check=True)
    code = "import json, labkit.files.provenance as p; print(json.dumps(p.commit()))"
    for parent, expected in (("site", ""), (root.parent, None)):
        done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path / parent, capture_output=True, text=True)
        commit = json.loads(done.stdout)
        if expected is not None:
            assert commit == expected
        elif (root.parent / ".git").exists():
            assert len(commit.removesuffix("+changes")) == 40


@pytest.mark.parametrize(
    "words", ['{"machine": 1}', '{"libraries": null}', '{"inputs": [1]}', '{"inputs": [{"file": 1}]}', "[]", "{"]
)
def test_a_provenance_of_another_structure_is_damaged(words, tmp_path):
    """In a state file, in a file beside, and in a picture."""
    state, table, picture = tmp_path / "s.state.nc", tmp_path / "t.csv", tmp_path / "p.png"
    lk.write_state(state, grains_in_cell(lk.Scene(), np.full(1, 1e-4), np.zeros((1, 3)), 1e-3 * np.eye(3)))
    with changed(state) as dataset:
        dataset.provenance = words
    with pytest.raises(lk.InputError, match=r"s.state.nc is damaged \(the attribute provenance is not a"):
        lk.read_state(state)
    table.write_text("1")
    (tmp_path / "t.csv.provenance.json").write_text(words)
    png = PngInfo()
    png.add_text("provenance", words)
    Image.new("L", (1, 1)).save(picture, pnginfo=png)
    for file in (table, picture):
        with pytest.raises(lk.InputError, match=r"is damaged: restore a copy"):
            provenance.provenance_of(file)


def test_path_files_their_tables_and_sieve_curves_are_inputs(soft_specimen, labkit_command, tmp_path):
    lk.write_state(tmp_path / "s.state.nc", soft_specimen)
    (tmp_path / "p.yaml").write_text("path: steps\nsteps:\n  - table: t.csv\n")
    (tmp_path / "t.csv").write_text("strain_zz [%]\n0\n0.1\n")
    (tmp_path / "curve.csv").write_text("diameter_mm,passing_percent\n0.1,0\n0.2,100\n")
    run = ["run", "p.yaml", "s.state.nc", "--settings", "quick", "-o", "r.run.nc"]
    made = ["specimen", "--void-ratio", 0.6, "--grains", 150, "--grading", "curve.csv", "-o", "c.state.nc"]
    (tmp_path / "m.json").write_text(Model().to_json())
    on_model = ["model", "p.yaml", "--void-ratio", 0.67, "--pressure", "100kPa", "--parameters", "m.json"]
    measured = ["measured", "p.yaml", "lab.csv", "--void-ratio", 0.6, "--strain-kind", "engineering"]
    measured += ["--stress-kind", "effective", "--source", "x", "--licence", "y"]
    measured += ["--column", "axial_strain=e:%:compression"]
    measured += ["axial_stress=s1:kPa:compression", "radial_stress=s3:kPa:compression"]
    measured += ["volumetric_strain=v:%:compression"]
    (tmp_path / "lab.csv").write_text("e,s1,s3,v\n0,100,100,0\n0.05,150,100,0.01\n0.09,160,100,0.02\n")
    for words, output, inputs in (
        (run, "r.run.nc", ["s.state.nc", "p.yaml", "t.csv"]),
        (made, "c.state.nc", ["curve.csv"]),
        ([*on_model, "-o", "m.run.nc"], "m.run.nc", ["p.yaml", "t.csv", "m.json"]),
        ([*measured, "-o", "l.run.nc"], "l.run.nc", ["p.yaml", "t.csv", "lab.csv"]),
        (["figure", "test", "r.run.nc", "-o", "f.png"], "f.png", ["r.run.nc"]),
    ):
        done = labkit_command(*words, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert [row["file"] for row in provenance.provenance_of(tmp_path / output)["inputs"]] == inputs
    assert set(dict(provenance.check(tmp_path / "m.run.nc")).values()) == {"same"}
    path = lk.read_path(tmp_path / "p.yaml")  # outside a command, what else was read is not known to be an input
    assert lk.run(soft_specimen, path, progress=False).provenance["inputs"] == []
