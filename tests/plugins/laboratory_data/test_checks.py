"""What looks wrong in a measured test is said, with what to give instead; nothing is dropped without a word."""

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.plugins.laboratory_data import preview
from tests.plugins.laboratory_data.columns import of_columns

GIVEN = {"strain_kind": "engineering", "stress_kind": "effective", "source": "own numbers", "licence": "CC0"}
COLUMNS = of_columns(e1="eps:%", ev="epsv:%", s1="s1:kPa", s3="s3:kPa")
CR = lk.paths.ConstantRadialStress(pressure="100 kPa", strain=0.2)
ROWS = ["0,0,100,100", "1,0.2,200,100", "2,0.3,250,100", "4,0.2,280,100", "8,-0.4,270,100"]


def read(folder, rows=ROWS, head="eps,epsv,s1,s3", path=CR, columns=COLUMNS, **changed):
    file = folder / "test.csv"
    file.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    return lk.read_measured(file, path, columns, **{"void_ratio": 0.8, **GIVEN, **changed})


def replaced(*, row, text):
    return [*ROWS[:row], text, *ROWS[row + 1 :]]


def test_a_good_test_has_no_remarks_and_exact_values(tmp_path):
    measured = read(tmp_path)
    strain = -np.log1p(-np.array([0.0, 0.01, 0.02, 0.04, 0.08]))
    volume = np.log1p(-np.array([0.0, 0.002, 0.003, 0.002, -0.004]))
    data = measured.data
    np.testing.assert_allclose(data["axial_strain"].values, strain, rtol=1e-12, atol=0)
    np.testing.assert_allclose(data["volume"].values, np.exp(volume), rtol=1e-12)
    np.testing.assert_allclose(data["void_ratio"].values, 1.8 * np.exp(volume) - 1.0, rtol=1e-12)
    np.testing.assert_allclose(data.lab.q().values, [0.0, 100e3, 150e3, 180e3, 170e3], rtol=1e-12)
    assert "note" not in preview(measured)


def test_the_preview_says_rows_ranges_units_and_unused_columns(tmp_path):
    measured = read(tmp_path, [f"{row},20.5" for row in ROWS], "eps,epsv,s1,s3,T")
    lines = preview(measured).splitlines()
    assert lines[0] == "test.csv: 5 rows, lines 2 to 6"
    assert lines[1].split() == ["axial_strain", "0", "to", "8", "%", "from", "'eps'"]
    assert lines[3].split() == ["axial_stress", "100", "to", "280", "kPa", "from", "'s1'"]
    assert lines[5].strip() == "not used: T"
    lk.write_measured(measured, tmp_path / "a.run.nc")
    assert preview(lk.Run.open(tmp_path / "a.run.nc")) == preview(measured)
    with pytest.raises(lk.InputError, match="give a test read by read_measured"):
        preview(lk.Run(measured.data.drop_attrs()))


