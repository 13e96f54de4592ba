"""Tests that count from elsewhere, and columns that contradict each other: read rightly, or said with what to give."""

import re
from pathlib import Path

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.plugins.laboratory_data import preview
from labkit.plugins.laboratory_data.checks import unit_findings
from tests.plugins.laboratory_data.columns import of_columns

GIVEN = {"strain_kind": "engineering", "stress_kind": "effective", "source": "own numbers", "licence": "CC0"}
CR = lk.paths.ConstantRadialStress(pressure="100 kPa", strain=0.2)
CV = lk.paths.ConstantVolume(strain=0.2)
EPS = np.array([0.0, 0.5, 1.0, 2.0, 4.0])
VOLUME = np.array([0.0, 0.1168, 0.1866, 0.0637, -0.9027])
AXIAL = np.array([100.0, 213.6, 256.2, 292.3, 313.4])
COLUMNS = of_columns(e1="eps:%", ev="epsv:%", s1="s1:kPa", s3="s3:kPa")


def read(folder, path, columns, header, *values, **more):
    file = folder / "test.csv"
    rows = [",".join(f"{number:.10g}" for number in row) for row in zip(*values, strict=True)]
    file.write_text("\n".join([header, *rows]) + "\n")
    return lk.read_measured(file, path, columns, **{"void_ratio": 0.7, **GIVEN, **more})


def drained(folder, eps=EPS, volume=VOLUME, axial=AXIAL, radial=None, path=CR, columns=COLUMNS, **more):
    radial = 0.0 * EPS + 100.0 if radial is None else radial
    return read(folder, path, columns, "eps,epsv,s1,s3", eps, volume, axial, radial, **more)


def test_strains_that_count_from_consolidation_ask_for_zero(tmp_path):
    with pytest.raises(lk.InputError, match=r"axial strain is 1.2 % and the volumetric strain is 2.1 % in line 2.*"
                       "give --zero axial_strain volumetric_strain"):  # fmt: skip
        drained(tmp_path, EPS + 1.2, VOLUME + 2.1)
    right = drained(tmp_path)
    zeroed = drained(tmp_path, EPS + 1.2, VOLUME + 2.1, zero=("axial_strain", "volumetric_strain"))
    for name in ("axial_strain", "volume", "void_ratio", "stress"):
        np.testing.assert_allclose(zeroed.data[name].values, right.data[name].values, rtol=1e-9, atol=1e-15)
    assert "axial_strain counts from the first row" in preview(zeroed) and "note" not in preview(right)


def test_only_the_volume_may_count_from_consolidation(tmp_path):
    with pytest.raises(lk.InputError, match=r"the volumetric strain is 0.8 % in line 2.*--zero volumetric_strain to"):
        drained(tmp_path, EPS, VOLUME + 0.8)


def test_a_curve_whose_beginning_is_missing_is_noted(tmp_path):
    measured = drained(tmp_path, EPS + 0.3, VOLUME, AXIAL + 60.0)
    assert "where q/p is 0.5: is the beginning missing" in preview(measured)


def test_zero_needs_a_column(tmp_path):
    with pytest.raises(lk.InputError, match=r"zero pore_pressure has no column: give some of axial_strain, volumetric"):
        drained(tmp_path, zero=("pore_pressure",))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"decimal": "dot"}, "decimal dot is not valid: give point or comma"),
        ({"separator": "|"}, "separator | is not valid: give one of semicolon, tab"),
        ({"separator": "tab"}, "separator tab does not stand in"),
        ({"encoding": "idna"}, "encoding idna is unknown"),
        ({"axial": np.array([100.0, 1e308, 1.0, 1.0, 1.0])}, "line 3 has '1e+308' in 's1': repair"),
    ],
)
def test_what_no_table_has_is_refused_in_a_sentence(tmp_path, more, message):
    with pytest.raises(lk.InputError, match=re.escape(message)):
        drained(tmp_path, **more)


def test_one_quantity_may_count_from_the_first_row(tmp_path):
    assert "axial_strain counts" in preview(drained(tmp_path, EPS + 1.2, zero="axial_strain"))


def as_deviator(name="s1"):
    return {k: COLUMNS[k] for k in ("axial_strain", "volumetric_strain", "radial_stress")} | {
        "deviatoric_stress": (name, "kPa", "compression")
    }


def test_an_axial_stress_given_as_deviatoric_stress_is_found(tmp_path):
    with pytest.raises(
        lk.InputError, match=r"deviatoric stress is 100 kPa in line 2, as large as the other.*axial_stress"
    ):
        drained(tmp_path, columns=as_deviator())


