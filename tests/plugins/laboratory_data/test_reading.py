import subprocess
import sys

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.plugins.laboratory_data.comparing import scatter_between

COLUMNS = {
    "axial_strain": ("eps: 1", "%", "compression"),
    "volumetric_strain": ("epsv", "%", "tension"),
    "axial_stress": ("s1", "kPa", "compression"),
    "radial_stress": ("s3", "kPa", "compression"),
}
KINDS = {"strain_kind": "engineering", "stress_kind": "effective"}
ORIGIN = {"source": "this test", "licence": "CC0"}
CSV = """A table
test,eps: 1,epsv,s1,s3
[-],[%],[%],[kPa],[kPa]
A,0,0,100,100
A,1,-0.2,200,100
A,2,0.1,250,100
B,0,0,90,90
"""
PATH = lk.paths.ConstantRadialStress(pressure="100 kPa", strain=0.2)


@pytest.fixture()
def table(tmp_path):
    file = tmp_path / "table.csv"
    file.write_text(CSV)
    return file


def read(file, path=PATH, columns=COLUMNS, void_ratio=0.8, rows=None, **changed):
    rows = {"test": "A"} if rows is None else rows
    return lk.read_measured(file, path, columns, void_ratio=void_ratio, rows=rows, **{**KINDS, **ORIGIN, **changed})


FRESH = f"""
import labkit as lk
path = lk.paths.ConstantRadialStress(pressure="100 kPa", strain=0.2)
columns, words = {COLUMNS!r}, { ({**KINDS, **ORIGIN})!r}
measured = lk.read_measured("table.csv", path, columns, void_ratio=0.8, rows={{"test": "A"}}, **words)
print(measured.data.lab.q().values[-1])
"""


@pytest.mark.slow
def test_a_measured_test_is_the_first_thing_in_a_process(table):
    done = subprocess.run([sys.executable, "-c", FRESH], cwd=table.parent, capture_output=True, text=True)
    assert float(done.stdout) == pytest.approx(150e3), done.stderr


@pytest.mark.slow
def test_a_measured_test_is_a_run_file_with_source_and_licence(table, tmp_path):
    measured = read(table, name="sand")
    lk.write_measured(measured, tmp_path / "a.run.nc")
    again = lk.Run.open(tmp_path / "a.run.nc")
    assert again.engine == "laboratory" and again.data.attrs["licence"] == "CC0"
    assert again.data.attrs["Conventions"].startswith("CF")
    assert again.path == measured.path and again.path.strain == pytest.approx(-np.log(0.98))  # its end
    np.testing.assert_array_equal(again.data["stress"].values, measured.data["stress"].values)
    with pytest.raises(lk.InputError, match="measured in a laboratory"):
        lk.verify(again)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"columns": {**COLUMNS, "axial_strain": ("eps: 1", "%")}}, "positive sign"),
        ({"columns": {**COLUMNS, "axial_strain": ("eps: 1", "mm", "compression")}}, "unit of strain"),
        ({"columns": {**COLUMNS, "axial_strain": ("strain", "%", "compression")}}, "no line with the headers"),
        ({"columns": {key: COLUMNS[key] for key in [*COLUMNS][:3]}}, "two of"),
        ({"columns": {key: COLUMNS[key] for key in ("axial_strain", "axial_stress", "radial_stress")}}, "volumetric"),
        ({"void_ratio": None}, "void_ratio"),
        ({"rows": {"test": "C"}}, "no rows"),
        ({"strain_kind": "true"}, "engineering or logarithmic"),
        ({"stress_kind": "total"}, "pore_pressure"),
    ],
)
def test_what_is_missing_is_asked_for(table, change, message):
    with pytest.raises(lk.InputError, match=message):
        read(table, **change)


def test_the_misfit_is_in_units_of_the_scatter(table, tmp_path):
    measured = read(table)
    assert lk.misfit(measured, measured, {"stress_ratio": 0.1})["all"] == 0.0
    other = tmp_path / "other.csv"
    other.write_text(CSV.replace("200,100", "212,100"))
    shifted = read(other)
    assert lk.misfit(shifted, measured, {"q": 12e3})["q"] == pytest.approx(np.sqrt(1 / 3))
    assert scatter_between([shifted, measured], ["q"])["q"] == pytest.approx(12e3 / 2)  # one of two rows differs
    with pytest.raises(lk.InputError, match="one of stress_ratio"):
        lk.misfit(measured, measured, {"strength": 1.0})


def test_measured_points_are_drawn_behind_a_run(table):
    measured = read(table, name="sand")
    figure = measured.plot("test", data=read(table, name="again"))
    points = [line for axes in figure.axes for line in axes.lines if line.get_marker() == "o"]
    assert len(points) == 12 and all(line.get_linestyle() == "None" for line in points)
    with pytest.raises(lk.InputError, match="draws no data"):
        measured.plot("records", data=measured)


def test_several_runs_share_a_figure_under_names_of_their_own(table):
    one, other = read(table, name="sand"), read(table, name="sand")

    def labels(data):
        figure = one.plot("test", data=data)
        return [text.get_text() for text in figure.legends[0].get_texts()][:3]

    assert labels({"first": one, "second": other})[:2] == ["first", "second"]
    assert labels([other, other]) == ["sand", "sand 2", "run"]


@pytest.mark.slow
def test_the_commands_read_and_compare_measured_tests(table, tmp_path, capsys):
    columns = [f"{name}={':'.join(column)}" for name, column in COLUMNS.items()]
    kinds = ["--strain-kind", "engineering", "--stress-kind", "effective", "--source", "a test", "--licence", "CC0"]
    file = str(tmp_path / "a.run.nc")
    given = ["measured", "cr", str(table), "--pressure", "100kPa", "--void-ratio", "0.8", "--rows", "test=A", *kinds]
    assert main([*given, "--column", *columns, "-o", file]) == 0
    assert main(["misfit", file, "--measured", file, "--scatter", "stress_ratio=0.03"]) == 0
    assert "stress_ratio" in capsys.readouterr().out
    assert main([*given, "--column", "axial_strain=eps", "-o", file]) == 2
    assert "HEADER:UNIT:SIGN" in capsys.readouterr().err
    assert main([*given, "--column", "void_ratio=none: x:1", "-o", file]) == 2
    assert "none: x" in (said := capsys.readouterr().err) and "none: x:1" not in said
