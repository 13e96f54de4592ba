"""Files as public programs and data sets write them, with other numbers: columns, separators, quirks."""

import numpy as np
import pytest

import labkit as lk
from labkit.plugins.laboratory_data import preview
from tests.plugins.laboratory_data.columns import of_columns

GIVEN = {"strain_kind": "engineering", "stress_kind": "effective", "source": "own numbers", "licence": "CC0"}
STRAIN, Q = np.array([0.0, 0.5, 1.0, 2.0, 4.0]), np.array([0.0, 60.5, 82.25, 95.0, 91.75])
U = np.array([0.0, 20.0, 25.0, 22.5, 10.0])
CELL, P = 100.0 + 0.0 * Q, 100.0 - U + Q / 3.0
CV, CR = lk.paths.ConstantVolume(strain=0.2), lk.paths.ConstantRadialStress(pressure="100 kPa", strain=0.2)


def rows(separator, *columns, decimal="."):
    table = [[f"{number:.16g}".replace(".", decimal) for number in row] for row in zip(*columns, strict=True)]
    return [separator.join(row) for row in table]


GDS = (
    "Stage Number,Time since start of test (s),Time since start of stage (s),Radial Pressure (kPa),"
    "Back Pressure (kPa),Load Cell (kN),Pore Pressure (kPa),Axial Displacement (mm),Axial Strain (%),"
    "Axial Stress (kPa),Eff. Axial Stress (kPa),Eff. Radial Stress (kPa),Deviator Stress (kPa),"
    "Total Stress Ratio,Shear Strain (%),Cambridge p (kPa),Eff. Cambridge p' (kPa),Volume Change (mm\u00b3),"
    "PWP Ratio,Undefined Tx 1"
)


def gds(time=1.0):
    number = len(Q)
    zero = np.zeros(number)
    return rows(
        ",", zero + 7, time * np.arange(number) + 5e5, np.arange(number), zero + 400, zero + 300, 0.1 * Q, 300 + U,
        STRAIN, STRAIN, 400 + Q, 100 + Q - U, 100 - U, Q, zero, STRAIN, 400 + Q / 3, P, zero, U, zero,
    )  # fmt: skip


def of_gds(name):
    return of_columns(e1="Axial Strain (%)", q="Deviator Stress (kPa)", p=name)