CASES = {
    "second test": ({"rows": [*ROWS, *ROWS]}, "falls from 8.338 % to 0 % in line 7: is this a second test"),
    "second test, column": (
        {"rows": [f"{row},{name}" for name in "AB" for row in ROWS], "head": "eps,epsv,s1,s3,hole"},
        "Give --rows hole=A or hole=B",
    ),
    "second test, headers": (
        {"rows": [*ROWS, "eps,epsv,s1,s3", *ROWS]},
        r"these headers in the lines 1 and 7 \(below '8 -0.4 270 100'\): give --header with one of them",
    ),
    "radial stress of another pressure": (
        {"rows": [row.replace(",100", ",400") for row in ROWS]},
        "radial stress is 400 kPa in line 2, and --pressure says 100 kPa: give --pressure 400kPa; or, if .* total",
    ),
    "no stresses": (
        {"rows": [f"{row.rsplit(',', 2)[0]},0,0" for row in ROWS]},
        "--pressure says 100 kPa: give the column of the stresses that were measured",
    ),
    "MPa for kPa": (
        {
            "columns": {
                **COLUMNS,
                **{k: (COLUMNS[k][0], "MPa", "compression") for k in ("axial_stress", "radial_stress")},
            }
        },
        "--pressure says 100 kPa: is the unit of the stresses right. They are about 1e.03 times too large",
    ),
    "q in Pa": (
        {
            "rows": ["0,0,0,100", "1,0,100000,133", "2,0,150000,150"],
            "columns": {
                **{k: COLUMNS[k] for k in ("axial_strain", "volumetric_strain")},
                "deviatoric_stress": ("s1", "kPa", "compression"),
                "mean_stress": ("s3", "kPa", "compression"),
            },
        },
        r"effective radial stress is -4.985e\+04 kPa in line 4, .*unit \(deviatoric stress is 1000 times mean stress\)",
    ),
    "q in Pa beside the radial stress": (
        {
            "rows": ["0,0,0,100", "1,0,100000,100", "2,0,150000,100"],
            "columns": {
                **{k: COLUMNS[k] for k in ("axial_strain", "volumetric_strain", "radial_stress")},
                "deviatoric_stress": ("s1", "kPa", "compression"),
            },
        },
        r"q/p is 2.99 in line 4, more than any soil reaches: check the units of the stresses .deviatoric",
    ),
    "wrong sign of the stresses": (
        {"columns": {**COLUMNS, "radial_stress": ("s3", "kPa", "tension")}},
        "effective radial stress is -100 kPa in line 2, not above 0 in 5 rows: check its sign",
    ),
    "wrong sign of the strain": (
        {"columns": {**COLUMNS, "axial_strain": ("eps", "%", "tension")}},
        "axial strain goes to -7.696 %, and the path cr to 20 %: give the other positive sign",
    ),
    "percent read as fractions": (
        {"columns": {**COLUMNS, "axial_strain": ("eps", "1", "compression")}},
        "axial_strain reaches 8, and an engineering strain is less than 1 .100 %.: give the unit %",
    ),
    "volumetric strain in percent": (
        {
            "columns": {**COLUMNS, "volumetric_strain": ("epsv", "1", "compression")},
            "rows": [row.replace(",0.", ",-2.") for row in ROWS],
        },
        "volumetric strain reaches 230 %: is its unit right",
    ),
    "void ratio in percent": ({"void_ratio": 62.0}, "void ratio is 62.* not between 0.1 and 3: give --void-ratio 0.62"),
    "void ratio as a share of percent": ({"void_ratio": 0.0062}, "not between 0.1 and 3: check --void-ratio"),
    "void ratio of 0": ({"void_ratio": 0.0}, "not between 0.1 and 3"),
    "third stress": (
        {
            "rows": [f"{row},{q}" for row, q in zip(ROWS, (0, 100, 150, 200, 170), strict=True)],
            "head": "eps,epsv,s1,s3,q",
            "columns": {**COLUMNS, "deviatoric_stress": ("q", "kPa", "compression")},
        },
        "deviatoric stress is 200 kPa in line 5, but 180 kPa follows from the other stresses: leave out",
    ),
    "volumetric strain against the void ratio": (
        {
            "rows": [f"{row},{e}" for row, e in zip(ROWS, (0.8, 0.83, 0.85, 0.83, 0.7), strict=True)],
            "head": "eps,epsv,s1,s3,e",
            "columns": {**COLUMNS, "void_ratio": ("e", "1")},
            "void_ratio": None,
        },
        "void ratio is 0.7 in line 6, but 0.8072 follows from the volumetric strain: check its sign",
    ),
    "unit of the header": (
        {"head": "eps,epsv,s1 [Pa],s3", "columns": {**COLUMNS, "axial_stress": ("s1 [Pa]", "kPa", "compression")}},
        r"axial_stress has the unit kPa, but the file says Pa for 's1 \[Pa\]': give axial_stress=s1 \[Pa\]:Pa:",
    ),
    "unit below the header": (
        {"rows": ["-,%,kPa,kPa", *ROWS]},
        "axial_strain has the unit %, but the file says - for 'eps': give axial_strain=eps:-:compression",
    ),
    "undrained test as cr": (
        {"rows": ["0,0,100,100", "1,0,130,60", "2,0,140,45", "3,0,150,50", "4,0,160,55"]},
        "the path cr holds the radial stress, but it changes to 45 kPa in line 4: give .* cv if it is undrained",
    ),
    "drained test as cv": (
        {"path": lk.paths.ConstantVolume(strain=0.2)},
        "path cv keeps the volume, but the volumetric strain reaches 0.4.* give the path of a drained test",
    ),
    "stresses of nothing": (
        {"rows": ["0,0,0.1,0.1", "1,0,0.2,0.1"], "path": lk.paths.ConstantVolume(strain=0.2)},
        "stresses reach 0.2 kPa: is their unit right",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_what_looks_wrong_stops_the_reading(tmp_path, name):
    given, message = CASES[name]
    with pytest.raises(lk.InputError, match=message):
        read(tmp_path, **given)
    if "engineering" not in message:  # no logarithmic strain follows from it
        measured = read(tmp_path, accept=True, **given)
        assert preview(measured).count("note: ") >= 1 and measured.data.sizes["time"] >= 1


def test_unloading_and_small_tension_are_noted(tmp_path):
    rows = [*ROWS[:3], "1.5,0.25,150,100", "1.2,0.25,101,100", *ROWS[3:]]
    assert "goes back by up to 0.8" in preview(read(tmp_path, rows))
    rows = ["0,0,100,100", "1,0,50,20", "2,0,0,0", "3,0,0.5,-0.1"]
    measured = read(tmp_path, rows, path=lk.paths.ConstantVolume(strain=0.2))
    assert "effective radial stress is -0.1 kPa in line 5, not above 0 in 2 rows" in preview(measured)


def test_strains_that_may_be_fractions_are_noted(tmp_path):
    measured = read(tmp_path, ["0,0,100,100", "0.1,0,200,100", "0.2,0,220,100"])
    assert "reaches only 0.2002 %: is its unit right" in preview(measured)


def test_rows_in_reverse_order_are_refused(tmp_path):
    with pytest.raises(lk.InputError, match="0 in the last row: are the rows in reverse order"):
        read(tmp_path, ROWS[::-1], accept=True)


def test_a_path_with_a_shear_strain_is_refused(tmp_path):
    with pytest.raises(lk.InputError, match=r"path simple_shear has a shear strain.*e.g. cr"):
        read(tmp_path, path=lk.paths.SimpleShear(pressure="100 kPa", strain=0.2))


def test_a_printed_table_with_repeated_headers_is_one_test_if_the_user_says_so(tmp_path):
    measured = read(tmp_path, [*ROWS[:3], "eps,epsv,s1,s3", *ROWS[3:]], accept=True)
    assert measured.data.sizes["time"] == 5 and "line 5: left out" in preview(measured)
    assert list(
        read(tmp_path, [*ROWS, "eps,epsv,s1,s3", *ROWS[:3]], header=7).data["axial_strain"].values
    ) == pytest.approx(-np.log1p([0.0, -0.01, -0.02]))


def test_total_stresses_are_checked_as_effective_ones(tmp_path):
    rows = ["0,0,400,400,300", "1,0.2,500,400,300", "2,0.3,550,400,300"]
    columns = {**COLUMNS, "pore_pressure": ("u", "kPa")}
    measured = read(tmp_path, rows, "eps,epsv,s1,s3,u", columns=columns, stress_kind="total")
    np.testing.assert_allclose(measured.data.lab.mean_stress().values[0], 100e3, rtol=1e-12)
    with pytest.raises(lk.InputError, match=r"radial stress is 400 kPa.* says 100 kPa: give --pressure 400kPa "):
        read(tmp_path, rows, "eps,epsv,s1,s3,u", columns=columns)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (
            {"pore_pressure": ("u", "kPa", "compression")},
            "column pore_pressure=u:kPa:compression takes no sign: give pore_pressure=u:kPa",
        ),
        ({"axial_stres": ("s1", "kPa", "compression")}, "column axial_stres is unknown: give 'axial_stress'"),
        ({"mean_stress": ("s1", "kPa", "compression")}, "the column 's1' is given for axial_stress and mean_stress"),
        ({"axial_strain": ("eps", "mm", "compression")}, "mm, which is not a unit of strain: .*divide displacements"),
        ({"axial_stress": ("s1", "kpas", "compression")}, "not a unit of stress: give 'kPa'"),
        (
            {"axial_stress": ("s1", None, "compression")},
            "has no unit, nor does the file state it: give axial_stress=s1:UNIT:SIGN",
        ),
    ],
)
def test_columns_that_cannot_be_meant(tmp_path, columns, message):
    with pytest.raises(lk.InputError, match=message):
        read(tmp_path, columns={**COLUMNS, **columns})