def test_a_seating_load_is_subtracted_if_the_user_says_so(tmp_path):
    with pytest.raises(
        lk.InputError, match=r"deviatoric stress is 9 kPa in line 2, before any.*--zero deviatoric_stress"
    ):
        drained(tmp_path, axial=AXIAL - 91.0, columns=as_deviator())
    measured = drained(tmp_path, axial=AXIAL - 91.0, columns=as_deviator(), zero=["deviatoric_stress"])
    np.testing.assert_allclose(measured.data.lab.q().values, 1e3 * (AXIAL - 100.0), rtol=1e-9, atol=1e-6)


def undrained(folder, pore, radial=400.0, **more):
    columns = of_columns(e1="eps:%", q="q:kPa", s3="s3:kPa", u="u:kPa")
    q, s3 = AXIAL - 100.0, radial + 0.0 * EPS
    return read(folder, CV, columns, "eps,q,s3,u", EPS, q, s3, pore, **{"stress_kind": "total", **more})


def test_a_back_pressure_in_the_pore_pressure_only_is_subtracted_if_the_user_says_so(tmp_path):
    rise = np.array([0.0, 30.0, 45.0, 50.0, 40.0])
    right = undrained(tmp_path, 300.0 + rise)
    with pytest.raises(lk.InputError, match=r"pore pressure is 300 kPa in line 2, .*100 kPa: give --zero pore_p"):
        undrained(tmp_path, 300.0 + rise, radial=100.0)
    zeroed = undrained(tmp_path, 300.0 + rise, radial=100.0, zero=["pore_pressure"])
    np.testing.assert_allclose(zeroed.data["stress"].values, right.data["stress"].values, rtol=1e-9, atol=1e-6)
    text = "pore pressure begins with 0 kPa, the effective mean stress with 400 kPa: is a back pressure in the total"
    assert text in preview(undrained(tmp_path, rise))


def test_a_measured_pore_pressure_is_used_and_not_assumed(tmp_path):
    rise, ramp = np.array([0.0, 30.0, 45.0, 50.0, 40.0]), np.array([0.0, -5.0, -10.0, -10.0, -10.0])
    measured = undrained(tmp_path, 300.0 + rise, radial=400.0 + ramp)
    written = tmp_path / "m.run.nc"
    lk.write_measured(measured, written)
    for lab in (measured.data.lab, lk.Run.open(written).data.lab):
        np.testing.assert_allclose(lab.pore_pressure().values, 1e3 * rise, atol=1e-6)
        np.testing.assert_allclose(lab.quantity("r_u").values, rise / 100.0, atol=1e-9)
        np.testing.assert_allclose(lab.pore_pressure("radial").values, 1e3 * (rise - ramp), atol=1e-6)
        np.testing.assert_allclose(lab.quantity("r_u_radial").values, (rise - ramp) / 100.0, atol=1e-9)
    assert lk.misfit(measured, measured, {"r_u": 0.05})["r_u"] == 0.0
    effective = undrained(tmp_path, 300.0 + rise, radial=100.0 - rise, stress_kind="effective")
    np.testing.assert_allclose(effective.data.lab.pore_pressure().values, 1e3 * rise, atol=1e-6)


def test_calibration_compares_pore_pressures_of_one_total_stress(tmp_path):
    rise = np.array([0.0, 30.0, 45.0, 50.0, 40.0])
    measured = undrained(tmp_path, 300.0 + rise, radial=100.0 - rise, stress_kind="effective")
    tests = lk.GrainTests({"a": measured}, {"friction": (0.1, 0.9)}, {"r_u": 0.05})
    repeated = lk.Run(measured.data.drop_vars("measured_pore_pressure").assign_attrs(engine="fused"))
    np.testing.assert_allclose(tests.points({"a": repeated}), tests.points({"a": measured}), atol=1e-9)


def test_a_volume_of_the_wrong_sign_is_found(tmp_path):
    with pytest.raises(lk.InputError, match=r"volume first grows, by 0.1864 % up to line 4, where q/p is 1: give the"):
        drained(tmp_path, volume=-VOLUME)
    columns = {**COLUMNS, "volumetric_strain": ("epsv", "%", "tension")}
    assert "note" not in preview(drained(tmp_path, volume=-VOLUME, columns=columns))
    # unloading in extension swells first: no finding
    path = lk.paths.ConstantRadialStress(pressure="100 kPa", strain=-0.2)
    axial = np.array([100.0, 70.0, 50.0, 40.0, 38.0])
    drained(tmp_path, -EPS, np.array([0.0, -0.05, -0.06, 0.02, 0.1]), axial, path=path)


SAND = Path(__file__).resolve().parents[3] / "examples/laboratory/karlsruhe_fine_sand.csv"