SEMICOLONS = of_columns(e1="Deform_axial:1", q="Sigma_d_(kPa):kPa", s3="Sigma_3_(kPa):kPa", u="Delta_U_(kPa):kPa")
NUMBERS = of_columns(e1="#1:%", q="#2:kPa", u="#3:kPa", s3="#4:kPa")
GERMAN = of_columns(e1="Axiale Dehnung", q="Deviatorspannung", p="Mittlere effektive Spannung")
FORMS = {
    "GDSLab, CSV": (
        "\r\n".join(["Project,7", "", GDS, *gds()]), "cp1252", of_gds("Eff. Cambridge p' (kPa)"), {},
    ),
    "GDSLab, CSV with a comma at the end of each row": (
        "\n".join([f"{GDS},", *(f"{row}," for row in gds())]), "utf-8-sig", of_gds("Eff. Cambridge p' (kPa)"), {},
    ),
    "GDSLab, total stresses": (
        "\n".join([GDS, *gds()]), "utf-8",
        {**of_gds("Cambridge p (kPa)"), "pore_pressure": ("Pore Pressure (kPa)", None)}, {"stress_kind": "total"},
    ),
    "CU test with semicolons and points": (
        "\n".join(["Deform_axial;Delta_U_(kPa);Sigma_d_(kPa);Sigma_3_(kPa)", *rows(";", STRAIN / 100, U, Q, CELL)]),
        "utf-8", SEMICOLONS, {"stress_kind": "total"},
    ),
    "computed table with apostrophes in headers": (
        "\n".join(["Deform_axial_(%),q,p,p',Sigma'_1/Sigma'_3", *rows(",", STRAIN, Q, P + U, P, Q)]),
        "utf-8",
        of_columns(e1='Deform_axial_(%):%', q='q:kPa', p="p':kPa"),
        {},
    ),
    "no headers, byte order mark": (
        "\n".join(rows(",", STRAIN, Q, U, CELL)), "utf-8-sig", NUMBERS, {"stress_kind": "total"},
    ),
    "German logger, tabs": (
        "\r\n".join(
            [
                "Pr\u00fcfung:\tTriax-CU", "Datum:\t01.02.2020", "",
                "Zeit\tAxiale Dehnung\tDeviatorspannung\tMittlere effektive Spannung\tH\u00f6he",
                "s\t%\tkN/m\u00b2\tkN/m\u00b2\tmm",
                *rows("\t", np.arange(5), STRAIN, Q, P, 0 * Q + 100, decimal=","),
            ]
        ),
        "cp1252", GERMAN, {},
    ),
    "spreadsheet, semicolons, compression negative": (
        "\n".join(
            [
                "Axial Strain (%);Deviator Stress q (kPa);Mean Effective Stress p' (kPa)",
                *rows(";", -STRAIN, Q, -(P), decimal=","),
            ]
        ),
        "utf-8",
        of_columns(
            e1="Axial Strain (%):%:tension", q="Deviator Stress q (kPa):kPa",
            p="Mean Effective Stress p' (kPa):kPa:tension",
        ),
        {},
    ),
    "data base in ASCII, fixed width, psi": (
        "\n".join(
            [
                "NGES CIUC test 12", "  Axial strain    Deviator stress    Mean eff. stress",
                "       (%)              (psi)               (psi)",
                *(f"{e:12.6f}  {q:18.12f}  {p:18.12f}" for e, q, p in zip(
                    STRAIN, Q / 6.894757293168361, (P) / 6.894757293168361, strict=True)),
            ]
        ),
        "ascii",
        of_columns(e1="Axial strain", q="Deviator stress", p="Mean eff. stress"),
        {},
    ),
    "headers separated by blanks, rows by tabs": (
        "\r\n".join(
            [
                "eps1        epsv      Void ratio    q           p          eta = q/p  ",
                "[%]         [%]       [-]           [kPa]       [kPa]      [-]", "",
                *rows("\t", STRAIN, 0 * Q, 0 * Q + 0.7, Q, P, Q / P),
            ]
        ),
        "ascii",
        of_columns(e1="eps1", q="q", p="p", e="Void ratio"),
        {"void_ratio": None},
    ),
    "curves read from a figure": (
        "\n".join(["eps1 q p'", *(f"{e:.6e} {q:.9e} {p:.12e}" for e, q, p in zip(STRAIN, Q, P, strict=True))]),
        "ascii",
        of_columns(e1="eps1:%", q="q:kPa", p="p':kPa"),
        {},
    ),
    "tensors of a tensile convention, Fortran": (
        "\n".join(
            ["# e33 s11 s33", *(f"{-e / 100:.7e} {-(100 - u) * 1e3:.9e} {-(100 - u + q) * 1e3:.9e}".replace("e", "D")
                                for e, u, q in zip(STRAIN, U, Q, strict=True))]
        ),
        "ascii",
        of_columns(e1="e33:1:tension", s1="s33:Pa:tension", s3="s11:Pa:tension"),
        {},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FORMS)
def test_undrained_tests_give_the_numbers_that_were_written(tmp_path, name):
    text, encoding, columns, more = FORMS[name]
    file = tmp_path / "test.csv"
    file.write_bytes(text.encode(encoding))
    measured = lk.read_measured(file, CV, columns, **{"void_ratio": 0.7, **GIVEN, **more})
    data = measured.data
    np.testing.assert_allclose(data["axial_strain"].values, -np.log1p(-STRAIN / 100), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(data.lab.q().values, 1e3 * Q, rtol=1e-12, atol=1e-7)
    np.testing.assert_allclose(data.lab.mean_stress().values, 1e3 * (P), rtol=1e-12)
    assert preview(measured).startswith("test.csv: 5 rows")


def test_a_logger_without_strains_lists_its_columns(tmp_path):
    """Loads and displacements of four inputs: labkit reads strains and stresses."""
    file = tmp_path / "100KPA.TXT"
    file.write_text(
        "INDEX, TIME STAMP, TIME (ms), DEV 1 INPUT 1, DEV 1 INPUT 2,\n0,11/7/2024 13:02:15,500,0.02,0.000,\n"
    )
    columns = {
        "axial_strain": ("Axial Strain (%)", "%", "compression"),
        "axial_stress": ("DEV 1 INPUT 1", "kPa", "compression"),
    }
    with pytest.raises(lk.InputError, match=r"line 1 has no 'Axial Strain .*INDEX, TIME STAMP.*DEV 1 INPUT 2"):
        lk.read_measured(file, CR, columns, void_ratio=0.7, **GIVEN)


OEDOMETER = """m,zi,faza,sigma_v,delta_h,h,e,Eoed_MPa
0.0,0.0,Obci\u0105\u017canie,0.0,0.0,20.0,0.65,
1.0,0.12,Obci\u0105\u017canie,22.5,0.12,19.88,0.64,3.1
8.0,0.75,Obci\u0105\u017canie,180.0,0.75,19.25,0.59,4.4
8.0,0.75,Odci\u0105\u017canie,180.0,0.75,19.25,0.59,
0.0,0.11,Odci\u0105\u017canie,0.0,0.11,19.89,0.641,1.0
"""


def test_an_oedometer_test_may_unload(tmp_path):
    file = tmp_path / "wyniki.csv"
    file.write_text(OEDOMETER, encoding="utf-8")
    columns = {"axial_stress": ("sigma_v", "kPa", "compression"), "void_ratio": ("e", "1")}
    measured = lk.read_measured(file, lk.paths.Oedometer(strain=0.5), columns, **GIVEN)
    e = np.array([0.65, 0.64, 0.59, 0.59, 0.641])
    assert measured.data["void_ratio"].values.tolist() == e.tolist()
    assert measured.data["axial_strain"].values == pytest.approx(np.log(1.65 / (1.0 + e)))
    assert lk.misfit(measured, measured, {"axial_stress": 1e3, "void_ratio": 0.01})["all"] == 0.0
    said = preview(measured)
    assert "goes back by up to" in said and "not above 0 in 2 rows" in said and "not used: m, zi, faza" in said


PIVOT = """Slope,0.57,,0.57
soil type,CDT,,,,,
ID,Sum of s'(kN/m2),Sum of t'(kN/m2),,ID,Sum of s'(kN/m2),Sum of t'(kN/m2)
87,327.2,181.3,,87,327.2,181.3
88,508.5,271.6,,88,508.5,271.6
,,,,0,0,0
"""


def test_two_tables_beside_each_other_ask_for_the_number_of_the_column(tmp_path):
    file = tmp_path / "pivot.csv"
    file.write_text(PIVOT)
    columns = of_columns(e1="#1:1", q="Sum of t'(kN/m2)", p="Sum of s'(kN/m2)")
    with pytest.raises(lk.InputError, match=r"columns #3 and #7: give the number of a column instead, e.g. #3"):
        lk.read_measured(file, CV, columns, void_ratio=0.7, **GIVEN)


AGS = [
    ["GROUP", "CTRD"],
    ["HEADING", "LOCA_ID", "SAMP_REF", "CTRD_CYNO", "CTRD_EAS", "CTRD_DEV", "CTRD_MEES"],
    ["UNIT", "", "", "", "%", "kPa", "kN/m2"],
    ["TYPE", "ID", "X", "0DP", "2DP", "1DP", "1DP"],
]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_ags4_with_two_boreholes(tmp_path, encoding):
    data = [["DATA", hole, "15\u00b0", "1", f"{e:g}", f"{q:g}", f"{100 - u + q / 3:.14g}"]
            for hole in ("BH1", "BH2") for e, q, u in zip(STRAIN, Q, U, strict=True)]  # fmt: skip
    file = tmp_path / "a.ags"
    file.write_bytes("".join(",".join(f'"{cell}"' for cell in row) + "\r\n" for row in [*AGS, *data]).encode(encoding))
    columns = of_columns(e1="CTRD_EAS", q="CTRD_DEV", p="CTRD_MEES")
    with pytest.raises(lk.InputError, match=r"second test.*--rows LOCA_ID=BH1 or LOCA_ID=BH2"):
        lk.read_measured(file, CV, columns, void_ratio=0.7, group="CTRD", **GIVEN)
    measured = lk.read_measured(file, CV, columns, void_ratio=0.7, group="CTRD", rows={"LOCA_ID": "BH2"}, **GIVEN)
    np.testing.assert_allclose(measured.data.lab.mean_stress().values, 1e3 * (P), rtol=1e-12)
    assert "lines 10 to 14" in preview(measured)


def test_a_stage_of_a_test_is_chosen_by_its_number(tmp_path):
    """Consolidation and shearing in one file: the strain of the stage begins again."""
    file = tmp_path / "stages.csv"
    before = [row.replace("7,", "6,", 1) for row in gds()]
    file.write_text("\n".join([GDS, *before, *gds()]))
    columns = of_gds("Eff. Cambridge p' (kPa)")
    with pytest.raises(lk.InputError, match="second test"):
        lk.read_measured(file, CV, columns, void_ratio=0.7, **GIVEN)
    measured = lk.read_measured(file, CV, columns, void_ratio=0.7, rows={"Stage Number": "7"}, **GIVEN)
    assert "5 rows have another Stage Number" in preview(measured)


def test_cyclic_tests_below_each_other_ask_for_the_table(tmp_path):
    time = np.linspace(0.0, 3.0, 121)
    table = [
        f"{t:.3f}\t{0.1 * np.sin(2 * np.pi * t):.6f}\t{40 * np.sin(2 * np.pi * t):.6f}\t{100 - 25 * t:.6f}"
        for t in time
    ]
    head = "Time (s)\tAxial strain (%)\tDeviator stress (kPa)\tMean effective stress (kPa)"
    file = tmp_path / "cyclic.txt"
    file.write_text("\n".join(["CSR 0.2", head, *table, "", "CSR 0.3", head, *table]))
    columns = of_columns(e1="Axial strain (%)", q="Deviator stress (kPa)", p="Mean effective stress (kPa)")
    path = lk.paths.UndrainedCycles(amplitude="40 kPa", cycles=3)
    with pytest.raises(lk.InputError, match=r"2 \(below 'CSR 0.2'\).*'CSR 0.3'.*give --header"):
        lk.read_measured(file, path, columns, void_ratio=0.7, **GIVEN)
    measured = lk.read_measured(file, path, columns, void_ratio=0.7, header=126, **GIVEN)
    assert measured.data.sizes["time"] == 121
    assert float(measured.data.lab.cycles()[-1]) == pytest.approx(3.0, abs=0.3)
    assert lk.misfit(measured, measured, {"r_u": 0.05})["r_u"] == 0.0 and measured.plot("cycles", data=measured)
    assert float(measured.data.lab.pore_pressure_ratio().max()) == pytest.approx(0.75, rel=1e-12)