def test_rows_beyond_the_strain_of_the_path_are_counted(tmp_path):
    path = lk.paths.ConstantRadialStress(pressure="100 kPa", strain=0.03)
    assert "2 rows beyond the strain 0.03 of the path (logarithmic) are left out" in preview(read(tmp_path, path=path))
    path = lk.paths.ConstantRadialStress(pressure="100 kPa", strain=0.005)
    with pytest.raises(lk.InputError, match="give a larger --strain"):
        read(tmp_path, path=path)
    with pytest.raises(lk.InputError, match="axial strain is 0 in every row"):
        read(tmp_path, ["0,0,100,100", "0,0,101,100"])


@pytest.mark.slow
def test_the_command_prints_the_preview_and_its_errors(tmp_path, capsys):
    (tmp_path / "t.csv").write_text("\n".join(["eps;epsv;s1;s3;T", *(row.replace(",", ";") + ";20" for row in ROWS)]))
    output = str(tmp_path / "a.run.nc")
    columns = [f"{name}={':'.join(column)}" for name, column in COLUMNS.items()]
    words = [*"--strain-kind engineering --stress-kind effective --source - --licence - -o".split(), output]

    def tried(path, *more, columns=columns):
        code = main(["measured", path, str(tmp_path / "t.csv"), *words, "--column", *columns, *more])
        said = capsys.readouterr()
        return code, said.out + said.err

    ratio = ["--void-ratio", "0.8"]
    code, said = tried("cr", *ratio, "--pressure", "100kPa")
    assert code == 0 and "5 rows, lines 2 to 6" in said and "not used: T" in said and "100 to 280 kPa" in said
    code, said = tried("cr", *ratio, "--pressure", "400kPa")
    assert code == 2 and "give --pressure 100kPa" in said and "--accept" in said
    assert tried("cr", *ratio, "--pressure", "400kPa", "--accept")[0] == 0
    for path, option in (("cv", "--pressure"), ("oedometer", "--pressure"), ("cr", "--cycles")):
        code, said = tried(path, *ratio, option, "100" if option == "--cycles" else "100kPa")
        assert code == 2 and f"{option} is not a parameter of {path}: leave it out" in said
    code, said = tried("cr", "--void-ratio", "62", "--pressure", "100kPa")
    assert code == 2 and "not between 0.1 and 3" in said and "0.62" in said
    code, said = tried("cr", "--void-ratio", "0,75", "--pressure", "100kPa")
    assert code == 2 and "'0,75' has a decimal comma: give 0.75" in said
    code, said = tried("cr", *ratio, columns=["pore_pressure=H:kPa:compression"])
    assert code == 2 and "takes no sign: give pore_pressure=H:kPa" in said
    code, said = tried("cr", *ratio, "--pressure", "100kPa", "--strain", "0,05")
    assert code == 2 and "has a decimal comma: give 0.05 or 5 %" in said