@pytest.mark.parametrize("name", ["TMD1", "TMD5", "TMD12", "TMD16", "TMD21", "TMD25"])
def test_a_wrong_sign_is_found_in_loose_and_dense_sand(name):
    """All 25 tests of the file are found with the wrong sign, and none with the right one; six of them here."""
    columns = of_columns(e1="eps_a[%]", ev="eps_v[%]", s1="sigma_a[kPa]", s3="sigma_r[kPa]")
    pressure = {"TMD5": 400, "TMD12": 100, "TMD25": 400}.get(name, 50)
    path = lk.paths.ConstantRadialStress(pressure=f"{pressure} kPa", strain=0.25)
    known = {"rows": {"test": name}, "void_ratio": 0.8, **GIVEN}
    lk.read_measured(SAND, path, columns, **known)
    wrong = columns | {"volumetric_strain": ("eps_v[%]", None, "tension")}
    with pytest.raises(lk.InputError, match="the volume first grows"):
        lk.read_measured(SAND, path, wrong, **known)
    # the column e of this file is that of the first row, in every row
    del columns["volumetric_strain"], known["void_ratio"]
    with pytest.raises(lk.InputError, match="in every row, and the path cr is drained: give it as --void-ratio"):
        lk.read_measured(SAND, path, columns | {"void_ratio": ("e", "1")}, **known)


def test_the_void_ratio_gives_the_volumetric_strain(tmp_path):
    """The usual form of papers: eps_v = ln((1 + e0)/(1 + e))."""
    (tmp_path / "t.dat").write_text(
        "# eps_a e p q\n0.000 0.700 100.0 0.0\n0.010 0.690 126.0 78.0\n0.020 0.688 140.0 120.0\n"
    )
    columns = of_columns(e1="eps_a:1", e="e:1", p="p:kPa", q="q:kPa")
    data = lk.read_measured(tmp_path / "t.dat", CR, columns, **GIVEN).data
    np.testing.assert_allclose(data.lab.volumetric_strain().values, [0.0, 0.005900, 0.007084], atol=5e-7)
    np.testing.assert_allclose(data["void_ratio"].values, [0.7, 0.69, 0.688], rtol=1e-12)
    del columns["void_ratio"]
    with pytest.raises(lk.InputError, match=r"volumetric_strain is missing: .*, or void_ratio=HEADER:1"):
        lk.read_measured(tmp_path / "t.dat", CR, columns, void_ratio=0.7, **GIVEN)


AGS = """"GROUP","CTRD"
"HEADING","LOCA_ID","CTRD_AXST","CTRD_DEVS","{}","CTRD_MEFS"
"UNIT","","%","kPa","kPa","kPa"
"DATA","BH1","0.00","0.0","5.0","100.0"
"DATA","BH1","0.50","60.0","66.0","95.0"
"""


def test_structure_that_stands_twice_in_ags4_is_refused(tmp_path):
    columns = of_columns(e1="CTRD_AXST", q="CTRD_DEVS", p="CTRD_MEFS")
    once, twice = AGS.format("CTRD_X"), AGS.format("CTRD_DEVS")
    cases = {
        once: None,
        twice: r"header 'CTRD_DEVS' above the columns #4 and #5",
        once + once: "has the group CTRD 2 times: repair the file",
        once.replace('"UNIT"', once.splitlines()[1] + '\n"UNIT"'): "has 2 lines HEADING and 2 lines DATA",
    }
    for text, message in cases.items():
        (tmp_path / "t.ags").write_text(text)
        if message is None:
            lk.read_measured(tmp_path / "t.ags", CV, columns, void_ratio=0.7, group="CTRD", **GIVEN)
            continue
        with pytest.raises(lk.InputError, match=message):
            lk.read_measured(tmp_path / "t.ags", CV, columns, void_ratio=0.7, group="CTRD", **GIVEN)


def test_an_option_that_names_a_quantity_twice_is_refused(tmp_path, capsys):
    (tmp_path / "t.csv").write_text("eps,q,p\n0,0,100\n1,10,100\n")
    words = ["--strain-kind", "engineering", "--stress-kind", "effective", "--source", "-", "--licence", "-"]
    columns = ["--column", "axial_strain=eps:%:compression", "axial_strain=q:%:compression"]
    code = main(["measured", "cv", str(tmp_path / "t.csv"), *words, *columns, "-o", str(tmp_path / "a.run.nc")])
    assert code == 2 and "has axial_strain twice" in capsys.readouterr().err


def test_a_column_of_lengths_is_not_offered_as_a_stress(tmp_path):
    with pytest.raises(lk.InputError, match=r"but the file says mm for 's1': give a column of stresses"):
        read(tmp_path, CR, COLUMNS, "eps,epsv,s1,s3\n%,%,mm,kPa", EPS, VOLUME, AXIAL, 0.0 * EPS + 100.0)
    (found,) = unit_findings({"void_ratio": ("SAMP_BASE", "1")}, {"SAMP_BASE": "m"})
    assert "the file says m for 'SAMP_BASE': give a column of void ratios" in str(found)
