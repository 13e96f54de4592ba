import subprocess
import sys

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.plugins.laboratory_data.command import _column
from labkit.plugins.laboratory_data.comparing import scatter_between

COLUMNS = {
    "axial_strain": ("eps1", "%", "compression"),
    "volumetric_strain": ("epsv", "%", "tension"),
    "axial_stress": ("s1", "kPa", "compression"),
    "radial_stress": ("s3", "kPa", "compression"),
}
KINDS = {"strain_kind": "engineering", "stress_kind": "effective"}
ORIGIN = {"source": "this test", "licence": "CC0"}
CSV = """A table
test,eps1,epsv,s1,s3
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


def test_columns_become_logarithmic_strains_and_stresses_in_si_units(table):
    data = read(table).data
    assert data["axial_strain"].values == pytest.approx(-np.log1p([0, -0.01, -0.02]))
    assert data.lab.volumetric_strain().values == pytest.approx(-np.log1p([0, -0.002, 0.001]))  # tension positive
    assert data.lab.q().values == pytest.approx([0, 100e3, 150e3])
    assert data["void_ratio"].values == pytest.approx([0.8, 1.8 * 0.998 - 1, 1.8 * 1.001 - 1])


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


def test_headers_on_the_command_line_may_contain_colons():
    assert _column("void_ratio", "e: mean:1") == ("e: mean", "1")
    assert _column("axial_strain", "eps: 1:%:tension") == ("eps: 1", "%", "tension")


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


def test_total_stresses_need_the_pore_pressure(table, tmp_path):
    file = tmp_path / "undrained.txt"
    file.write_text("e q p u\n0 0 300 200\n0.01 60 320 240\n")
    columns = {
        "axial_strain": ("e", "1", "compression"),
        "deviatoric_stress": ("q", "kPa", "compression"),
        "mean_stress": ("p", "kPa", "compression"),
    }
    path = lk.paths.ConstantVolume(strain=0.1)
    with pytest.raises(lk.InputError, match="pore_pressure"):
        read(file, path, columns, rows={}, stress_kind="total")
    columns["pore_pressure"] = ("u", "kPa")
    data = read(file, path, columns, rows={}, stress_kind="total").data
    assert data.lab.mean_stress().values == pytest.approx([100e3, 80e3])
    assert data.lab.q().values == pytest.approx([0, 60e3])
    assert data.lab.volumetric_strain().values == pytest.approx([0, 0])  # the path keeps the volume


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"columns": {**COLUMNS, "axial_strain": ("eps1", "%")}}, "positive sign"),
        ({"columns": {**COLUMNS, "axial_strain": ("eps1", "mm", "compression")}}, "unit of strain"),
        ({"columns": {**COLUMNS, "axial_strain": ("strain", "%", "compression")}}, "no line with the headers"),
        ({"columns": {key: COLUMNS[key] for key in [*COLUMNS][:3]}}, "two of"),
        ({"columns": {key: COLUMNS[key] for key in ("axial_strain", "axial_stress", "radial_stress")}}, "volumetric"),
        ({"void_ratio": None}, "void_ratio"),
        ({"rows": {"test": "C"}}, "no rows"),
        ({"strain_kind": "true"}, "engineering or logarithmic"),
    ],
)
def test_what_is_missing_is_asked_for(table, change, message):
    with pytest.raises(lk.InputError, match=message):
        read(table, **change)


def test_a_group_of_an_ags4_file_brings_its_units(tmp_path):
    file = tmp_path / "lab.ags4"
    rows = [
        ["GROUP", "CTRD"],
        ["HEADING", "SAMP_ID", "CTRD_EAS", "CTRD_VOL", "CTRD_DEV", "CTRD_MEES"],
        ["UNIT", "", "%", "%", "kPa", "kPa"],
        ["TYPE", "ID", "2DP", "2DP", "1DP", "1DP"],
        ["DATA", "S1", "0.00", "0.00", "0.0", "100.0"],
        ["DATA", "S1", "0.50", "0.10", "30.0", "110.0"],
        ["DATA", "S2", "0.00", "0.00", "0.0", "90.0"],
    ]
    file.write_text("".join(",".join(f'"{cell}"' for cell in row) + "\r\n" for row in rows))
    columns = {
        "axial_strain": ("CTRD_EAS", None, "compression"),
        "volumetric_strain": ("CTRD_VOL", None, "compression"),
        "deviatoric_stress": ("CTRD_DEV", None, "compression"),
        "mean_stress": ("CTRD_MEES", None, "compression"),
    }
    data = read(file, columns=columns, rows={"SAMP_ID": "S1"}, group="CTRD").data
    assert data["axial_strain"].values == pytest.approx(-np.log1p([0, -0.005]))
    assert data.lab.mean_stress().values == pytest.approx([100e3, 110e3])
    with pytest.raises(lk.InputError, match="no group"):
        read(file, columns=columns, rows={}, group="TRET")


def test_an_oedometer_test_needs_only_void_ratios_and_axial_stresses(tmp_path):
    file = tmp_path / "oedometer.csv"
    file.write_text("stress;e\n25;0.90\n100;0.88\n400;0.85\n")
    columns = {"axial_stress": ("stress", "kPa", "compression"), "void_ratio": ("e", "1")}
    measured = read(file, lk.paths.Oedometer(strain=0.2), columns, None, rows={})
    assert measured.data["axial_strain"].values == pytest.approx(np.log(1.9 / np.array([1.9, 1.88, 1.85])))
    assert measured.data["void_ratio"].values == pytest.approx([0.9, 0.88, 0.85])
    assert lk.misfit(measured, measured, {"axial_stress": 1e3, "void_ratio": 0.01})["all"] == 0.0


def test_a_cyclic_test_is_compared_along_its_cycles(tmp_path):
    time = np.linspace(0.0, 3.0, 121)
    rows = [f"{0.1 * np.sin(2 * np.pi * t):.6f} {40 * np.sin(2 * np.pi * t):.6f} {100 - 25 * t:.6f}" for t in time]
    file = tmp_path / "cyclic.txt"
    file.write_text("\n".join(["e q p", *rows]))
    columns = {
        "axial_strain": ("e", "%", "compression"),
        "deviatoric_stress": ("q", "kPa", "compression"),
        "mean_stress": ("p", "kPa", "compression"),
    }
    measured = read(file, lk.paths.UndrainedCycles(amplitude="40 kPa", cycles=3), columns, rows={})
    assert float(measured.data.lab.cycles()[-1]) == pytest.approx(3.0, abs=0.3)
    assert lk.misfit(measured, measured, {"r_u": 0.05})["r_u"] == 0.0
    assert float(measured.data.lab.pore_pressure_ratio().max()) == pytest.approx(0.75)
    measured.plot("cycles", data=measured)


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
    assert main([*given, "--column", "axial_strain=eps1", "-o", file]) == 2
    assert "HEADER:UNIT:SIGN" in capsys.readouterr().err
