"""labkit umat: the files it writes, and invalid input."""

import csv

import pytest

from benchmarks import points
from benchmarks.__main__ import main as bench
from labkit.cli import main
from labkit.model.parameters import Model
from labkit.plugins.umat.library import missing_compilers
from labkit.plugins.umat.props import PointStart, properties

pytestmark = pytest.mark.slow


def test_files_of_a_calibrated_model(tmp_path):
    model = Model().with_parameters(c_Z=0.2)
    (tmp_path / "calibrated.json").write_text(model.to_json())
    arguments = ["--parameters", str(tmp_path / "calibrated.json"), "--void-ratio", "0.65", "--pressure", "200kPa"]
    assert main(["umat", "-o", str(tmp_path / "law"), *arguments, "--stress-unit", "kPa"]) == 0
    with (tmp_path / "law" / "props.csv").open() as file:
        rows = list(csv.DictReader(file))
    expected = properties(model, PointStart(0.65, 2e5), stress_unit=1e3)
    assert [(row["name"], float(row["value"])) for row in rows] == list(expected.items())
    lines = (tmp_path / "law" / "labkit_material.inp").read_text().splitlines()
    end = lines.index("*DEPVAR")
    assert [float(value) for line in lines[2:end] for value in line.split(",")] == list(expected.values())
    assert lines[1] == "*USER MATERIAL, CONSTANTS=30, UNSYMM" and lines[end + 1] == "21,"
    assert all(len(line.split(",")) <= 8 for line in lines[2:end])  # Abaqus reads eight values a line
    assert "subroutine umat(" in (tmp_path / "law" / "labkit_umat.f90").read_text()
    assert not (tmp_path / "law" / "liblabkit_umat.so").exists()


@pytest.mark.skipif(bool(missing_compilers()), reason="gfortran or gcc not installed: apt-get install gfortran gcc")
def test_build(tmp_path):
    assert main(["umat", "-o", str(tmp_path), "--build"]) == 0
    assert (tmp_path / "liblabkit_umat.so").stat().st_size > 1000


def test_the_speed_of_both_laws(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(points, "POINTS", 20)
    assert bench(["umat-speed", "-o", str(tmp_path / "speed.txt")]) == 0
    lines = (tmp_path / "speed.txt").read_text().splitlines()
    assert lines == capsys.readouterr().out.splitlines() and len(lines) == 1 + len(points.SIZES) * 2 - 3 * bool(
        missing_compilers()
    )
    assert "with the consistent tangent" in lines[1]
    assert bench(["umat-speed", "-o", str(tmp_path / "none" / "speed.txt")]) == 2


@pytest.mark.parametrize(
    "wrong", [["--void-ratio", "0.8"], ["--void-ratio", "-1"], ["--tolerance", "0"], ["--parameters", "none.json"]]
)
def test_invalid_input_writes_nothing(tmp_path, capsys, wrong):
    assert main(["umat", "-o", str(tmp_path / "law"), *wrong]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert not (tmp_path / "law").exists()


def test_build_without_a_compiler(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["umat", "-o", str(tmp_path / "law"), "--build"]) == 2
    assert "apt-get install gfortran" in capsys.readouterr().err


@pytest.mark.skipif(bool(missing_compilers()), reason="gfortran or gcc not installed: apt-get install gfortran gcc")
def test_the_compiler_writes_nothing_through_a_link(tmp_path):
    """gfortran would write its modules where the links lead."""
    folder, victim = tmp_path / "law", tmp_path / "victim"
    folder.mkdir()
    victim.write_text("precious")
    for name in ("labkit_model.mod", "labkit_model.mod0", "labkit_mgis.o"):
        (folder / name).symlink_to(victim)
    assert main(["umat", "-o", str(folder), "--build"]) == 0
    assert victim.read_text() == "precious" and (folder / "liblabkit_umat.so").stat().st_size > 1000
